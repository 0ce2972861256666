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
    """Information matrix and vector of a load, and its `gram` (4, K) with other parameters, side by side (4, 5 + K):
    all of them add up over time."""
    return np.column_stack([root.factor.T @ np.column_stack([root.factor, root.right]), gram])


def informed(told: Array) -> tuple[Root, Array]:
    """The root and the gram (4, K) of what is `told` (4, 5 + K): the inverse of `information`. Raises
    numpy.linalg.LinAlgError where it is not of full rank."""
    lower = np.asarray(np.linalg.cholesky(told[:, :4]), dtype=np.float64)
    right = np.asarray(np.linalg.solve(lower, told[:, 4]), dtype=np.float64)
    return Root(lower.T.copy(), right), told[:, 5:].copy()


def side_by_side(one: Array, other: Array) -> Array:
    """Covariance (K + L, K + L) of independent parameters, of their covariances (K, K) and (L, L)."""
    size = len(one)
    both = np.zeros((size + len(other), size + len(other)))
    both[:size, :size], both[size:, size:] = one, other
    return both


def changed_at(marks: Array, now: Array, others: Array, least: float) -> int | None:
    """Number of the mark after which the load is another one, by at least `least` [kg], of the information `marks`
    (M, 4, 5 + K) of the lift so far and `now` (4, 5 + K); None: of none. `others` (K, K) as below."""
    first, last = _pairs(len(marks))
    if not len(first):
        return None
    by, wrong = change(marks[first], now - marks[last], others)
    sure = np.where(np.abs(by) > least, np.abs(by) / wrong, 0.0)
    best = int(sure.argmax())
    return int(last[best]) if sure[best] > CERTAIN else None


@cache
def _pairs(marks: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Numbers of the mark before which, and of that after which, a load may have been constant."""
    first, last = np.triu_indices(max(marks - SHORTEST + 1, 0))
    return first, last


def change(before: Array, since: Array, others: Array) -> tuple[Array, Array]:
    """(Change of the mass (...), its standard error) [kg] from the information `before` (..., 4, 5 + K) to that of the
    time `since` then (..., 4, 5 + K); the centre of the load stays where it was. `others` (K, K): covariance of the
    other parameters, whose errors show another mass in another motion. Infinite error where nothing tells.

    With x the load before and a = x/m, rows r = A x + A a delta give delta = a'(eta - Lambda x) / a' Lambda a; x has
    the errors of its own information."""
    load = np.linalg.solve(before[..., :4], before[..., 4:5])  # (..., 4, 1)
    mass = load[..., 0, 0]
    tells = np.abs(mass) >= 1.0
    along = load / np.where(tells, mass, 1.0)[..., None, None]
    told = np.swapaxes(along, -1, -2) @ since  # (..., 1, 5 + K)
    new = (told[..., :4] @ along)[..., 0, 0]
    tells &= new > 0.0
    told = told / np.where(tells, new, 1.0)[..., None, None]
    of_before = np.linalg.solve(before[..., :4], np.swapaxes(told[..., :4], -1, -2))  # (..., 4, 1)
    gain = told[..., 0, 5:] - (np.swapaxes(of_before, -1, -2) @ before[..., 5:])[..., 0, :]
    noise = 1.0 / np.where(tells, new, 1.0) + (told[..., :4] @ of_before)[..., 0, 0]
    wrong = np.sqrt(noise + ((gain @ others) * gain).sum(axis=-1))
    by = told[..., 0, 4] - (told[..., :4] @ load)[..., 0, 0]
    return np.where(tells, by, 0.0), np.where(tells, wrong, np.inf)
