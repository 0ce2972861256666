"""Weighing while moving: the load's mass, first moments and inertia by recursive least squares on top of the fixed
tares (mechanics/README.md, sections 9 and 10), restarted whenever the forces no longer look like one hanging load."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO, Limits, solver
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.recursive import forget, known, solution, update
from cylforce.estimation.residual import (
    GOOD_ENOUGH,
    MIN_SECONDS,
    REST_SECONDS,
    SMALLEST,
    Residual,
    correlated,
    load_spread,
)
from cylforce.service.adaptation import Adapter, Drift
from cylforce.service.booking import Beside, Books, Weighed, noted, parted, spilled, unseen
from cylforce.service.loading.lift import Lift, Look, Weight, kept, looked, shortened
from cylforce.service.loading.tool import NOT_CHECKED, ToolCheck, checked
from cylforce.service.pipeline import Unexplained, unexplained
from cylforce.service.spill import EVERY_S, KEPT, changed_at, information, side_by_side
from cylforce.signals.estimate import Load, Quantity, Reason, Status, degraded, invalid, invalid_load
from cylforce.signals.quick import new, once

GATE = 9.0  # mean squared innovation in standard errors (3 squared), above which a sample does not fit the load; chosen
BREAK_AWAY = 3.0  # times the unknown friction at rest: break-away friction, for which the gate allows; chosen
COLD = 5.0  # times the expected drift, for which the gate allows: oil of 0 instead of 40 degC; chosen
DRIFTED = 4.0  # times its variance, by which the gate at most allows for a drift not known yet; chosen: twice its error
PATIENCE_S = 0.3  # s of samples that do not fit, after which a lift ends; chosen
EMPTY = 0.03  # times the rated payload: below it the bucket counts as empty for the adaptation; chosen
FARTHEST = 1.5  # times the payload's reach: largest plausible distance of the load's centre from the last pin; chosen
FORGET_SECONDS = 30.0  # s after which old samples of a lift have faded to 1/e; chosen
REFILL_S = 3.0  # s without a measurement in which a bucket may have been emptied and filled again; chosen
# s for which a lift must go on before a weight of it is booked: as long as it takes to end one (PATIENCE_S)
LATER_S = 0.3

NO_LOAD = invalid(Reason.NOT_A_LOAD)


class Weighing(NamedTuple):
    """State of the weighing: the present lift, what is to be booked or was booked last, when something was measured
    last [us] (None: not yet), and whether the tool is the one that was chosen."""

    lift: Lift
    books: Books
    seen_us: int | None = None
    tool: ToolCheck = NOT_CHECKED


@dataclass(frozen=True)
class Weigher:
    """The weighing of one machine."""

    model: Model
    tares: Tares
    kernel: Any = field(default_factory=lambda: choice.chosen())  # noqa: PLW0108 - asked when it is made

    @once
    def _solver(self) -> Any:  # noqa: ANN401 - the compiled or the interpreted class
        patience = REST_SECONDS * self.model.filters.rate_hz
        limits = Limits(GATE, BREAK_AWAY, COLD, DRIFTED, self._memory, patience)
        return solver(self.model, self.tares, self.kernel, limits)

    @once
    def _memory(self) -> float:
        """Number of consecutive samples that count as one independent sample."""
        return correlated(self.model.filters, self.tares.correlation)

    @once
    def _long(self) -> float:
        """Number of samples after which older ones begin to fade."""
        return FORGET_SECONDS * self.model.filters.rate_hz

    @once
    def _patience(self) -> float:
        """Number of samples that do not fit, after which a lift ends."""
        return PATIENCE_S * self.model.filters.rate_hz

    @once
    def _settled(self) -> float:
        """Number of samples before a weight is shown."""
        return MIN_SECONDS * self.model.filters.rate_hz

    @once
    def _looks(self) -> tuple[int, int]:
        """Samples between two looks for a spill, and for a booking."""
        return round(EVERY_S * self.model.filters.rate_hz), round(LATER_S * self.model.filters.rate_hz)

    @once
    def _fresh(self) -> Lift:
        machine = self.model.machine
        root = known(np.zeros(4), load_spread(machine))
        nothing = np.zeros((4, len(self.model.parameters) + len(self._still.values)))
        rested, marks = ZERO * len(machine.rows), information(root, nothing)[None]
        return Lift(kept(root, *solution(root), nothing), 0, 0, 0, rested, marks, (Look(0, None),), mixed=False)

    @property
    def _again(self) -> Lift:
        """A lift that follows another motion."""
        return self._fresh._replace(mixed=True)

    @once
    def _still(self) -> Drift:
        """A drift that is known to be zero."""
        begun = Adapter(self.model, self.tares).begin()
        return begun._replace(covariance=np.zeros_like(begun.covariance))

    def begin(self) -> Weighing:
        """The state before any sample."""
        return Weighing(self._fresh, Books())

    def interrupt(self, state: Weighing) -> Weighing:
        """The state after an interruption of the measurement: a new lift. The candidate remains if the interruption
        proves to be a short one."""
        return state._replace(lift=self._fresh, books=parted(state.books))

    def step(
        self,
        state: Weighing,
        left: Unexplained,
        usable: Numbers,
        t_us: int,
        drift: Drift | None = None,
        *,
        curled: bool = True,
        beside: Callable[[], Beside] = Beside,
    ) -> tuple[Weighing, Load]:
        """The state and the load (before zero and tare) after one instant: what is `left`, `usable` (R,) rows, time
        [us]; the `drift`, which is already subtracted from what is left. Without it friction and zeros are those of
        the tares. A load is noted for booking while the bucket is `curled`, with what is then `beside` it."""
        if state.seen_us is not None and not 0 <= t_us - state.seen_us <= 1e6 * REFILL_S:
            state = state._replace(books=unseen(state.books))
        drift = self._still if drift is None else drift
        lift, (concluded, found) = self._advance(state.lift, left, usable, drift, beside)
        books = state.books
        if lift.refused > self._patience:
            lift, books = self._again, parted(books)  # the candidate remains until the bucket is seen empty
        elif lift.taken < state.lift.taken:
            books = spilled(books)
        weight = self._weight(found) if lift.kept is concluded else self._conclude(lift, drift)
        state = new(Weighing, (lift, books, t_us, state.tool))
        load = self._judge(lift, weight)
        if not curled and weight.mass >= SMALLEST * self.model.machine.rated_payload:
            return state, Load(*(degraded(q, Reason.NOT_CURLED) for q in load))
        return self._note(state, weight, t_us, drift, beside), load

    def is_empty(self, load: Load) -> bool:
        """Whether the bucket is known to be empty and in the air: a load without a value is no empty bucket."""
        return abs(load.mass.value) < EMPTY * self.model.machine.rated_payload

    def left(self, rows: Numbers, drift: Drift) -> Unexplained:
        """The torque that tares and drift do not explain of the rows of an instant."""
        nothing = self._fresh.rested
        found = ZERO * ((3 + len(drift.values)) * len(nothing))
        self.kernel.explain(self._solver, rows, drift.values, found)
        return new(Unexplained, (rows, found, nothing))

    def of_arrays(self, left: Residual) -> Unexplained:
        """What is left of an instant of a recording, without drift."""
        return unexplained(left, len(self.model.filtered.regressor.names), len(self._still.values))

    def _advance(
        self, lift: Lift, left: Unexplained, usable: Numbers, drift: Drift, beside: Callable[[], Beside]
    ) -> tuple[Lift, tuple[Numbers, Numbers]]:
        """The lift after one instant; numbers of a lift, and what the kernel concludes from these."""
        rows, work, found = len(usable), ZERO * (8 * len(usable)), ZERO * self._concluded
        seen = (*left, usable, lift.rested, drift.values, drift.covariance, work)
        if lift.taken < self._long:
            numbers = lift.kept[:]
            fits = self.kernel.weigh_load(self._solver, *seen, numbers, found)
        else:
            fits = self.kernel.gate(self._solver, *seen, lift.kept)
            numbers = self._faded(lift, work) if fits else lift.kept
            if fits:
                self.kernel.take(self._solver, left.rows, left.kept, work, numbers)
            self.kernel.conclude(self._solver, numbers, drift.values, drift.covariance, found)
        if not fits:
            lift = new(Lift, (numbers, lift.taken, lift.refused + 1) + lift[3:])  # noqa: RUF005 - quicker
            return lift, (numbers, found)
        rested = work[7 * rows :]
        if lift.mixed and lift.taken + 1 == self.model.settle_steps:
            return self._fresh._replace(taken=lift.taken + 1, rested=rested), (numbers, found)
        moving = lift.moving + (fits > 1)
        lift = new(Lift, (numbers, lift.taken + 1, 0, moving, rested, *lift[5:]))
        return self._watched(lift, drift, beside), (numbers, found)

    @once
    def _concluded(self) -> int:
        """How many numbers the kernel concludes from a lift."""
        return 7 + len(self.model.parameters) + len(self._still.values)

    def _watched(self, lift: Lift, drift: Drift, beside: Callable[[], Beside]) -> Lift:
        """The lift itself, or where a part of the load has fallen out or come in, that since then."""
        if lift.taken % self._looks[0] or lift.taken > self._long:
            return lift
        now, last = information(lift.root, lift.gram), Look(lift.moving, beside().tilt)
        rated = self.model.machine.rated_payload
        if lift.values[0] > SMALLEST * rated:
            covariance = side_by_side(self.tares.covariance, drift.covariance)
            at = changed_at(lift.marks, now, covariance, GOOD_ENOUGH * rated)
            if at is not None:
                return shortened(lift, self._fresh, at, now, last, self._looks[0])
        return looked(lift, now, last, KEPT)

    def _faded(self, lift: Lift, work: Numbers) -> Numbers:
        """The numbers of the lift before it takes in the rows of `work`: in long lifts a small share of the
        old information in their directions is forgotten. The estimate and its dependence on the tares do not change."""
        rows = np.frombuffer(work).reshape(8, -1)
        columns = rows[:4].reshape(-1, 4)[rows[6] > 0.0]
        if not len(columns):
            return lift.kept[:]
        root = forget(lift.root, columns, 1.0 - 1.0 / self._long)
        gram = root.factor.T @ (root.factor @ (lift.covariance @ lift.gram))
        root = update(root, columns[:0], columns[:0, 0], columns[:0, 0])  # a triangle again
        return kept(root, lift.values, lift.covariance, gram)

    def _weighed(self, lift: Lift, beside: Beside) -> Weighed:
        gain, noise = lift.covariance[0] @ lift.gram, float(lift.covariance[0, 0])
        size = len(self.model.parameters)
        mass, drifted = float(lift.values[0]), gain[size:]
        return Weighed(mass, noise, gain[:size], drifted, lift.moving, beside.tilt, beside.slopes, lift.tilt)

    def _conclude(self, lift: Lift, drift: Drift) -> Weight:
        """Mass and centre of the load. The standard error of the mass includes those of tares, drift and scale."""
        found = ZERO * self._concluded
        self.kernel.conclude(self._solver, lift.kept, drift.values, drift.covariance, found)
        return self._weight(found)

    def _weight(self, found: Numbers) -> Weight:
        """The same of what the kernel has concluded."""
        mass, wrong, x, z, error_x, error_z, drifted = found[:7]
        return new(Weight, (mass, wrong, complex(x, z), (error_x, error_z), drifted))

    def _plausible(self, weight: Weight) -> bool:
        """Whether the estimate can be a load: its mass is positive and its centre within reach; or, for a mass near
        zero, its first moment is near zero, too."""
        rated, reach = self.model.machine.rated_payload, self.model.machine.payload_reach
        if abs(weight.mass) < max(SMALLEST * rated, 3.0 * weight.standard_error):
            moment = abs(weight.centre * weight.mass)
            return moment < (SMALLEST * rated + 3.0 * weight.standard_error) * reach + COLD * weight.drifted
        return weight.mass > 0.0 and abs(weight.centre) < FARTHEST * reach

    def _judge(self, lift: Lift, weight: Weight) -> Load:
        if (doubt := self._doubt(lift, weight)) is not None:
            return invalid_load(doubt)
        status, reason = self._trust(lift, weight)
        mass = new(Quantity, (weight.mass, weight.standard_error, status, reason))
        if weight.mass < SMALLEST * self.model.machine.rated_payload:
            return new(Load, (mass, NO_LOAD, NO_LOAD))
        centre, (error_x, error_z) = weight.centre, weight.centre_error
        centre_x = new(Quantity, (centre.real, error_x, status, reason))
        return new(Load, (mass, centre_x, new(Quantity, (centre.imag, error_z, status, reason))))

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
        if lift.taken < self._settled:
            return Reason.STARTING
        if not self._plausible(weight):
            return Reason.NOT_A_LOAD
        return Reason.UNCERTAIN if weight.standard_error >= self.model.machine.rated_payload else None

    def _checked(self, check: ToolCheck, lift: Lift, weight: Weight) -> ToolCheck:
        """The check of the tool with the weight of a lift that goes on in motion."""
        limit, settled = SMALLEST * self.model.machine.rated_payload, self._settled
        noise = sqrt(lift.covariance[0, 0])
        if lift.refused or lift.moving < settled or noise > GOOD_ENOUGH * self.model.machine.rated_payload:
            return check
        certain = abs(weight.mass) > max(limit, 3.0 * weight.standard_error)
        plausible = self._plausible(weight)
        impossible = not plausible and (weight.mass < 0.0 or not certain)
        return checked(check, weight.mass, limit, empty=plausible and not certain, impossible=impossible)

    def _note(self, state: Weighing, weight: Weight, t_us: int, drift: Drift, beside: Callable[[], Beside]) -> Weighing:
        """The state with what is to be booked, looked at every LATER_S of a lift."""
        if state.lift.taken % self._looks[1]:
            return state
        state = state._replace(tool=self._checked(state.tool, state.lift, weight))
        if self._doubt(state.lift, weight) is not None:
            return state
        rated, seen = self.model.machine.rated_payload, self._weighed(state.lift, beside())
        return state._replace(books=noted(state.books, seen, rated, t_us, self.tares, drift))
