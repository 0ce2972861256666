"""Weighing while moving: the load's mass, first moments and inertia by recursive least squares on top of the fixed
tares (mechanics/README.md, sections 9 and 10). It restarts when the torques do not fit one hanging load any more."""

from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from math import sqrt
from typing import Self

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.layout import ConclusionLayout, GateLayout, part
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO, Limits, solver
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.recursive import forget, update
from cylforce.estimation.residual import (
    EMPTY_BELOW,
    GOOD_ENOUGH,
    MIN_SECONDS,
    REST_SECONDS,
    Residual,
    correlated_samples,
    load_spread,
)
from cylforce.service.adaptation import DriftKnowledge, no_drift
from cylforce.service.loading.lift import Lift, SpillCheck, Weight, lift_numbers
from cylforce.service.residual import InstantResidual, residual_of, residual_of_arrays
from cylforce.service.snapshot import Constants, Estimator
from cylforce.service.spill import EVERY_S, KEPT, block_diagonal, changed_at, information
from cylforce.signals.estimate import Array, Load, Quantity, Reason, Status, degraded, invalid, invalid_load

GATE = 9.0  # mean squared innovation in standard errors (3 squared), above which a sample does not fit the load; chosen
BREAK_AWAY = 3.0  # times the unknown friction at rest: break-away friction, for which the gate allows; chosen
COLD = 5.0  # times the expected drift, for which the gate allows: oil of 0 instead of 40 degC; chosen
DRIFTED = 4.0  # times a row's variance: most that the gate adds for unknown drift; chosen: twice the row's error
PATIENCE_S = 0.3  # s of samples that do not fit, after which a lift ends; chosen
EMPTY = 0.03  # times the rated payload: below it the bucket counts as empty for the adaptation; chosen
FARTHEST = 1.5  # times the payload's reach: largest plausible distance of the load's centre from the last pin; chosen
FORGET_SECONDS = 30.0  # s after which old samples of a lift have faded to 1/e; chosen

NO_LOAD = invalid(Reason.NOT_A_LOAD)


class LoadConstants(Constants):
    """Constants of the weighing of one machine.

    model:           of the machine
    tares:           of the machine: identified parameters of the empty machine
    kernel:          form of the kernel, compiled or interpreted
    solver:          the kernel's constants of these tares and of the limits of the gate
    gate:            names of the places in the intermediate results of an instant
    conclusion:      names of the places in the conclusion from a lift
    memory:          number of consecutive samples that count as one independent sample
    fading_samples:  number of samples after which older ones begin to fade
    refused_samples: number of samples in a row that do not fit, after which a lift ends
    settled_samples: number of samples before a weight is shown
    spill_samples:   number of samples between two examinations for a spill
    rated:           rated payload [kg]
    reach:           of the payload from the last pin [m]
    rows:            R, number of measured torques
    drifts:          D, number of adapted frictions and zeros
    parameters:      P, number of tares
    settle_steps:    number of steps until the filters have settled
    load_errors:     (4,) prior standard errors of a load (m, m x, m z, J) [kg, kg m, kg m, kg m^2]
    no_information:  (4, 5 + P + D) information of a lift without samples, that of the prior: matrix, right-hand side
                     and gram
    """

    def __init__(self, model: Model, tares: Tares, kernel: Kernel | None = None) -> None:
        """Compute the constants of the weighing: times become numbers of samples, the solver gets the gate's limits.

        The gate is the test whether a sample fits one hanging load.

        model:  of the machine
        tares:  identified parameters of the empty machine
        kernel: form of the kernel; None: the compiled one if there is one
        """
        rate_hz = model.filters.rate_hz
        self.model, self.tares, self.kernel = model, tares, kernel or choice.chosen()
        self.memory = correlated_samples(model.filters, tares.correlation)
        self.fading_samples = FORGET_SECONDS * rate_hz
        self.refused_samples = PATIENCE_S * rate_hz
        self.settled_samples = MIN_SECONDS * rate_hz
        self.spill_samples = round(EVERY_S * rate_hz)
        self.rated, self.reach = model.machine.rated_payload, model.machine.payload_reach
        limits = Limits(
            gate=GATE,
            break_away=BREAK_AWAY,
            cold=COLD,
            drifted=DRIFTED,
            memory=self.memory,
            longest_rest=REST_SECONDS * rate_hz,
        )
        self.solver = solver(model, tares, self.kernel, limits)
        self.rows, self.drifts = len(model.machine.rows), len(model.changing)
        self.parameters, self.settle_steps = len(model.parameters), model.settle_steps
        self.gate, self.conclusion = GateLayout(self.rows), ConclusionLayout(self.parameters, self.drifts)
        self.load_errors = load_spread(model.machine)
        self.no_information = self.new_lift().marks[0]

    def new_lift(self, *, mixed: bool = False) -> Lift:
        """Return a lift without samples; `mixed`: whether the filters still contain another motion."""
        return Lift.start(self.load_errors, self.parameters + self.drifts, self.rows, mixed=mixed)

    def is_empty(self, load: Load) -> bool:
        """Return whether the bucket is known to be empty and in the air; False for a load without a value."""
        return abs(load.mass.value) < EMPTY * self.rated

    def residual(self, rows: Numbers, drift: Array) -> InstantResidual:
        """Return the residual torque of the rows of an instant after tares and `drift` (D,)."""
        return residual_of(self.kernel, self.solver, rows, drift, self.rows)

    def residual_of_arrays(self, residual: Residual) -> InstantResidual:
        """Return the residual of an instant of a recording, without drift."""
        return residual_of_arrays(residual, len(self.model.filtered.regressor.names), self.drifts)


class LiftEvent(IntEnum):
    """Effect of an instant on the lift: it goes on, it has ended, or its load has changed in the air."""

    GOES_ON = 0
    ENDED = 1
    CHANGED = 2


@dataclass(slots=True)
class LoadEstimator(Estimator):
    """Recursive least squares of the hanging load.

    constants: of the machine
    lift:      present lift
    event:     effect of the last instant on the lift
    """

    constants: LoadConstants
    lift: Lift
    event: LiftEvent = LiftEvent.GOES_ON

    @classmethod
    def start(cls, constants: LoadConstants) -> Self:
        """Return the state before any sample."""
        return cls(constants, constants.new_lift())

    def interrupt(self) -> None:
        """Begin a new lift after an interruption of the measurement."""
        self.lift = self.constants.new_lift()

    def update(
        self,
        residual: InstantResidual,
        usable: Numbers,
        drift: DriftKnowledge | None = None,
        tilt: float | None = None,
    ) -> Weight:
        """Update the lift with one instant, and return the weight: mass [kg] and centre [m] of the load, with errors.

        A sample that does not fit one hanging load is not used. After too many of them in a row the lift ends. A change
        of the load in the air (spill) begins the lift anew. `event` is the effect of the instant on the lift.

        residual: measured joint torques less those of the empty machine (tares) and the drift [N m]
        usable:   (R,) 1 where the row of a measured joint torque can be used, else 0
        drift:    that is subtracted in the residual; None: friction and zeros are those of the tares
        tilt:     angle of the tool to the house [rad]; None where the tool does not empty by tilting
        """
        drift = no_drift(self.constants.drifts) if drift is None else drift
        place = self.constants.gate
        work, concluded = ZERO * place.size, ZERO * self.constants.conclusion.size
        lift, taken, self.event = self.lift, self.lift.taken, LiftEvent.GOES_ON
        fits = self._take(residual, usable, drift, work, concluded)
        if fits:
            self._advance(work[place.rested], in_motion=fits > 1, drift=drift, tilt=tilt)
            if self.lift.taken < taken:
                self.event = LiftEvent.CHANGED
        else:
            lift.refused += 1
            if lift.refused > self.constants.refused_samples:
                self.lift = self.constants.new_lift(mixed=True)
                self.event = LiftEvent.ENDED
        return self._weight(concluded) if self.lift is lift else self.conclude(drift)

    def _take(
        self, residual: InstantResidual, usable: Numbers, drift: DriftKnowledge, work: Numbers, concluded: Numbers
    ) -> int:
        """Add an instant to the lift if it fits; return 0 if it does not fit, 1 if it does, 2 if a row also moves.

        In a lift of more than `fading_samples` a share of the old information is forgotten first.

        residual:  measured joint torques less those of the empty machine (tares) and the drift [N m]
        usable:    (R,) 1 where the row of a measured joint torque can be used, else 0
        drift:     that is subtracted in the residual
        work:      written: intermediate results (`GateLayout`)
        concluded: written: mass and centre of the load and their errors (`ConclusionLayout`)
        """
        c, lift = self.constants, self.lift
        instant = (residual.rows, residual.numbers, residual.wider, usable, lift.rested)
        known = (drift.values, drift.covariance)
        if lift.taken < c.fading_samples:
            return c.kernel.weigh_load(c.solver, *instant, *known, work, lift.numbers, concluded)
        fits = c.kernel.gate(c.solver, *instant, *known, work, lift.numbers)
        if fits:
            self._fade(work)
            c.kernel.take(c.solver, residual.rows, residual.numbers, work, lift.numbers)
        c.kernel.conclude(c.solver, lift.numbers, *known, concluded)
        return fits

    def _advance(self, rested: Numbers, *, in_motion: bool, drift: DriftKnowledge, tilt: float | None) -> None:
        """Count a sample that fits the load, and examine the lift for a spill from time to time.

        A lift that began while the filters contained another motion (`mixed`) is estimated anew once they have settled.

        rested:    (R,) number of samples for which each row has been at rest, after this sample
        in_motion: whether a row moves
        drift:     of friction and zeros
        tilt:      angle of the tool to the house [rad]; None where the tool does not empty by tilting
        """
        c, lift = self.constants, self.lift
        lift.rested = rested
        if lift.mixed and lift.taken + 1 == c.settle_steps:
            # samples from before the filters had settled are discarded, but count for the length of the lift
            self.lift = c.new_lift()
            self.lift.taken, self.lift.rested = lift.taken + 1, rested
            return
        lift.taken += 1
        lift.refused = 0
        lift.moving += in_motion
        if lift.taken % c.spill_samples == 0 and lift.taken <= c.fading_samples:
            self._check_spill(drift, tilt)

    def _check_spill(self, drift: DriftKnowledge, tilt: float | None) -> None:
        """Examine the lift for a spill or an addition of load; if there is one, the lift begins anew after it.

        Otherwise the examination is stored, so that later ones are compared with it. A lift without a load is not
        compared.

        drift: of friction and zeros, whose error counts in the comparison
        tilt:  angle of the tool to the house [rad]; None where the tool does not empty by tilting
        """
        c, lift = self.constants, self.lift
        now, last = information(lift.root, lift.gram), SpillCheck(lift.moving, tilt)
        if lift.values[0] > EMPTY_BELOW * c.rated:
            covariance = block_diagonal(c.tares.covariance, drift.covariance)
            at = changed_at(lift.marks, now, covariance, GOOD_ENOUGH * c.rated)
            if at is not None:
                self.lift = lift.since(at, now, last, c.spill_samples, c.no_information)
                return
        lift.keep_check(now, last, KEPT)

    def _fade(self, work: Numbers) -> None:
        """Fade a small share of the old information of a long lift, in the directions that the present sample measures.

        The estimate and its dependence on the tares (identified parameters) do not change.

        work: intermediate results of the sample (`GateLayout`), of which the columns (R, 4) of the load and the marks
              of the rows that are used are read
        """
        lift, place = self.lift, self.constants.gate
        columns = part(work, place.columns).reshape(-1, 4)[part(work, place.taken) > 0.0]
        if not len(columns):
            return
        root = forget(lift.root, columns, 1.0 - 1.0 / self.constants.fading_samples)
        gram = root.factor.T @ (root.factor @ (lift.covariance @ lift.gram))
        root = update(root, columns[:0], columns[:0, 0], columns[:0, 0])  # a triangle again
        lift.numbers = lift_numbers(root, gram, (lift.values, lift.covariance))

    def conclude(self, drift: DriftKnowledge) -> Weight:
        """Return mass [kg] and centre [m] of the load from the present lift, corrected by the drift.

        The standard error of the mass contains those of noise, identified parameters (tares), drift and scale; the
        standard errors of the centre contain that of noise only.

        drift: of friction and zeros, with its covariance
        """
        c, concluded = self.constants, ZERO * self.constants.conclusion.size
        c.kernel.conclude(c.solver, self.lift.numbers, drift.values, drift.covariance, concluded)
        return self._weight(concluded)

    def _weight(self, concluded: Numbers) -> Weight:
        """Return mass [kg] and centre [m] of the load with their errors, from the kernel's array `concluded`."""
        place = self.constants.conclusion
        return Weight(
            mass=concluded[place.mass],
            standard_error=concluded[place.error],
            centre=complex(concluded[place.x], concluded[place.z]),
            centre_error=(concluded[place.x_error], concluded[place.z_error]),
            drifted=concluded[place.drifted],
        )

    def is_plausible(self, weight: Weight) -> bool:
        """Return whether the estimate can be a load: its mass must be positive and its centre within reach.

        For a mass near zero, of either sign (an empty bucket), the first moment [kg m] must be near zero, too.

        weight: mass [kg] and centre [m] of the load, with standard errors
        """
        rated, reach = self.constants.rated, self.constants.reach
        if abs(weight.mass) < max(EMPTY_BELOW * rated, 3.0 * weight.standard_error):
            moment = abs(weight.centre * weight.mass)
            return moment < (EMPTY_BELOW * rated + 3.0 * weight.standard_error) * reach + COLD * weight.drifted
        return weight.mass > 0.0 and abs(weight.centre) < FARTHEST * reach

    def is_light(self, weight: Weight) -> bool:
        """Return whether the weight is below that of a load."""
        return weight.mass < EMPTY_BELOW * self.constants.rated

    def refusal(self, weight: Weight) -> Reason | None:
        """Return the reason why the present weight is not valid; None: it is.

        IN_CONTACT: the last samples do not fit the load; STARTING: too few samples; NOT_A_LOAD: no load can have this
        mass and centre; UNCERTAIN: the standard error is the rated payload or more."""
        if self.lift.refused:
            return Reason.IN_CONTACT
        if self.lift.taken < self.constants.settled_samples:
            return Reason.STARTING
        if not self.is_plausible(weight):
            return Reason.NOT_A_LOAD
        return Reason.UNCERTAIN if weight.standard_error >= self.constants.rated else None

    def load(self, weight: Weight, *, curled: bool = True) -> Load:
        """Return the load before zero and tare as it is published: mass [kg] and centre x, z [m], with their status.

        It is INVALID if there is no valid weight (`refusal`). The centre of a weight that is lighter than a load is
        INVALID (NOT_A_LOAD).

        weight: of the lift
        curled: whether the bucket is curled far enough; otherwise a load that is OK becomes DEGRADED (NOT_CURLED). An
                empty bucket need not be curled
        """
        if (refusal := self.refusal(weight)) is not None:
            return invalid_load(refusal)
        status, reason = self._trust(weight)
        mass = Quantity(weight.mass, weight.standard_error, status, reason)
        if self.is_light(weight):
            return Load(mass, NO_LOAD, NO_LOAD)
        centre, (error_x, error_z) = weight.centre, weight.centre_error
        centre_x = Quantity(centre.real, error_x, status, reason)
        load = Load(mass, centre_x, Quantity(centre.imag, error_z, status, reason))
        return load if curled else load.changed(partial(degraded, reason=Reason.NOT_CURLED))

    def _trust(self, weight: Weight) -> tuple[Status, Reason]:
        """Return status and reason of a weight that can be a load: OK or DEGRADED.

        It is DEGRADED if its standard error exceeds GOOD_ENOUGH rated payloads (UNCERTAIN; in a lift without motion
        AT_REST, because of friction at rest), or if the tares are those of the data sheet (NOT_IDENTIFIED); otherwise
        OK."""
        if weight.standard_error > GOOD_ENOUGH * self.constants.rated:
            return Status.DEGRADED, Reason.UNCERTAIN if self.lift.moving else Reason.AT_REST
        if not self.constants.tares.identified:
            return Status.DEGRADED, Reason.NOT_IDENTIFIED
        return Status.OK, Reason.NONE

    @property
    def noise(self) -> float:
        """Standard error of the mass by noise alone [kg]."""
        return sqrt(self.lift.covariance[0, 0])
