"""Is the noise of a pressure gone? What a frozen sensor, or the node that repeats its last value, says has less noise
than the sensor had, and nothing of the motion. While a cylinder moves, its pressures never vary less than their noise;
their noise is what second differences show in the quietest tenth of the last 15 s of motion."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.signals.estimate import Array

NOISES = 64  # groups whose noise is remembered, 16 s of motion
LATEST = 8  # of them, 2 s, in which it may be gone already
KNOWN = 24  # groups before them that must be known; chosen
# The tenth part of the groups shows less noise than this share of it: chi-squared with 12.1 degrees of freedom, those of
# 23 second differences of white noise
TENTH = 0.52701
# Variance of all readings of the last 1 to 4 groups over that of the noise below which noise is gone: white noise is
# once in ten hours of motion (chi-squared, lower quantiles of 2.9e-7: four a second, of six pressures, four limits)
QUIET = (0.14338, 0.29127, 0.38126, 0.44281)
CODES = 2  # readings of no more values show the sensor's digits, not its noise


class Noises(NamedTuple):
    """State, of P pressures: variances of the noise in the last groups in motion (NOISES, P), 0 where there was none
    yet; whose noise is gone (P,)."""

    known: Array
    gone: NDArray[np.bool_]


def begun(size: int) -> Noises:
    """Nothing was seen of `size` pressures."""
    return Noises(np.zeros((NOISES, size)), np.zeros(size, dtype=bool))


def listened(state: Noises, group: Array, groups: Array, moved: NDArray[np.bool_]) -> Noises:
    """The state after a group (T, P), of the pressures whose cylinders `moved` (P,). `groups` (2, G, P): means and
    variances of the last groups in motion, with this one. What is heard while noise is gone is not remembered."""
    second = np.diff(group, 2, axis=0)
    noise = (second**2).sum(axis=0) / (6.0 * len(second))  # second differences of white noise have six times its variance
    digits = (np.diff(np.sort(group, axis=0), axis=0) > 0.0).sum(axis=0) < CODES
    gone = np.where(moved, _gone(state.known, groups, len(group)) & ~digits, state.gone)
    heard = moved & ~gone & (noise > 0.0)
    return Noises(np.where(heard, np.concatenate([state.known[1:], noise[None]]), state.known), gone)


def _gone(known: Array, groups: Array, size: int) -> NDArray[np.bool_]:
    before = np.where(known[:-LATEST] > 0.0, known[:-LATEST], np.inf)
    many = np.isfinite(before).sum(axis=0)
    own = np.take_along_axis(np.sort(before, axis=0), (many // 10)[None], axis=0)[0] / TENTH
    return (many >= KNOWN) & np.any([_variance(groups[:, -n:], size) < q * own for n, q in enumerate(QUIET, 1)], axis=0)


def _variance(groups: Array, size: int) -> Array:
    """Variance (P,) of all readings of groups of `size` with their means and variances (2, G, P)."""
    middle, within = groups
    squares = (size - 1) * within.sum(axis=0) + size * ((middle - middle.mean(axis=0)) ** 2).sum(axis=0)
    return np.asarray(squares / (size * len(middle) - 1))
