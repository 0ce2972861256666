"""Does a pressure change as a pressure does? It changes when its cylinder turns round: supply becomes return. A reading
that does not, apart from white noise, is stuck; one that falls to nothing at once is that of a burst hose; one that
stays below vacuum is off."""

from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.heard import GROUP, GROUPS
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.mechanics.machine import Machine
from cylforce.service.plausibility.quiet import Noises, begun, listened, longer, taken_back
from cylforce.signals.kinds import SIDES
from cylforce.signals.quick import new, once

MOVES = 0.02  # m/s of a cylinder from which on a group is one of motion; chosen: far above the noise of a speed
# Variance between the groups' means over that expected from the noise within them: below this, the pressure does not
# change. A constant with white noise exceeds it once in fifty times; machines in order are at 4 and more.
CONSTANT = 28.2595 / (GROUPS - 1)  # chi-squared with 15 degrees of freedom, exceeded by 2 %
# Above this one that did not change does so again: a constant exceeds it once in ten hours (1.16e-6: four a second, of
# six pressures)
CHANGES = 56.118 / (GROUPS - 1)
# Median variance within groups over that of their white noise, from second differences: above this, oil oscillates.
# F distribution with 24 and 12.1 degrees of freedom, exceeded by 2 % of single groups of white noise
COLOURED = 3.1795
FALL_STEPS = 5  # 50 ms at 100 Hz: in which it falls, and then as long stays; in order a pressure dips for one step
FALLS = 20e5  # Pa from which it falls when its hose bursts: above any return line; chosen
NOTHING = 1e5  # Pa: what is left then, a sensor's error of zero; return lines have 2 bar and more
VACUUM = -1e5 - NOTHING  # Pa: no pressure is lower, and no sensor's error of zero shows less

NONE = array("d")


def pressures(machine: Machine) -> list[int]:
    """Numbers (P,) of the signals that are pressures."""
    return [k for k, s in enumerate(machine.signals) if s.kind in SIDES]


class Rests(NamedTuple):
    """State of the pressures whose own cylinder rests while another one moves: `groups` and their noise, as in motion;
    a cylinder that rests may hear less of the pump."""

    groups: Numbers
    noises: Noises


class Changes(NamedTuple):
    """State, of P pressures: the last `readings` (T, P), one after the other, of which `fresh` are those of the running
    group; of the last groups in motion means, variances, ways and white noise (variances) (4, GROUPS, P), 0 where there
    was none yet;
    which pressures are `constant`, which `burst` and which are `below` vacuum (P,); their noise;
    those at rest."""

    readings: Numbers
    fresh: int
    groups: Numbers
    constant: NDArray[np.bool_]
    burst: NDArray[np.bool_]
    below: NDArray[np.bool_]
    noises: Noises
    rests: Rests

    @property
    def gone(self) -> NDArray[np.bool_]:
        """Whose noise is gone (P,), in motion or at rest."""
        return np.asarray(self.noises.gone | self.rests.noises.gone)

    @property
    def lost(self) -> tuple[Numbers, Numbers]:
        """The same as the kernel keeps it."""
        return self.noises.lost, self.rests.noises.lost


@dataclass(frozen=True)
class Watching:
    """The pressures of one machine."""

    machine: Machine
    kernel: Any = field(default_factory=lambda: choice.chosen())  # noqa: PLW0108 - asked when it is made

    @once
    def signals(self) -> list[int]:
        """Numbers (P,) of the signals."""
        return pressures(self.machine)

    @once
    def _chosen(self) -> Callable[[Numbers], tuple[float, ...]]:
        """Gives the pressures of all signals."""
        signals = self.signals
        return itemgetter(*signals) if len(signals) > 1 else lambda values: tuple(values[k] for k in signals)

    @once
    def _stated(self) -> Numbers:
        """Variances (P,) [Pa^2] of the sensors' noise; infinite where none is stated."""
        signals = (self.machine.signals[k] for k in self.signals)
        return array("d", [s.standard_error**2 or inf for s in signals])

    @once
    def _cylinders(self) -> list[int]:
        return [self.machine.signals[k].index for k in self.signals]

    def begin(self) -> Changes:
        """Nothing was seen."""
        size = len(self.signals)
        no = np.zeros(size, dtype=bool)
        groups = ZERO * (4 * GROUPS * size)
        return Changes(NONE, 0, groups, no, no, no, begun(size), Rests(groups, begun(size)))

    def interrupt(self, state: Changes) -> Changes:
        """The measurement stopped: the running group starts anew."""
        return state._replace(readings=NONE, fresh=0)

    def now(self, values: Numbers) -> Numbers:
        """The pressures (P,) among all signals (S,)."""
        return array("d", self._chosen(values))

    def step(self, state: Changes, now: Numbers, speed: Sequence[float]) -> Changes:
        """One step: the pressures (P,) `now`, speed (C,) [m/s] of the cylinders."""
        readings, fresh = state.readings + now, state.fresh + 1
        state = new(Changes, (readings, fresh) + state[2:])  # noqa: RUF005 - quicker
        if min(now, default=NOTHING) < NOTHING:
            state = self._fallen(state)
        return self._grouped(state, speed) if fresh == GROUP else state

    def _fallen(self, state: Changes) -> Changes:
        """With the pressures that fell to nothing at once, and those below vacuum."""
        last = np.frombuffer(state.readings).reshape(-1, len(self.signals))
        if len(last) <= 2 * FALL_STEPS:
            return state
        most = last[-FALL_STEPS:].max(axis=0)
        fallen = (most < NOTHING) & (last[-1 - 2 * FALL_STEPS] > FALLS)
        below = state.below | (most < VACUUM)
        return state._replace(burst=state.burst | (fallen & ~below), below=below)

    def _grouped(self, state: Changes, speed: Sequence[float]) -> Changes:
        """With the group that has ended, of the pressures whose cylinders move, at `speed` (C,) [m/s]."""
        readings, size = state.readings, len(self.signals)
        state = state._replace(readings=readings[-2 * FALL_STEPS * size :], fresh=0)
        way = array("d", [speed[c] for c in self._cylinders])
        moved = [abs(each) > MOVES for each in way]
        if True not in moved:
            return state
        own = np.array(moved)
        groups, noises = self._heard(state.groups, state.noises, readings, way, own)
        state = state._replace(groups=groups, noises=noises, rests=self._rested(state.rests, readings, own))
        ratios = ZERO * (2 * size)
        return self._compared(state, ratios) if self.kernel.compare(size, groups, ZERO * GROUPS, ratios) else state

    def _heard(
        self, groups: Numbers, noises: Noises, readings: Numbers, way: Numbers, which: NDArray[np.bool_]
    ) -> tuple[Numbers, Noises]:
        """Groups and noise with the last group of `readings`, of those pressures (P,) that are `which`; `way` (P,)."""
        size, groups = len(self.signals), groups[:]
        begin = len(readings) // size - GROUP
        self.kernel.group(size, readings, begin, way, MOVES, groups)
        group = np.frombuffer(readings, offset=8 * size * begin).reshape(GROUP, size)
        return groups, listened(noises, group, np.frombuffer(groups).reshape(4, GROUPS, size)[:2], which, self._stated)

    def _rested(self, state: Rests, readings: Numbers, moved: NDArray[np.bool_]) -> Rests:
        """With the last group of `readings`, of the pressures whose cylinders did not move."""
        rested = ~moved
        if not rested.any():
            return state._replace(noises=longer(state.noises, moved))
        groups, noises = self._heard(*state, readings, array("d", rested.astype(np.float64).tobytes()), rested)
        return Rests(groups, longer(noises, moved))

    def _compared(self, state: Changes, ratios: Numbers) -> Changes:
        """With what the groups' `ratios` (2, P) say, of their means and of their noise; -1: nothing yet."""
        size, before = len(self.signals), state.constant.tolist()
        each = list(zip(ratios[:size], ratios[size:], before, strict=True))
        now = [
            ratio <= (CHANGES if was else CONSTANT) and not noise > COLOURED if ratio >= 0.0 else was
            for ratio, noise, was in each
        ]
        constant = state.constant if now == before else np.array(now)
        back = [ratio > CHANGES or (ratio >= 0.0 and noise > COLOURED) for ratio, noise, _ in each]
        state = state._replace(constant=constant)
        if True not in back:
            return state
        noises, rests = (taken_back(e, np.array(back), GROUPS) for e in (state.noises, state.rests.noises))
        return state._replace(noises=noises, rests=state.rests._replace(noises=rests))
