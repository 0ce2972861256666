"""The share of a gap's energy that goes, against the noise floor, with its interval."""

import numpy as np

from cylforce.diagnosis.columns.statistics import blocked
from cylforce.diagnosis.inference.residuals import SPAN
from cylforce.diagnosis.numbers import MASS, RATIO, UNTOLD
from cylforce.signals.estimate import Array

DRAWS = 400


def blockwise(residual: Array) -> Array:
    """Mean squares (B, R) of a residual's blocks (T, R); NaN where a block has no rows."""
    good = np.isfinite(residual)
    count = np.sum(blocked(good.astype(np.float64)), axis=1)
    squares = np.sum(blocked(np.where(good, residual, 0.0) ** 2), axis=1)
    return np.where(count > 0.0, squares / np.maximum(count, 1.0), np.nan)


def closure(
    before: Array, after: Array, floors: tuple[Array, Array], rng: np.random.Generator
) -> tuple[float, tuple[float, float]]:
    """1 - (MSE after - floor)/(MSE before - floor), rows weighted by their floor, and its interval by drawing spans of
    blocks anew. The field's floor lies between what the fit leaves of the clean recordings and what it leaves of them
    unseen (mean squares (B, R) of both in `floors`): its draws are mixtures. NaN where the gap is too small for a
    ratio (below a tenth of the floor's energy)."""
    unit = np.nanmean(floors[1], axis=0)
    a, b, *c = (_spans(x / unit) for x in (before, after, *floors))
    kept = np.all([np.any(np.isfinite(x), axis=1) for x in (a, b)], axis=0)
    a, b = (np.nanmean(x[kept], axis=1) for x in (a, b))
    seen, unseen = (np.nanmean(x[np.any(np.isfinite(x), axis=1)], axis=1) for x in c)
    middle = (np.mean(seen) + np.mean(unseen)) / 2.0
    if float(np.mean(a) - middle) < RATIO * float(middle):
        return float("nan"), (float("nan"), float("nan"))
    each = []
    for _ in range(DRAWS):
        k, m, n = (rng.integers(0, len(x), len(x)) for x in (a, seen, unseen))
        mixed = rng.uniform()
        each.append(_share(a[k], b[k], mixed * np.mean(seen[m]) + (1.0 - mixed) * np.mean(unseen[n])))
    low, high = np.quantile(each, [(1.0 - MASS) / 2.0, (1.0 + MASS) / 2.0])
    return _share(a, b, middle), (float(low) - UNTOLD[0], min(float(high) + UNTOLD[1], 1.0))


def _share(before: Array, after: Array, floor: float) -> float:
    excess = float(np.mean(before)) - floor
    return min(1.0 - (float(np.mean(after)) - floor) / excess, 1.0) if excess > 0.0 else 0.0


def _spans(squares: Array) -> Array:
    count = -(-len(squares) // SPAN)
    padded = np.full((count * SPAN, squares.shape[1]), np.nan)
    padded[: len(squares)] = squares
    return padded.reshape(count, SPAN * squares.shape[1])
