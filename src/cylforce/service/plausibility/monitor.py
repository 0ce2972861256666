"""Plausibility between sensors: what motion, other chamber, known arm and redundancy of torques say about each signal.

Views of the same samples: `changing` (each pressure by itself), angles that leapt, `driven` (forces against motion),
`offsets` (all joints against one load), `sweeping` (slewing against contact), and the weight of the empty bucket. The
surest objection is believed, of several the most specific one."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import hypot, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.residual import GOOD_ENOUGH, SMALLEST
from cylforce.mechanics.machine import FORCE_KINDS
from cylforce.service.adaptation import Drift
from cylforce.service.loading.lift import Lift
from cylforce.service.plausibility.blocks import BAR, EVERY, Block, Gatherer, Gathering, explained
from cylforce.service.plausibility.changing import NONE, Changes, Watching
from cylforce.service.plausibility.driven import Driven, Driving
from cylforce.service.plausibility.leaping import Leaping, Leaps
from cylforce.service.plausibility.offsets import HARMLESS, NO_OFFSET, VOTES, Offset, Voting
from cylforce.service.plausibility.placed import impossible
from cylforce.service.plausibility.returning import Returning
from cylforce.service.plausibility.reversing import Reversing, Turns
from cylforce.service.plausibility.samples import Samples
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorDoubt, SensorFault
from cylforce.service.plausibility.sweeping import Sweeping, Swept
from cylforce.service.plausibility.unnoticed import Noticing, Unnoticed
from cylforce.service.weighing import COLD, FARTHEST, LATER_S
from cylforce.signals.estimate import Array, Force, Quantity, Status
from cylforce.signals.kinds import Kind
from cylforce.signals.quick import new, once

FINE, REJECTED = Level.FINE, Level.REJECTED  # a member of an enumeration takes longer to look up than a name
NEVER = -1  # in place of a sample
BELOW = 3.0  # standard errors below nothing at which an empty bucket cannot be; machines in order: 2.2


class Watch(NamedTuple):
    """State: the running block, the blocks that vote and their `offset`; the pressures' changes; how far the tool was
    driven and swept; which signals leapt; what was wrong when the bucket was seen `empty` last, and from which sample
    of this lift on; what is suspected; when cylinders `turned` round; how many seconds in a row a load explained
    (`in_air`), since a signal was rejected."""

    gathering: Gathering
    blocks: Block
    offset: Offset
    changes: Changes
    driven: Driven
    unnoticed: Unnoticed
    swept: Swept = Swept()
    leapt: tuple[int, ...] = ()
    empty: SensorFault = SensorFault.NONE
    suspicion: SensorDoubt = NOTHING_SUSPECTED
    leaps: Leaps = Leaps()
    wrong_since: int = NEVER
    turned: Turns = Turns()
    in_air: int = 0

    @property
    def unsure(self) -> bool:
        """Whether there is some evidence, though too little for a doubt, that a signal is off by so much that a weight
        would be wrong; the force would be, too. Or whether it will be known soon."""
        seen_soon = self.wrong_since != NEVER or (self.suspicion is not NOTHING_SUSPECTED and self.suspicion.waits)
        return self.offset.unsure or seen_soon


@dataclass(frozen=True)
class Monitor:
    """The plausibility of one machine's signals."""

    model: Model
    tares: Tares
    rated_force: float

    @once
    def _gatherer(self) -> Gatherer:
        return Gatherer(self.model, self.tares)

    @once
    def _voting(self) -> Voting:
        return Voting(self._gatherer)

    @once
    def _noticing(self) -> Noticing:
        return Noticing(self._gatherer)

    @once
    def _watching(self) -> Watching:
        return Watching(self.model.machine)

    @once
    def _leaping(self) -> Leaping:
        return Leaping(self.model.machine, self.model.filters.rate_hz)

    @once
    def _reversing(self) -> Reversing:
        return Reversing(self.model, self.tares, self._leaping.steps_after)

    @once
    def _returning(self) -> Returning:
        return Returning(self._gatherer)

    @once
    def _driving(self) -> Driving:
        return Driving(self.model.machine, self.rated_force, EVERY / self.model.filters.rate_hz)

    @once
    def _sweeping(self) -> Sweeping:
        rate_hz = self.model.filters.rate_hz
        return Sweeping(self.model.machine, EVERY / rate_hz, rate_hz)

    def begin(self) -> Watch:
        """Nothing was seen, nothing is suspected."""
        blocks, changes = self._voting.begin(), self._watching.begin()
        gathering, driven, unnoticed = self._gatherer.begin(), self._driving.begin(), self._noticing.begin()
        return Watch(gathering, blocks, NO_OFFSET, changes, driven, unnoticed, turned=self._reversing.begin())

    def interrupt(self, state: Watch, *, frozen: bool = False, strayed: tuple[int, ...] = ()) -> Watch:
        """The measurement stopped: what was gathered in part is dropped, what is suspected stays. Votes that led to no
        doubt are dropped, too, when a signal was `frozen` meanwhile: that is what they were about. Signals that
        `strayed` from their range are doubted when they are back."""
        if frozen and state.suspicion.level is Level.FINE:
            state = state._replace(blocks=self._voting.begin(), offset=NO_OFFSET)
        gathering, changes = self._gatherer.interrupt(state.gathering), self._watching.interrupt(state.changes)
        swept = self._sweeping.ended(state.swept, explained=None)
        driven, unnoticed = self._driving.begin(), self._noticing.interrupt(state.unnoticed)
        state = state._replace(gathering=gathering, changes=changes, driven=driven, swept=swept, unnoticed=unnoticed)
        leaps = self._leaping.strayed(self._leaping.interrupt(state.leaps), strayed)
        return state._replace(leaps=leaps, turned=self._reversing.begin())

    def step(self, state: Watch, seen: Samples) -> Watch:
        """The state after one step."""
        now, before = self._watching.now(seen.values), state.changes
        changes = self._watching.step(before, now, seen.instant.speed)
        leaps, turned = self._leapt(state, now, seen)
        looked = seen.leapt != state.leapt or not (
            changes.constant is before.constant
            and changes.burst is before.burst
            and changes.below is before.below
            and (changes.noises is before.noises or changes.lost == before.lost)
            and leaps.doubt is state.leaps.doubt
        )
        gathering, blocks, offset, _, driven, unnoticed, swept, _, empty, suspicion, _, wrong_since, _, in_air = state
        own = (driven, unnoticed, swept, seen.leapt, empty, suspicion, leaps, wrong_since, turned, in_air)
        state = new(Watch, (gathering, blocks, offset, changes, *own))
        if seen.pipe.steps % EVERY == 0:
            told = state
            state = self._gathered(state, seen)
            looked = looked or self._says_more(told, state)
        return state._replace(suspicion=self._suspicion(state)) if looked else state

    def _says_more(self, before: Watch, state: Watch) -> bool:
        """Whether a sample may have changed what is suspected: something is, or the sample says something else."""
        nothing = before.suspicion is NOTHING_SUSPECTED and state.leaps.doubt is NOTHING_SUSPECTED
        same = state.offset is before.offset and state.empty is before.empty
        ways = (state.driven.path, state.swept.angle) == (before.driven.path, before.swept.angle)
        return not (nothing and same and ways)

    def _leapt(self, state: Watch, now: Numbers, seen: Samples) -> tuple[Leaps, Turns]:
        """Leaps of the pressures `now` (P,) but those of friction that turned round."""
        steps, turned = seen.pipe.steps, self._reversing.step(state.turned, seen.instant, seen.pipe.steps)
        came = self._watching.now(seen.came) if seen.came else NONE
        leaps = self._leaping.step(state.leaps, now, steps, came)
        doubt, known = leaps.doubt, state.leaps
        if doubt is known.doubt or doubt.cause is not SensorFault.STEPPED:
            return leaps, turned
        if self._reversing.explains(turned, steps, doubt, seen.instant.speed, seen.values, seen.drift):
            leaps = leaps._replace(doubt=known.doubt, since=known.since, votes=known.votes)
        return leaps, turned

    def _gathered(self, state: Watch, seen: Samples) -> Watch:
        smooth = seen.pipe.smooth
        (resultant, soil), velocity = seen.forces, seen.instant.velocity
        beside = soil if seen.weighed else None
        driven = self._driving.step(state.driven, resultant, velocity, seen.left, beside)
        middle = seen.pipe.middle
        gathering, block = self._gatherer.step(state.gathering, seen.instant, middle, seen.drift)
        swept = self._sweeping.step(state.swept, smooth)
        hangs = None if block is None else explained(block, self.model.machine.rated_payload)
        turned = self._gatherer.swung(middle, _acting(resultant))
        now = (gathering, turned, seen.lift.taken, seen.drift)
        unnoticed = self._noticing.step(state.unnoticed, *now, hangs=bool(hangs))
        empty, wrong_since = self._emptied(state, seen.gross, seen.lift, seen.drift)
        state = state._replace(
            gathering=gathering, driven=driven, empty=empty, wrong_since=wrong_since, unnoticed=unnoticed
        )
        if gathering.samples:
            return state._replace(swept=swept)
        state = state._replace(swept=self._sweeping.ended(swept, explained=hangs))
        if block is None:
            return state
        in_air = state.in_air + 1 if hangs and state.suspicion.level is REJECTED else 0
        blocks = self._voting.added(state.blocks, block)
        leaps = self._returning.judged(state.leaps, block)
        return state._replace(blocks=blocks, offset=self._voting.result(blocks), leaps=leaps, in_air=in_air)

    def _emptied(self, state: Watch, gross: Quantity, lift: Lift, drift: Drift) -> tuple[SensorFault, int]:
        """Whether the empty bucket weighs less than nothing, or has moments of no mass in it, and from which of the
        lift's samples on; as before while that is not seen. As for a booking, the lift must go on for LATER_S: what
        ended it was no weight. Until empty motion has told of the drift, oil may be cold, as in the weighing's gate."""
        taken = lift.taken
        if gross.status is not Status.OK or gross.value > SMALLEST * self.model.machine.rated_payload:
            return state.empty, NEVER
        found = self._wrong_if_empty(state.empty, gross, lift, drift)
        if found is SensorFault.NONE:
            return found, NEVER
        if not 0 <= state.wrong_since <= taken:
            return state.empty, taken
        stays = taken - state.wrong_since >= LATER_S * self.model.filters.rate_hz
        return found if stays else state.empty, state.wrong_since

    def _wrong_if_empty(self, before: SensorFault, gross: Quantity, lift: Lift, drift: Drift) -> SensorFault:
        """What is wrong with the weight of an empty bucket, or with its place, with the operator's zero or without.
        The place is as `before` while the moments are not known as exactly as a weight must be. An error of the weight
        that does no harm, where a load lies, is none of the place, either."""
        rated, reach = self.model.machine.rated_payload, self.model.machine.payload_reach
        colder, more = (1.0, 0.0) if drift.returned else (COLD**2, lift.by_drift(drift.covariance))
        if gross.value < -max(BELOW * hypot(gross.standard_error, sqrt(colder - 1.0) * more), HARMLESS * rated):
            return SensorFault.LIGHT
        moments, covariance = lift.moments(self.tares.covariance, drift, colder)
        if float(np.trace(covariance[1:, 1:])) > (GOOD_ENOUGH * rated * FARTHEST * reach) ** 2:
            return before if before is SensorFault.MISPLACED else SensorFault.NONE
        moments[0] = max(moments[0], gross.value, 0.0) + HARMLESS * rated / FARTHEST
        away = impossible(moments, covariance, FARTHEST * reach)
        return SensorFault.MISPLACED if away > BELOW else SensorFault.NONE

    def _suspicion(self, state: Watch) -> SensorDoubt:
        """The surest objection, of several the most specific one. What stays is refuted by as many seconds in the air
        as must agree on an error."""
        if state.suspicion.latched:
            return state.suspicion
        found = max(self._objections(state), key=lambda doubt: doubt.level, default=NOTHING_SUSPECTED)
        if state.suspicion.stays and found.level is not REJECTED and state.in_air < VOTES:
            return state.suspicion
        return found

    def _objections(self, state: Watch) -> Iterator[SensorDoubt]:
        changes = state.changes
        yield self._marked(changes.below, SensorFault.IMPOSSIBLE)
        yield self._marked(changes.burst, SensorFault.BURST)
        if state.leapt:
            yield SensorDoubt(Level.REJECTED, SensorFault.LEAPT, state.leapt)
        yield state.leaps.doubt
        if (driven := state.driven.level) is not FINE:
            own, confirmed = self._pushing(state.driven.strain), state.driven.confirmed
            yield SensorDoubt(driven, SensorFault.EXCHANGED, own, confirmed=confirmed)
        yield self._marked(changes.constant, SensorFault.STUCK)
        yield self._marked(changes.gone, SensorFault.STUCK, Level.DOUBTED)
        yield self._off(state.offset)
        if (swept := state.swept.level) is not FINE:
            yield SensorDoubt(swept, SensorFault.EXCHANGED, tuple(self._watching.signals))
        if state.empty is not SensorFault.NONE:
            yield SensorDoubt(Level.DOUBTED, state.empty, tuple(range(len(self.model.machine.signals))))

    def _marked(self, marked: NDArray[np.bool_], cause: SensorFault, level: Level = Level.REJECTED) -> SensorDoubt:
        """The pressures that are `marked` (P,), if any are."""
        if True not in marked.tolist():  # several times as quick as `any` of few
            return NOTHING_SUSPECTED
        return SensorDoubt(level, cause, tuple(np.array(self._watching.signals)[marked].tolist()))

    def _pushing(self, strain: Array) -> tuple[int, ...]:
        """The pressures of the cylinders that act on the joint whose torque exceeds that of a load most."""
        machine = self.model.machine
        outward = np.append(machine.lengths[:-1], machine.payload_reach)[::-1].cumsum()[::-1]
        acting = self.model.acting[int((strain / outward[list(machine.rows)]).argmax())]
        return tuple(k for k, s in enumerate(machine.signals) if s.kind in FORCE_KINDS and s.index in acting)

    def _off(self, offset: Offset) -> SensorDoubt:
        limits, gatherer = self._voting.limits, self._gatherer
        if offset.evidence <= limits[Level.DOUBTED]:
            return NOTHING_SUSPECTED
        level = Level.REJECTED if offset.evidence > limits[Level.REJECTED] else Level.DOUBTED
        signals = self.model.machine.signals
        if offset.signal < len(gatherer.pressed):
            cylinder = gatherer.pressed[offset.signal]
            own = tuple(k for k, s in enumerate(signals) if s.kind in FORCE_KINDS and s.index == cylinder)
            return SensorDoubt(level, SensorFault.OFFSET, own, BAR * offset.size)
        joint = gatherer.turned[offset.signal - len(gatherer.pressed)]
        own = tuple(k for k, s in enumerate(signals) if s.kind is Kind.JOINT_ANGLE and s.index == joint)
        return SensorDoubt(level, SensorFault.SLIPPED, own, offset.size, offset.confirmed)


def _acting(force: Force) -> complex:
    """A force x + i z [N]; none where it is not known."""
    known = Status.INVALID not in (force.x.status, force.z.status)
    return complex(force.x.value, force.z.value) if known else 0j
