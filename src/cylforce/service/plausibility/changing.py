"""Does a pressure change as a pressure does? It changes when its cylinder turns round: supply becomes return. A reading
that does not, apart from noise, is stuck; one that falls to nothing at once is that of a burst hose; one that stays
below vacuum is off."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.mechanics.machine import Machine
from cylforce.service.plausibility.quiet import Noises, begun, listened, taken_back
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import SIDES

GROUP = 25  # steps of which the mean is taken, 0.25 s at 100 Hz: shorter than a stroke, longer than noise
GROUPS = 16  # of motion of the cylinder that are compared
EACH_WAY = 4  # of them at least in either direction
MOVES = 0.02  # m/s of a cylinder from which on a group is one of motion; chosen: far above the noise of a speed
# Variance between the groups' means over that expected from the noise within them: below this, the pressure does not
# change. A constant with white noise exceeds it once in fifty times; machines in order are at 4 and more.
CONSTANT = 28.2595 / (GROUPS - 1)  # chi-squared with 15 degrees of freedom, exceeded by 2 %
# Above this one that did not change does so again: a constant exceeds it once in ten hours (1.16e-6: four a second, of
# six pressures)
CHANGES = 56.118 / (GROUPS - 1)
TINY = 1.0  # Pa^2: noise is not less than a pascal
FALL_STEPS = 5  # 50 ms at 100 Hz: in which it falls, and then as long stays; in order a pressure dips for one step
FALLS = 20e5  # Pa from which it falls when its hose bursts: above any return line; chosen
NOTHING = 1e5  # Pa: what is left then, a sensor's error of zero; return lines have 2 bar and more
VACUUM = -1e5 - NOTHING  # Pa: no pressure is lower, and no sensor's error of zero shows less


def pressures(machine: Machine) -> list[int]:
    """Numbers (P,) of the signals that are pressures."""
    return [k for k, s in enumerate(machine.signals) if s.kind in SIDES]


class Changes(NamedTuple):
    """State, of P pressures: the last `readings`, each (P,), of which `fresh` are those of the running group; of the
    last groups in motion means, noises (variances) and ways (3, GROUPS, P), 0 where there was none yet; which
    pressures are `constant`, which `burst` and which are `below` vacuum (P,); their noise."""

    readings: tuple[tuple[float, ...], ...]
    fresh: int
    groups: Array
    constant: NDArray[np.bool_]
    burst: NDArray[np.bool_]
    below: NDArray[np.bool_]
    noises: Noises


@dataclass(frozen=True)
class Watching:
    """The pressures of one machine."""

    machine: Machine

    @cached_property
    def signals(self) -> list[int]:
        """Numbers (P,) of the signals."""
        return pressures(self.machine)

    @cached_property
    def _cylinders(self) -> list[int]:
        return [self.machine.signals[k].index for k in self.signals]

    def begin(self) -> Changes:
        """Nothing was seen."""
        size = len(self.signals)
        no = np.zeros(size, dtype=bool)
        return Changes((), 0, np.zeros((3, GROUPS, size)), no, no, no, begun(size))

    def interrupt(self, state: Changes) -> Changes:
        """The measurement stopped: the running group starts anew."""
        return state._replace(readings=(), fresh=0)

    def step(self, state: Changes, values: Array, speed: Numbers) -> Changes:
        """One step: all signals (S,), speed (C,) [m/s] of the cylinders."""
        each = values.tolist()
        now = tuple([each[k] for k in self.signals])
        state = Changes((*state.readings, now), state.fresh + 1, *state[2:])
        if min(now, default=NOTHING) < NOTHING and len(state.readings) > 2 * FALL_STEPS:
            most = np.array(state.readings[-FALL_STEPS:]).max(axis=0)
            fallen = (most < NOTHING) & (np.array(state.readings[-1 - 2 * FALL_STEPS]) > FALLS)
            below = state.below | (most < VACUUM)
            state = state._replace(burst=state.burst | (fallen & ~below), below=below)
        return self._grouped(state, np.array([speed[c] for c in self._cylinders])) if state.fresh == GROUP else state

    def _grouped(self, state: Changes, way: Array) -> Changes:
        """With the group that has ended, of the pressures whose cylinders move, `way` (P,) [m/s]."""
        group, moved = np.array(state.readings[-GROUP:]), np.abs(way) > MOVES
        state = state._replace(readings=state.readings[-2 * FALL_STEPS :], fresh=0)
        if not moved.any():
            return state
        middle = group.sum(axis=0) / GROUP
        new = np.empty_like(state.groups)
        new[:, :-1], new[0, -1], new[2, -1] = state.groups[:, 1:], middle, np.sign(way)
        new[1, -1] = ((group - middle) ** 2).sum(axis=0) / (GROUP - 1)
        groups = np.where(moved, new, state.groups)
        state = state._replace(groups=groups, noises=listened(state.noises, group, groups[:2], moved))
        forwards, backwards = (groups[2] > 0.0).sum(axis=0), (groups[2] < 0.0).sum(axis=0)
        judged = (np.minimum(forwards, backwards) >= EACH_WAY) & (forwards + backwards == GROUPS)
        if not judged.any():
            return state
        noise = np.sort(groups[1], axis=0)[GROUPS // 2]
        ratio = groups[0].var(axis=0, ddof=1) * GROUP / np.maximum(noise, TINY)
        still = np.where(state.constant, ratio <= CHANGES, ratio <= CONSTANT)
        noises = taken_back(state.noises, judged & (ratio > CHANGES), GROUPS)
        return state._replace(constant=np.where(judged, still, state.constant), noises=noises)
