"""Rows of this instant, for the force at the tool: torque = columns @ parameters as in `regressor`, but each part
passes only the filter that its own noise needs.

The hydraulics hold the motion, so that a force of the soil shows in the pressures at once and in the acceleration
hardly. Cylinder forces therefore pass quickly; only the inertia, whose noise grows with the square of its corner
frequency, passes slowly. What that costs is known: where the torque of inertia changes, it is late. Ways that were
compared: `tools/studies/force_ways.py`."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cylforce.estimation.filters import Filter, first_order, second_order
from cylforce.estimation.regressor import Rows
from cylforce.mechanics.installation import Filters
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array

AHEAD_S = 0.06  # s by which a reversal of a cylinder is looked for, the delay of its measured speed; measured
STARTING = 0.03  # m/s^2 of a cylinder, below which a change of sign is noise at rest; chosen


class Fast(NamedTuple):
    """State: low-pass of the cylinder forces (2, C); last momentum columns (R, P); low-pass of their rate (1, R, P) and
    its last output (R, P); last speed (C,) [m/s], low-pass of the acceleration (1, C)."""

    forces: Array
    momentum: Array
    slope: Array
    rate: Array
    speed: Array
    acceleration: Array


class Instant(NamedTuple):
    """`rows` of this instant; `change` (R, P): time derivative of their columns of inertia [1/s]; `reversing` (C,):
    1 where a cylinder turns round within AHEAD_S, else 0; cylinder `lever` (C, R) [m/rad] and `speed` (C,) [m/s];
    position `place` [m] of the tool from the first pin and its `velocity` [m/s], as x + i z."""

    rows: Rows
    change: Array
    reversing: Array
    lever: Array
    speed: Array
    place: complex
    velocity: complex


@dataclass(frozen=True)
class FastRegressor:
    """The rows of this instant, from the same momentum and static columns as those of the weighing."""

    machine: Machine
    filters: Filters

    @property
    def dt(self) -> float:
        """The fixed step [s]."""
        return 1.0 / self.filters.rate_hz

    @cached_property
    def quick(self) -> Filter:
        """Low-pass of the forces."""
        return second_order(self.filters.force_hz, self.dt)

    @cached_property
    def slow(self) -> Filter:
        """Low-pass of the inertia."""
        return first_order(self.filters.inertia_hz, self.dt)

    @cached_property
    def _rows(self) -> list[int] | slice:
        rows = self.machine.rows
        return slice(None) if rows == tuple(range(self.machine.size)) else list(rows)

    @property
    def delay(self) -> float:
        """Delay [s] of a slow change of the cylinder forces."""
        return self.quick.delay * self.dt

    def begin(self, momentum: Array, moving: Motion, forces: Array) -> Fast:
        """The state at rest with these columns (R, P) and cylinder `forces` (C,) [N]."""
        still, stopped = np.zeros((1, *momentum.shape)), np.zeros((1, *forces.shape))
        return Fast(self.quick.steady(forces), momentum, still, still[0], moving.speed, stopped)

    def step(self, state: Fast, momentum: Array, static: Array, moving: Motion, forces: Array) -> tuple[Fast, Instant]:
        """(New state, rows) after one sample: columns `momentum` (R, P) and `static` (R, P), unfiltered `forces`
        (C,) [N]."""
        quick, force = self.quick.step(state.forces, forces)
        slope, rate = self.slow.step(state.slope, (momentum - state.momentum) / self.dt)
        slower, acceleration = self.slow.step(state.acceleration, (moving.speed - state.speed) / self.dt)
        lever = moving.lever[:, self._rows]
        turns = np.where(np.abs(acceleration) > STARTING, moving.speed * (moving.speed + AHEAD_S * acceleration), 0.0)
        rows = Rows(static + rate, force @ lever)
        reversing = np.asarray(turns < 0.0, dtype=np.float64)
        change = np.asarray((rate - state.rate) / self.dt)
        found = Instant(rows, change, reversing, lever, moving.speed, *self._tool(moving))
        return Fast(quick, momentum, slope, rate, moving.speed, slower), found

    def _tool(self, moving: Motion) -> tuple[complex, complex]:
        """Position [m] and velocity [m/s] of the tool, x + i z in true horizontal and vertical."""
        arms = np.exp(1j * moving.q) * self.machine.arms
        return complex(arms.sum()), complex(1j * (arms @ moving.qd))
