"""The noise floor: how strong, and how alike from sample to sample, is what the model leaves of a clean recording."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cylforce.signals.estimate import Array

ORDER = 3
CONSTANT = 0.2  # of a constant, at least, passes the whitening


class Floor(NamedTuple):
    """Of each measured row r: `rms` (R,) [N m], autoregression (R, ORDER), and `white` (R,), the rms of what that does
    not predict."""

    rms: Array
    memory: Array
    white: Array


def floor_of(left: Sequence[Array]) -> Floor:
    """The floor that residuals (T, R) of clean recordings show; NaN separates."""
    rows = range(left[0].shape[1])
    memory = np.array([_memory([e[:, r] for e in left]) for r in rows])
    rms = np.array([_rms(np.concatenate([e[:, r] for e in left])) for r in rows])
    white = [_rms(np.concatenate([whitened(e[:, r], memory[r]) for e in left])) for r in rows]
    return Floor(rms, memory, np.array(white))


def whitened(x: Array, memory: Array) -> Array:
    """x (T, ...) without what its last samples predict; the first ORDER are NaN, so is what follows a NaN."""
    found = x.copy()
    for k, share in enumerate(memory, 1):
        found[k:] -= share * x[:-k]
    found[: len(memory)] = np.nan
    return found


def _memory(left: Sequence[Array]) -> Array:
    """Least squares of each sample on the ORDER before it."""
    lags = [np.stack([np.roll(e, k) for k in range(ORDER + 1)], axis=-1)[ORDER:] for e in left if len(e) > ORDER]
    rows = np.concatenate(lags)
    rows = rows[np.all(np.isfinite(rows), axis=1)]
    if len(rows) < 10 * ORDER:
        return np.zeros(ORDER)
    return _forgetting(np.asarray(np.linalg.lstsq(rows[:, 1:], rows[:, 0], rcond=None)[0]))


def _forgetting(memory: Array) -> Array:
    """The same with poles moved inwards until something of a constant is left: what is slow must not be taken for
    noise."""
    each = (memory * radius ** np.arange(1, len(memory) + 1) for radius in np.linspace(1.0, 0.0, 101))
    return np.asarray(next(found for found in each if 1.0 - np.sum(found) >= CONSTANT))


def _rms(x: Array) -> float:
    good = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(good**2))) if good.size else 1.0
