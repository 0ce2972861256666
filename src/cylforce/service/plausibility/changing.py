"""Does a pressure change as a pressure does? It changes when its cylinder turns round: supply becomes return. A reading
that does not, apart from noise, is stuck; one that falls to nothing at once is that of a burst hose."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

GROUP = 25  # steps of which the mean is taken, 0.25 s at 100 Hz: shorter than a stroke, longer than noise
GROUPS = 16  # of motion of the cylinder that are compared
EACH_WAY = 4  # of them at least in either direction
MOVES = 0.02  # m/s of a cylinder from which on a group is one of motion; chosen: far above the noise of a speed
# Variance between the groups' means over that expected from the noise within them: below this, the pressure does not
# change. A constant with white noise exceeds it once in fifty times; machines in order are at 4 and more.
CONSTANT = float(chi2.isf(0.02, GROUPS - 1) / (GROUPS - 1))
FALL_STEPS = 5  # 50 ms at 100 Hz
FALLS = 20e5  # Pa that a pressure loses in that time when its hose bursts; chosen
NOTHING = 1e5  # Pa: what is left then, a sensor's error of zero; return lines have 2 bar and more


class Group(NamedTuple):
    """The running group of P pressures: number of `steps`, its `first` readings, sums of the readings less the first,
    of their squares, and of the cylinders' speeds; all (P,)."""

    steps: int
    first: Array
    total: Array
    squares: Array
    travel: Array


class Changes(NamedTuple):
    """State: the `last` readings (FALL_STEPS, P), 0 where there is none; the running group; of the last groups in
    motion the `means`, `noises` (variances) and `ways` (GROUPS, P), 0 where there was none yet; which pressures are
    `constant` and which `burst` (P,)."""

    last: Array
    group: Group
    means: Array
    noises: Array
    ways: Array
    constant: NDArray[np.bool_]
    burst: NDArray[np.bool_]


@dataclass(frozen=True)
class Watching:
    """The pressures of one machine."""

    machine: Machine

    @cached_property
    def signals(self) -> list[int]:
        """Numbers (P,) of the signals."""
        kinds = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE)
        return [k for k, s in enumerate(self.machine.signals) if s.kind in kinds]

    @cached_property
    def _cylinders(self) -> list[int]:
        return [self.machine.signals[k].index for k in self.signals]

    @cached_property
    def _no_group(self) -> Group:
        none = np.zeros(len(self.signals))
        return Group(0, none, none, none, none)

    def begin(self) -> Changes:
        """Nothing was seen."""
        size = len(self.signals)
        empty, no = np.zeros((GROUPS, size)), np.zeros(size, dtype=bool)
        return Changes(np.zeros((FALL_STEPS, size)), self._no_group, empty, empty, empty, no, no)

    def interrupt(self, state: Changes) -> Changes:
        """The measurement stopped: the running group starts anew."""
        return state._replace(last=np.zeros_like(state.last), group=self._no_group)

    def step(self, state: Changes, values: Array, speed: Array) -> Changes:
        """One step: all signals (S,), speed (C,) [m/s] of the cylinders."""
        now, group = values[self.signals], state.group
        state = self._fallen(state, now)
        first = group.first if group.steps else now
        away = now - first
        travel = group.travel + speed[self._cylinders]
        group = Group(group.steps + 1, first, group.total + away, group.squares + away * away, travel)
        return self._grouped(state._replace(group=group)) if group.steps == GROUP else state._replace(group=group)

    def _fallen(self, state: Changes, now: Array) -> Changes:
        last = np.concatenate([state.last[1:], now[None]])
        if now.min(initial=np.inf) >= NOTHING:
            return state._replace(last=last)
        return state._replace(last=last, burst=state.burst | ((now < NOTHING) & (state.last[0] - now > FALLS)))

    def _grouped(self, state: Changes) -> Changes:
        """With the group that has ended, where the cylinder moved."""
        group = state.group
        mean, way = group.total / GROUP, group.travel / GROUP
        noise = (group.squares - group.total * mean) / (GROUP - 1)
        moved = np.abs(way) > MOVES
        means, noises, ways = (
            np.where(moved, np.concatenate([old[1:], new[None]]), old)
            for old, new in ((state.means, mean + group.first), (state.noises, noise), (state.ways, np.sign(way)))
        )
        turned = np.minimum((ways > 0.0).sum(axis=0), (ways < 0.0).sum(axis=0)) >= EACH_WAY
        full = np.abs(ways).sum(axis=0) == GROUPS
        still = means.var(axis=0, ddof=1) <= CONSTANT * np.median(noises, axis=0) / GROUP
        constant = np.where(full & turned, still, state.constant)
        return state._replace(group=self._no_group, means=means, noises=noises, ways=ways, constant=constant)
