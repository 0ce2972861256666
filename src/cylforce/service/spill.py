"""Test for a spill: a part of the load has fallen out, or has come in, during a lift.

Every period at the end of a lift is compared with every period at its beginning. The spill lies in the period between
them, which belongs to neither."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.recursive import Root
from cylforce.signals.estimate import Array

EVERY_S = 0.3  # s between comparisons; chosen: half of the duration of a spill
SHORTEST = 2  # least number of comparisons after the change: a weight from them is accurate to some kilograms
KEPT = 12  # last examinations, after which a change may have begun; chosen: it is found within 3 s, or never
CERTAIN = 4.0  # standard errors of a change that counts; chosen: none by chance in a shift's 1e4 seconds


def information(root: Root, gram: Array) -> Array:
    """Return information matrix U'U, right-hand side U'z and gram of a load side by side (4, 4 + 1 + K).

    All of them are sums over time, so that the difference of two instants is the information between them.

    root: triangle U (4, 4) of the information on the load (m, m x, m z, J), and its right-hand side z (4,)
    gram: (4, K) products of the load's columns with those of K other parameters, over each row's variance
    """
    return np.column_stack([root.factor.T @ np.column_stack([root.factor, root.right]), gram])


def root_and_gram(known: Array) -> tuple[Root, Array]:
    """Return root and gram (4, K) of the information on a load side by side: the inverse of `information`.

    known: (4, 5 + K) information matrix U'U (4, 4), right-hand side U'z (4,) and gram (4, K)

    Raises numpy.linalg.LinAlgError where it is not of full rank."""
    lower = np.asarray(np.linalg.cholesky(known[:, :4]), dtype=np.float64)
    right = np.asarray(np.linalg.solve(lower, known[:, 4]), dtype=np.float64)
    return Root(lower.T.copy(), right), known[:, 5:].copy()


def block_diagonal(one: Array, other: Array) -> Array:
    """Return the covariance (K + L, K + L) of two independent groups of parameters.

    one:   (K, K) covariance of the first group
    other: (L, L) covariance of the second group
    """
    size = len(one)
    both = np.zeros((size + len(other), size + len(other)))
    both[:size, :size], both[size:, size:] = one, other
    return both


def changed_at(marks: Array, now: Array, others: Array, least: float) -> int | None:
    """Return the number of the examination since which a lift has another load than before (spill); None: it has not.

    A change counts if it exceeds `least` and CERTAIN of its standard errors. The surest of several changes counts.

    marks:  (M, 4, 5 + K) information on the load at each of M earlier examinations, oldest first
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
    """Return the pairs (first, last) of `marks` examinations between which a load may have changed.

    The load is constant before the first examination of a pair, and after the second one, which may be the same."""
    first, last = np.triu_indices(max(marks - SHORTEST + 1, 0))
    return first, last


def change(before: Array, since: Array, others: Array) -> tuple[Array, Array]:
    """Return by how much the mass of a load changed between two times, and the standard error of that (...,) [kg].

    The change is positive where the load grew. The centre of the load stays. Where the load before was lighter than
    1 kg, or the rows after the change do not depend on the mass, the change is 0 and its error infinite.

    With x the load before, of mass m, and a = x/m, rows r = A x + A a delta after the change give
    delta = a'(eta - Lambda x) / a' Lambda a. x has the errors of its own information.

    before: (..., 4, 5 + K) information on the load (m, m x, m z, J) before the change: matrix, right-hand side, gram
    since:  (..., 4, 5 + K) information after the change, [Lambda | eta | gram]
    others: (K, K) covariance of the other parameters, whose errors change the mass with the motion
    """
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
