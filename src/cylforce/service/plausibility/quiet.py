"""Is the noise of a pressure gone? What a frozen sensor, or the node that repeats its last value, says has less noise
than the sensor had, and nothing of the motion. While a cylinder moves, its pressures never vary less than their
noise; their noise is what second differences show in the quietest tenth of the last 15 s of motion, no more than the
sensor states. Noise may also become less because a pump runs slower: `changing` takes the doubt back when it sees
that the pressure changes, and noise is learnt anew."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.heard import CODES, KNOWN, LATEST, NOISES
from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.signals.estimate import Array

__all__ = ["CODES", "KNOWN", "LATEST", "NOISES", "QUIET", "TENTH", "Noises", "begun", "listened", "taken_back"]

# The tenth part of the groups shows less than this share of white noise: chi-squared with the 12.1 degrees of freedom
# of 23 second differences
TENTH = 0.52701
# Variance of all readings of the last 1 to 4 groups over that of the noise below which noise is gone: white noise is
# once in ten hours of motion (chi-squared, lower quantiles of 2.9e-7: four a second, of six pressures, four limits)
QUIET = (0.14338, 0.29127, 0.38126, 0.44281)
_LIMITS = numbers(QUIET)


class Noises(NamedTuple):
    """State, of P pressures: variances of the noise in the last groups in motion (NOISES, P), 0 where there was none
    yet; number (P,) of those since noise is gone, 0 where it is not; one after the other, as the kernel keeps them
    (`kept`)."""

    kept: Numbers

    @property
    def known(self) -> Array:
        """The variances (NOISES, P)."""
        return np.frombuffer(self.kept).reshape(NOISES + 1, -1)[:-1]

    @property
    def since(self) -> Array:
        """The number (P,) of groups since noise is gone."""
        return np.asarray(np.frombuffer(self.kept).reshape(NOISES + 1, -1)[-1])

    @property
    def lost(self) -> Numbers:
        """The same as the kernel keeps it."""
        return self.kept[NOISES * len(self.kept) // (NOISES + 1) :]

    @property
    def gone(self) -> NDArray[np.bool_]:
        """Whose noise is gone (P,)."""
        return np.asarray(self.since > 0.0)


def begun(size: int) -> Noises:
    """Nothing was seen of `size` pressures."""
    return Noises(ZERO * ((NOISES + 1) * size))


def listened(state: Noises, group: Array, groups: Array, moved: NDArray[np.bool_], stated: Numbers) -> Noises:
    """The state after a group (T, P), of the pressures whose cylinders `moved` (P,). `groups` (2, G, P): means and
    variances of the last groups in motion, with this one; `stated` (P,): variances of the sensors' noise, more than
    which is the oil's. What is heard while noise is gone is not remembered."""
    (size, pressures), kept, work = group.shape, state.kept[:], ZERO * NOISES
    told = (np.ascontiguousarray(groups), groups.shape[1], np.asarray(moved, dtype=np.float64), stated)
    choice.chosen().listen(pressures, group, size, *told, TENTH, _LIMITS, len(QUIET), work, kept)
    return Noises(kept)


def longer(state: Noises, moved: NDArray[np.bool_]) -> Noises:
    """The state of pressures at rest after a group in which some `moved` (P,): what is gone is gone for longer."""
    gone = moved & state.gone
    if not gone.any():
        return state
    kept = np.frombuffer(state.kept).reshape(NOISES + 1, -1).copy()
    kept[-1] += gone
    return Noises(numbers(kept.ravel()))


def taken_back(state: Noises, changes: NDArray[np.bool_], groups: int) -> Noises:
    """The state where a pressure `changes` (P,), as the last `groups` show: if noise was gone before all of them, it is
    learnt anew."""
    back = changes & (state.since > groups)
    if not back.any():
        return state
    anew = np.where(back, 0.0, np.frombuffer(state.kept).reshape(NOISES + 1, -1))
    return Noises(numbers(anew.ravel()))
