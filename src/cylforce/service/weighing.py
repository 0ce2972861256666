"""Weighing while moving: the load's mass, first moments and inertia by recursive least squares on top of the fixed
tares (mechanics/README.md, sections 9 and 10), restarted whenever the forces no longer look like one hanging load."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cylforce.estimation.model import Model, Tares
from cylforce.estimation.recursive import Root, forget, known, solution, update
from cylforce.estimation.residual import (
    GOOD_ENOUGH,
    MIN_SECONDS,
    REST_SECONDS,
    SMALLEST,
    Residual,
    correlated,
    load_spread,
)
from cylforce.signals.estimate import Array, Booking, Load, Quantity, Reason, Status, invalid, invalid_load

GATE = 9.0  # mean squared innovation in standard errors (3 squared), above which a sample does not fit the load; chosen
BREAK_AWAY = 3.0  # times the unknown friction at rest: break-away friction, for which the gate allows; chosen
PATIENCE_S = 0.3  # s of samples that do not fit, after which a lift ends; chosen
EMPTY = 0.03  # times the rated payload: below it the bucket counts as empty for the adaptation; chosen
FARTHEST = 1.5  # times the payload's reach: largest plausible distance of the load's centre from the last pin; chosen
FORGET_SECONDS = 30.0  # s after which old samples of a lift have faded to 1/e; chosen


class Lift(NamedTuple):
    """A lift: the recursive estimate of the load's (m, m x, m z, J about the last pin) as information `root`, `values`
    (4,) and `covariance` (4, 4); `gram` (4, P), with which its sensitivity to the tares is covariance @ gram; numbers
    of samples `taken`, `refused` in a row, and `moving`; `rested` (R,): number of samples for which each row has been
    at rest."""

    root: Root
    values: Array
    covariance: Array
    gram: Array
    taken: int
    refused: int
    moving: int
    rested: Array


class Weight(NamedTuple):
    """Mass [kg] with standard error [kg]; centre x + i z [m] of the load in the last link's frame with the standard
    errors (x, z) [m]."""

    mass: float
    standard_error: float
    centre: complex
    centre_error: tuple[float, float]


class Candidate(NamedTuple):
    """The weight that would be booked now: mass [kg], standard error [kg], number of samples in motion on which it is
    based."""

    mass: float
    standard_error: float
    moving: int


class Weighing(NamedTuple):
    """State of the weighing: the present lift, the candidate for booking, the last booking."""

    lift: Lift
    candidate: Candidate | None
    booking: Booking | None


@dataclass(frozen=True)
class Weigher:
    """The weighing of one machine."""

    model: Model
    tares: Tares

    @cached_property
    def _memory(self) -> float:
        """Number of consecutive samples that count as one independent sample."""
        return correlated(self.model.filters)

    @property
    def _long(self) -> float:
        """Number of samples after which older ones begin to fade."""
        return FORGET_SECONDS * self.model.filters.rate_hz

    @cached_property
    def _fresh(self) -> Lift:
        machine = self.model.machine
        root = known(np.zeros(4), load_spread(machine))
        nothing = np.zeros((4, len(self.model.parameters)))
        return Lift(root, *solution(root), nothing, 0, 0, 0, np.zeros(len(machine.rows)))

    def begin(self) -> Weighing:
        """The state before any sample."""
        return Weighing(self._fresh, None, None)

    def interrupt(self, state: Weighing) -> Weighing:
        """The state after an interruption of the measurement: a new lift; candidate and booking remain."""
        return state._replace(lift=self._fresh)

    def step(self, state: Weighing, left: Residual, usable: Array, t_us: int) -> tuple[Weighing, Load]:
        """The state and the load (before zero and tare) after one instant: residual `left`, `usable` (R,) rows, time
        [us]."""
        lift = self._advance(state.lift, left, usable)
        if lift.refused > PATIENCE_S * self.model.filters.rate_hz:
            lift = self._fresh  # the candidate remains until the bucket is seen empty
        weight = self._conclude(lift)
        return self._note(state._replace(lift=lift), weight, t_us), self._judge(lift, weight)

    def is_empty(self, state: Weighing) -> bool:
        """Whether the bucket is known to be empty and in the air."""
        weight = self._conclude(state.lift)
        small = abs(weight.mass) < EMPTY * self.model.machine.rated_payload
        return small and self._doubt(state.lift, weight) is None

    def _advance(self, lift: Lift, left: Residual, usable: Array) -> Lift:
        columns = left.columns @ self.model.load
        expected = columns @ lift.values
        variance = ((columns @ lift.covariance) * columns).sum(axis=1) + left.variance + BREAK_AWAY**2 * left.rest
        innovation = (left.torque - expected) ** 2 / variance
        if not usable.any() or innovation[usable].mean() > GATE:
            return lift._replace(refused=lift.refused + 1)
        at_rest, patience = left.rest > left.variance, REST_SECONDS * self.model.filters.rate_hz
        rested = np.where(at_rest, lift.rested + 1, 0)
        informative = np.logical_and(usable, rested <= patience)
        variance = (self._memory * left.variance + patience * left.rest)[informative]
        used = columns[informative]
        root, gram = self._faded(lift, used)
        root = update(root, used, left.torque[informative], variance)
        gram = gram + (used / variance[:, None]).T @ left.columns[informative]
        moving = lift.moving + bool(np.logical_and(usable, ~at_rest).any())
        return Lift(root, *solution(root), gram, lift.taken + 1, 0, moving, rested)

    def _faded(self, lift: Lift, columns: Array) -> tuple[Root, Array]:
        """Root and gram of the lift before it takes in rows with `columns` (K, 4): in long lifts a small share of the
        old information in these directions is forgotten. The estimate and its dependence on the tares do not change."""
        if lift.taken < self._long or not len(columns):
            return lift.root, lift.gram
        root = forget(lift.root, columns, 1.0 - 1.0 / self._long)
        return root, root.factor.T @ (root.factor @ (lift.covariance @ lift.gram))

    def _conclude(self, lift: Lift) -> Weight:
        """Mass and centre of the load. The standard error of the mass includes those of the tares and of the scale."""
        gain = lift.covariance[0] @ lift.gram
        mass = float(lift.values[0])
        variance = lift.covariance[0, 0] + gain @ self.tares.covariance @ gain + (mass * self.tares.scale_error) ** 2
        scale = mass if abs(mass) > 1.0 else 1.0
        centre = complex(lift.values[1], lift.values[2]) / scale
        along = np.array([[-centre.real, 1.0, 0.0, 0.0], [-centre.imag, 0.0, 1.0, 0.0]]) / scale
        error_x, error_z = np.sqrt(np.sum((along @ lift.covariance) * along, axis=1))
        return Weight(mass, float(np.sqrt(variance)), centre, (float(error_x), float(error_z)))

    def _plausible(self, weight: Weight) -> bool:
        """Whether the estimate can be a load: its mass is positive and its centre within reach; or, for a mass near
        zero, its first moment is near zero, too."""
        rated, reach = self.model.machine.rated_payload, self.model.machine.payload_reach
        if abs(weight.mass) < max(SMALLEST * rated, 3.0 * weight.standard_error):
            moment = abs(weight.centre * weight.mass)
            return moment < (SMALLEST * rated + 3.0 * weight.standard_error) * reach
        return weight.mass > 0.0 and abs(weight.centre) < FARTHEST * reach

    def _judge(self, lift: Lift, weight: Weight) -> Load:
        doubt = self._doubt(lift, weight)
        if doubt is not None:
            return invalid_load(doubt)
        status, reason = self._trust(lift, weight)
        mass = Quantity(weight.mass, weight.standard_error, status, reason)
        if weight.mass < SMALLEST * self.model.machine.rated_payload:
            return Load(mass, invalid(Reason.NOT_A_LOAD), invalid(Reason.NOT_A_LOAD))
        (x, z), (error_x, error_z) = (weight.centre.real, weight.centre.imag), weight.centre_error
        return Load(mass, Quantity(x, error_x, status, reason), Quantity(z, error_z, status, reason))

    def _trust(self, lift: Lift, weight: Weight) -> tuple[Status, Reason]:
        if weight.standard_error > GOOD_ENOUGH * self.model.machine.rated_payload:
            return Status.DEGRADED, Reason.UNCERTAIN if lift.moving else Reason.AT_REST
        if not self.tares.identified:
            return Status.DEGRADED, Reason.NOT_IDENTIFIED
        return Status.OK, Reason.NONE

    def _doubt(self, lift: Lift, weight: Weight) -> Reason | None:
        """The reason why there is no weight, or None."""
        if lift.refused:
            return Reason.IN_CONTACT
        if lift.taken < MIN_SECONDS * self.model.filters.rate_hz:
            return Reason.STARTING
        if not self._plausible(weight):
            return Reason.NOT_A_LOAD
        return Reason.UNCERTAIN if weight.standard_error >= self.model.machine.rated_payload else None

    def _note(self, state: Weighing, weight: Weight, t_us: int) -> Weighing:
        """The state with the candidate updated to the weight based on most samples in motion, and booked once the
        bucket is empty again."""
        rated = self.model.machine.rated_payload
        if self._doubt(state.lift, weight) is not None or weight.standard_error > GOOD_ENOUGH * rated:
            return state
        if weight.mass < SMALLEST * rated:
            return self._book(state, t_us, weight.mass)
        best = state.candidate
        if best is None or state.lift.moving >= best.moving:
            found = Candidate(weight.mass, weight.standard_error, state.lift.moving)
            return state._replace(candidate=found)
        return state

    def _book(self, state: Weighing, t_us: int, left: float) -> Weighing:
        if state.candidate is None:
            return state
        number = 1 if state.booking is None else state.booking.number + 1
        best = state.candidate
        return Weighing(state.lift, None, Booking(number, t_us, best.mass, best.standard_error, left))
