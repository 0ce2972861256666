"""Has a part of the load fallen out, or come in, while it hung? The last second of a lift is compared with the rest."""

import numpy as np

from cylforce.estimation.recursive import Root
from cylforce.signals.estimate import Array

EVERY_S = 0.6  # s between comparisons; the last second is two of them; chosen: as short as a weight from it is certain
CERTAIN = 4.0  # standard errors of the change from which on it is one; chosen: none by chance in a shift's 1e4 seconds


def information(root: Root, gram: Array) -> Array:
    """Information matrix and vector of a load, and its `gram` (4, K) with other parameters, side by side (4, 5 + K):
    all of them add up over time."""
    return np.column_stack([root.factor.T @ np.column_stack([root.factor, root.right]), gram])


def side_by_side(one: Array, other: Array) -> Array:
    """Covariance (K + L, K + L) of independent parameters, of their covariances (K, K) and (L, L)."""
    size = len(one)
    both = np.zeros((size + len(other), size + len(other)))
    both[:size, :size], both[size:, size:] = one, other
    return both


def change(before: Array, now: Array, others: Array) -> tuple[float, float]:
    """(Change of the mass, its standard error) [kg] since the information `before` (4, 5 + K), from what has come until
    `now` (4, 5 + K); the centre of the load stays where it was. `others` (K, K): covariance of the other parameters,
    whose errors show another mass in another motion. Infinite error where nothing tells.

    With x the load before and a = x/m, rows r = A x + A a delta give delta = a'(eta - Lambda x) / a' Lambda a."""
    since = now - before
    load = np.linalg.solve(before[:, :4], before[:, 4])
    if abs(load[0]) < 1.0:
        return 0.0, np.inf
    along = load / load[0]
    known, new = float(along @ before[:, :4] @ along), float(along @ since[:, :4] @ along)
    if known <= 0.0 or new <= 0.0:
        return 0.0, np.inf
    gain = along @ since[:, 5:] / new - along @ before[:, 5:] / known
    wrong = float(np.sqrt(1.0 / known + 1.0 / new + gain @ others @ gain))
    return float(along @ (since[:, 4] - since[:, :4] @ load)) / new, wrong
