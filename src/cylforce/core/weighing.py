"""Weighing while moving: the load's mass, first moments and inertia by recursive least squares on top of the fixed tares
(PHYSICS sections 9 and 10), restarted whenever the forces no longer look like one hanging load."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cylforce.core.model import Model, Tares
from cylforce.regression.recursive import Root, known, solution, update
from cylforce.regression.regressor import Rows
from cylforce.words.estimate import Array, Booking, Quantity, Reason, Status, invalid

GATE = 9.0  # mean squared normalised innovation per row above which a sample does not belong to the load
PATIENCE_S = 0.3  # a lift ends when samples have not belonged to it for so long
MIN_SECONDS = 1.0  # of consistent samples before a weight is shown
GOOD_ENOUGH = 0.01  # standard error, as a share of rated payload, to be shown as OK and to be booked
SMALLEST = 0.05  # share of rated payload below which the bucket counts as empty
FARTHEST = 1.5  # times the declared reach of the load's centre: farther out no material can lie
RELATIVE = 0.01  # what the model leaves unexplained grows with the load: friction, elasticity
REST_SECONDS = 10.0  # friction at rest does not average out: it counts as if it lasted so long


class Residual(NamedTuple):
    """What the tares do not explain: `torque` (R,) [N m] and its `variance` (R,); `columns` (R, P) of the tares; `rest`
    (R,): variance of the friction that is unknown at rest."""

    torque: Array
    variance: Array
    rest: Array
    columns: Array


def residual(model: Model, tares: Tares, rows: Rows) -> Residual:
    """r = torque - W Phi of one instant, and how well it is known."""
    size = len(model.parameters)
    columns = rows.columns[..., :size]
    torque = rows.torque - columns @ tares.values
    coulomb = np.abs(tares.values[_coulomb(model)])
    rest = (rows.columns[..., model.at_rest] @ coulomb) ** 2 if coulomb.size else np.zeros_like(torque)
    return Residual(torque, tares.row_error**2 + (RELATIVE * torque) ** 2, rest, columns)


def _coulomb(model: Model) -> list[int]:
    return [k for k, p in enumerate(model.parameters) if p.name.endswith(".coulomb")]


class Lift(NamedTuple):
    """A load in the making: the recursive estimate of (m, m x, m z, J) as its `root`, `values` (4,) and `covariance`
    (4, 4), its sensitivity to the tares `gram` (4, P), samples taken in, samples refused in a row, samples in motion."""

    root: Root
    values: Array
    covariance: Array
    gram: Array
    taken: int
    refused: int
    moving: int


class Candidate(NamedTuple):
    """The best weight of the current lift: mass, standard error, how many samples it rests on."""

    mass: float
    standard_error: float
    samples: int


class Weighing(NamedTuple):
    """State: the lift, the candidate for booking, what was booked last."""

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
        """Samples that say the same: the filters' correlation length."""
        f = self.model.filters
        return max(1.0, f.rate_hz / (np.pi * min(f.smoothing_hz, f.regressor_hz)))

    @cached_property
    def _fresh(self) -> Lift:
        machine = self.model.machine
        moment = machine.rated_payload * machine.payload_reach
        spread = np.array([2.0 * machine.rated_payload, moment, moment, moment * machine.payload_reach])
        root = known(np.zeros(4), spread)
        return Lift(root, *solution(root), np.zeros((4, len(self.model.parameters))), 0, 0, 0)

    def begin(self) -> Weighing:
        """Nothing in the bucket is known yet."""
        return Weighing(self._fresh, None, None)

    def interrupt(self, state: Weighing) -> Weighing:
        """The measurement stopped: the lift starts anew, what was found stays."""
        return state._replace(lift=self._fresh)

    def step(self, state: Weighing, left: Residual, usable: Array, t_us: int) -> tuple[Weighing, Quantity]:
        """Take one instant in; `usable` (R,) rows. Returns the gross weight, not yet zeroed."""
        lift = self._advance(state.lift, left, usable)
        if lift.refused > PATIENCE_S * self.model.filters.rate_hz:
            lift = self._fresh  # what the lift showed stays a candidate until the bucket is seen empty
        mass, spread, centre = self._conclude(lift)
        state = self._note(state._replace(lift=lift), mass, spread, centre, t_us)
        return state, self._judge(lift, mass, spread, centre)

    def _advance(self, lift: Lift, left: Residual, usable: Array) -> Lift:
        columns = left.columns @ self.model.load
        expected = columns @ lift.values
        variance = np.sum((columns @ lift.covariance) * columns, axis=1) + left.variance + left.rest
        innovation = (left.torque - expected) ** 2 / variance
        if not np.any(usable) or np.mean(innovation[usable]) > GATE:
            return lift._replace(refused=lift.refused + 1)
        variance = self._memory * left.variance + REST_SECONDS * self.model.filters.rate_hz * left.rest
        variance = np.where(usable, variance, np.inf)
        root = update(lift.root, columns, left.torque, variance)
        gram = lift.gram + (columns / variance[:, None]).T @ left.columns
        moving = lift.moving + bool(np.any(left.rest[usable] < left.variance[usable]))
        return Lift(root, *solution(root), gram, lift.taken + 1, 0, moving)

    def _conclude(self, lift: Lift) -> tuple[float, float, complex]:
        """Mass, its standard error (with that of the tares), centre of the load in the last link's frame."""
        theta, spread = lift.values, lift.covariance
        gain = spread[0] @ lift.gram
        variance = spread[0, 0] + gain @ self.tares.covariance @ gain
        mass = float(theta[0])
        return mass, float(np.sqrt(variance)), complex(theta[1], theta[2]) / (mass if abs(mass) > 1.0 else 1.0)

    def _plausible(self, mass: float, spread: float, centre: complex) -> bool:
        """No hanging load pulls upwards or has its centre outside the tool."""
        rated, reach = self.model.machine.rated_payload, self.model.machine.payload_reach
        if abs(mass) < max(SMALLEST * rated, 3.0 * spread):
            return abs(centre * mass) < SMALLEST * rated * reach + 3.0 * spread * reach
        return mass > 0.0 and abs(centre) < FARTHEST * reach

    def _judge(self, lift: Lift, mass: float, spread: float, centre: complex) -> Quantity:
        rated = self.model.machine.rated_payload
        if lift.refused:
            return invalid(Reason.IN_CONTACT)
        if lift.taken < MIN_SECONDS * self.model.filters.rate_hz:
            return invalid(Reason.STARTING)
        if not self._plausible(mass, spread, centre):
            return invalid(Reason.NOT_A_LOAD)
        if spread >= rated:
            return invalid(Reason.UNCERTAIN)
        if spread > GOOD_ENOUGH * rated:
            return Quantity(mass, spread, Status.DEGRADED, Reason.AT_REST if not lift.moving else Reason.UNCERTAIN)
        if not self.tares.identified:
            return Quantity(mass, spread, Status.DEGRADED, Reason.NOT_IDENTIFIED)
        return Quantity(mass, spread, Status.OK, Reason.NONE)

    def _note(self, state: Weighing, mass: float, spread: float, centre: complex, t_us: int) -> Weighing:
        """Remember the weight that rests on most samples; book it once the bucket is empty again."""
        lift, rated = state.lift, self.model.machine.rated_payload
        enough = lift.taken >= MIN_SECONDS * self.model.filters.rate_hz and spread < GOOD_ENOUGH * rated
        if lift.refused or not enough or not self._plausible(mass, spread, centre):
            return state
        if mass < SMALLEST * rated:
            return self._book(state, t_us)
        held = state.candidate
        if held is None or lift.moving >= held.samples:
            return state._replace(candidate=Candidate(mass, spread, lift.moving))
        return state

    def _book(self, state: Weighing, t_us: int) -> Weighing:
        if state.candidate is None:
            return state
        number = 1 if state.booking is None else state.booking.number + 1
        best = state.candidate
        return Weighing(state.lift, None, Booking(number, t_us, best.mass, best.standard_error))
