"""Has a part of the load fallen out, or come in, while it hung? Every stretch at the end of a lift is compared with
every one at its beginning; the stretch between them, in which it happened, belongs to neither."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.recursive import Root
from cylforce.signals.estimate import Array

EVERY_S = 0.3  # s between comparisons; chosen: half of the time in which a bucket loses what it loses
SHORTEST = 2  # of these from the change on, at least: a weight from it is certain to some kilograms
KEPT = 12  # last looks, after which a change may have begun; chosen: it is found within 3 s, or never
CERTAIN = 4.0  # standard errors of the change from which on it is one; chosen: none by chance in a shift's 1e4 seconds


def information(root: Root, gram: Array) -> Array:
    """Return information matrix, right-hand side and gram of a load side by side (4, 5 + K): all of them add up over
    time.

    root: triangle of the information on the load (4,)
    gram: (4, K) with K other parameters
    """
    return np.column_stack([root.factor.T @ np.column_stack([root.factor, root.right]), gram])


def root_and_gram(known: Array) -> tuple[Root, Array]:
    """Return root and gram (4, K) of `known` (4, 5 + K), the inverse of `information`.

    Raises numpy.linalg.LinAlgError where it is not of full rank."""
    lower = np.asarray(np.linalg.cholesky(known[:, :4]), dtype=np.float64)
    right = np.asarray(np.linalg.solve(lower, known[:, 4]), dtype=np.float64)
    return Root(lower.T.copy(), right), known[:, 5:].copy()


def block_diagonal(one: Array, other: Array) -> Array:
    """Return the covariance (K + L, K + L) of independent parameters from their covariances (K, K) and (L, L)."""
    size = len(one)
    both = np.zeros((size + len(other), size + len(other)))
    both[:size, :size], both[size:, size:] = one, other
    return both


def changed_at(marks: Array, now: Array, others: Array, least: float) -> int | None:
    """Return the number of the mark after which the load is another one; None: it is the same.

    marks:  (M, 4, 5 + K) information of the lift so far
    now:    (4, 5 + K) information of the whole lift
    others: (K, K) covariance of the other parameters
    least:  smallest change of the mass that counts [kg]
    """
    first, last = _pairs(len(marks))
    if not len(first):
        return None
    by, error = change(marks[first], now - marks[last], others)
    sure = np.where(np.abs(by) > least, np.abs(by) / error, 0.0)
    best = int(sure.argmax())
    return int(last[best]) if sure[best] > CERTAIN else None


@cache
def _pairs(marks: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the numbers of the mark before which, and of that after which, a load may have been constant."""
    first, last = np.triu_indices(max(marks - SHORTEST + 1, 0))
    return first, last


def change(before: Array, since: Array, others: Array) -> tuple[Array, Array]:
    """Return the change of the mass and its standard error (...,) [kg]; the error is infinite where the rows since do
    not depend on the mass. The centre of the load stays where it was.

    before: (..., 4, 5 + K) information before the change
    since:  (..., 4, 5 + K) information since then
    others: (K, K) covariance of the other parameters, whose errors show another mass in another motion

    With x the load before and a = x/m, rows r = A x + A a delta give delta = a'(eta - Lambda x) / a' Lambda a; x has
    the errors of its own information."""
    load = np.linalg.solve(before[..., :4], before[..., 4:5])  # x (..., 4, 1)
    mass = load[..., 0, 0]
    depends = np.abs(mass) >= 1.0
    along = load / np.where(depends, mass, 1.0)[..., None, None]  # a
    projected = np.swapaxes(along, -1, -2) @ since  # a' [Lambda eta gram] (..., 1, 5 + K)
    weight = (projected[..., :4] @ along)[..., 0, 0]  # a' Lambda a
    depends &= weight > 0.0
    projected = projected / np.where(depends, weight, 1.0)[..., None, None]
    of_before = np.linalg.solve(before[..., :4], np.swapaxes(projected[..., :4], -1, -2))  # (..., 4, 1)
    gain = projected[..., 0, 5:] - (np.swapaxes(of_before, -1, -2) @ before[..., 5:])[..., 0, :]
    noise = 1.0 / np.where(depends, weight, 1.0) + (projected[..., :4] @ of_before)[..., 0, 0]
    error = np.sqrt(noise + ((gain @ others) * gain).sum(axis=-1))
    by = projected[..., 0, 4] - (projected[..., :4] @ load)[..., 0, 0]
    return np.where(depends, by, 0.0), np.where(depends, error, np.inf)
