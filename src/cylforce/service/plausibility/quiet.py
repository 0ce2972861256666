"""Is the noise of a pressure gone? What a frozen sensor, or the node that repeats its last value, says has less noise
than the sensor had, and nothing of the motion. While a cylinder moves, its pressures never vary less than their noise;
their noise is what second differences show in the quietest tenth of the last 15 s of motion. Noise may also become less
because a pump runs slower: `changing` takes the doubt back when it sees that the pressure changes, and noise is learnt
anew."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.signals.estimate import Array

NOISES = 64  # groups whose noise is remembered, 16 s of motion
LATEST = 8  # of them, 2 s, in which it may be gone already
KNOWN = 24  # groups before them that must be known; chosen
# The tenth part of the groups shows less than this share of white noise: chi-squared with the 12.1 degrees of freedom
# of 23 second differences
TENTH = 0.52701
# Variance of all readings of the last 1 to 4 groups over that of the noise below which noise is gone: white noise is
# once in ten hours of motion (chi-squared, lower quantiles of 2.9e-7: four a second, of six pressures, four limits)
QUIET = (0.14338, 0.29127, 0.38126, 0.44281)
SECOND = 6.0  # times the variance of white noise is that of its second differences
CODES = 2  # readings of no more values show the sensor's digits, not its noise


class Noises(NamedTuple):
    """State, of P pressures: variances of the noise in the last groups in motion (NOISES, P), 0 where there was none
    yet; number (P,) of those `since` noise is gone, 0 where it is not."""

    known: Array
    since: Array

    @property
    def gone(self) -> NDArray[np.bool_]:
        """Whose noise is gone (P,)."""
        return np.asarray(self.since > 0.0)


def begun(size: int) -> Noises:
    """Nothing was seen of `size` pressures."""
    return Noises(np.zeros((NOISES, size)), np.zeros(size))


def listened(state: Noises, group: Array, groups: Array, moved: NDArray[np.bool_]) -> Noises:
    """The state after a group (T, P), of the pressures whose cylinders `moved` (P,). `groups` (2, G, P): means and
    variances of the last groups in motion, with this one. What is heard while noise is gone is not remembered."""
    noise = white(group)
    digits = (np.diff(np.sort(group, axis=0), axis=0) > 0.0).sum(axis=0) < CODES
    gone = state.gone | (_gone(state.known, groups, len(group)) & ~digits)
    heard = moved & ~gone & (noise > 0.0)
    known = np.where(heard, np.concatenate([state.known[1:], noise[None]]), state.known)
    return Noises(known, state.since + (moved & gone))


def white(group: Array) -> Array:
    """Variance (P,) of the white noise in readings (T, P), by their second differences."""
    second = np.diff(group, 2, axis=0)
    return np.asarray((second**2).sum(axis=0) / (SECOND * len(second)))


def taken_back(state: Noises, changes: NDArray[np.bool_], groups: int) -> Noises:
    """The state where a pressure `changes` (P,), as the last `groups` show: if noise was gone before all of them, it is
    learnt anew."""
    back = changes & (state.since > groups)
    return Noises(np.where(back, 0.0, state.known), np.where(back, 0.0, state.since)) if back.any() else state


def _gone(known: Array, groups: Array, size: int) -> NDArray[np.bool_]:
    before = np.where(known[:-LATEST] > 0.0, known[:-LATEST], np.inf)
    many = np.isfinite(before).sum(axis=0)
    own = np.sort(before, axis=0)[many // 10, np.arange(len(many))] / TENTH
    varied = _variances(groups[:, : -len(QUIET) - 1 : -1], size)
    less = (varied < np.array(QUIET)[: len(varied), None] * own).any(axis=0)
    return np.asarray((many >= KNOWN) & less)


def _variances(groups: Array, size: int) -> Array:
    """Variances (G, P) of all readings of the first 1 to G groups of `size` with their means and variances
    (2, G, P)."""
    count = np.arange(1, groups.shape[1] + 1)[:, None]
    middle = groups[0] - groups[0, 0]
    apart = (middle**2).cumsum(axis=0) - middle.cumsum(axis=0) ** 2 / count
    squares = (size - 1) * groups[1].cumsum(axis=0) + size * apart
    return np.asarray(squares / (size * count - 1))
