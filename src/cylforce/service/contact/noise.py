"""How wrong the torque of this instant is: what is learned in the air, and two causes that are seen coming."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cylforce.estimation.fast import Instant
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.residual import RELATIVE
from cylforce.signals.estimate import Array

# The figures below are measured on machines of another generator: see tools/studies/README.md.
PRIOR = 5.0  # times the row error of the weighing: standard error of a row before the machine was seen in the air
LATE_S = 0.034  # s: the torque of inertia is wrong by this time's change of it
FADING_S = 0.045  # s in which such an error fades, the delay of the measured speed
LEARNING_S = 20.0  # s of motion in the air in which the learned variance follows; chosen
LARGEST = 9.0  # normalised square above which a sample teaches no more than this, so that a blow is not noise; chosen


class Unrest(NamedTuple):
    """State: covariance `inertia` (R, R) [N^2 m^2] of the late torque of inertia; `reversing` (C,): 1 where a cylinder
    turns round, fading; learned `variance` (R,) [N^2 m^2]."""

    inertia: Array
    reversing: Array
    variance: Array


@dataclass(frozen=True)
class Noise:
    """The errors of the rows of an instant. While the inertia changes, it is late; while a cylinder turns round, the
    sign of its friction is; the rest is learned from the torque that is left in the air."""

    model: Model
    tares: Tares

    @cached_property
    def _keep(self) -> float:
        return float(np.exp(-1.0 / (FADING_S * self.model.filters.rate_hz)))

    @cached_property
    def _coulomb(self) -> Array:
        return np.abs(self.tares.values[self.model.coulomb])

    def begin(self) -> Unrest:
        """The state before any sample."""
        rows = len(self.model.machine.rows)
        still = np.zeros(len(self.model.machine.cylinders))
        return Unrest(np.zeros((rows, rows)), still, (PRIOR * self.tares.row_error) ** 2)

    def step(self, state: Unrest, instant: Instant, parameters: Array) -> Unrest:
        """The state after one instant; `parameters` (P,) of machine and load."""
        late = LATE_S * (instant.change[:, : len(parameters)] @ parameters)
        inertia = self._keep * state.inertia + (1.0 - self._keep) * np.multiply.outer(late, late)
        return Unrest(inertia, np.maximum(instant.reversing, self._keep * state.reversing), state.variance)

    def covariance(self, state: Unrest, instant: Instant, torque: Array) -> Array:
        """Covariance (R, R) [N^2 m^2] of the rows of an instant that leave the `torque` (R,) [N m]."""
        known = self._foreseen(state, instant) + state.variance + (RELATIVE * torque) ** 2
        return state.inertia + np.diag(known)

    def learn(self, state: Unrest, instant: Instant, torque: Array, good: Array) -> Unrest:
        """The state after the rows marked in `good` (R,) left `torque` (R,) [N m] in the air: s <- s (1 + a (e - 1)), e
        the square of what is left over its variance."""
        expected = self._foreseen(state, instant) + np.diagonal(state.inertia) + state.variance
        square = np.minimum(torque**2 / expected, LARGEST)
        change = (square - 1.0) / (LEARNING_S * self.model.filters.rate_hz)
        floor = self.tares.row_error**2
        learned = np.maximum(state.variance * (1.0 + np.where(good, change, 0.0)), floor)
        return state._replace(variance=learned)

    def _foreseen(self, state: Unrest, instant: Instant) -> Array:
        """Variance (R,) of friction whose sign is not known."""
        if not self._coulomb.size:
            return np.zeros(len(instant.lever.T))
        return np.asarray(((state.reversing * self._coulomb) @ np.abs(instant.lever)) ** 2)
