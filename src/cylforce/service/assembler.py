"""Frames to samples: the last value of every signal, its age, and the reason when it is not usable."""

from dataclasses import dataclass
from functools import cached_property
from math import inf, isfinite, nan
from typing import NamedTuple

import numpy as np

from cylforce.mechanics.installation import Service
from cylforce.service.senders.supervision import NOBODY, Senders, Supervisor
from cylforce.signals.codec import Decoder, Slot, decoders
from cylforce.signals.estimate import Reason, Sample
from cylforce.signals.events import Frame
from cylforce.signals.kinds import Kind

NEVER = -(1 << 62)  # us, stands for a time before all others
# rad/s and m/s: no joint or cylinder of such a machine is faster, so that a larger step is a sensor fault; chosen
FASTEST = {
    Kind.JOINT_ANGLE: 3.0,
    Kind.LINK_INCLINATION: 3.0,
    Kind.CYLINDER_LENGTH: 1.5,
    Kind.PITCH: 3.0,
    Kind.ROLL: 3.0,
}


class Channel(NamedTuple):
    """One signal: its last accepted `value` (while it has not yet sent enough good values: its last value); `t_us`:
    time of the last accepted value; `seen_us`: time of the last value of any kind; `reason`: what was wrong with that
    one; `good`: number of good values in a row; `equal`: number of equal values in a row while the machine moved;
    `jumps`: number of values in a row that are off by a `leap`, the `last` one of them; `leapt`: sum of the leaps that
    were believed after so many of them."""

    value: float
    t_us: int
    seen_us: int
    reason: Reason
    good: int
    equal: int
    jumps: int
    leap: float = 0.0
    last: float = 0.0
    leapt: float = 0.0


class FrameCounters(NamedTuple):
    """Numbers of frames with an unknown identifier, too short, too long, or rejected."""

    unknown: int = 0
    short: int = 0
    long: int = 0
    rejected: int = 0


class Inputs(NamedTuple):
    """State of all channels, frame counters, the time [us] of the last frame that was too long, and of who sends."""

    channels: tuple[Channel, ...]
    counters: FrameCounters
    long_t_us: int
    watched: Senders = NOBODY


@dataclass(frozen=True)
class Assembler:
    """Receives frames and gives samples. Pure: every method returns the new state."""

    service: Service

    @cached_property
    def supervisor(self) -> Supervisor:
        """Watches who sends."""
        return Supervisor(self.service)

    @cached_property
    def decoders(self) -> dict[int, Decoder]:
        """Decoders of the sensors' PDOs by CAN identifier."""
        names = {s.name: k for k, s in enumerate(self.service.machine.signals)}
        return decoders(tuple(p for n in self.service.nodes for p in n.pdos), names)

    @cached_property
    def _quantum(self) -> tuple[float, ...]:
        size = {f.signal: f.scale for n in self.service.nodes for p in n.pdos for f in p.fields if f.code != "f"}
        return tuple(size.get(s.name, 0.0) for s in self.service.machine.signals)

    @cached_property
    def _hold_us(self) -> float:
        return 1e6 * self.service.health.hold_s

    @cached_property
    def _plausible(self) -> tuple[tuple[float, float, float], ...]:
        """Per signal the fastest plausible change [SI/s], the period [s], and what noise and digits change [SI]."""
        return tuple(
            (FASTEST.get(s.kind, inf), s.period_s, 6.0 * s.standard_error + 2.0 * quantum)
            for s, quantum in zip(self.service.machine.signals, self._quantum, strict=True)
        )

    @cached_property
    def _late_us(self) -> tuple[float, ...]:
        """Per signal the age from which on it is late."""
        return tuple(1.5e6 * s.period_s for s in self.service.machine.signals)

    def begin(self) -> Inputs:
        """The state before any frame."""
        empty = Channel(float("nan"), NEVER, NEVER, Reason.SIGNAL_MISSING, 0, 0, 0)
        return Inputs((empty,) * len(self.service.machine.signals), FrameCounters(), NEVER, self.supervisor.begin())

    def receive(self, inputs: Inputs, frame: Frame, moving: tuple[bool, ...]) -> Inputs:
        """The state after a frame: length and range are checked, unknown identifiers are counted. `moving`, per signal:
        whether the machine moves so that an equal value from this sensor means that it is frozen."""
        watched = self.supervisor.received(inputs.watched, frame)
        found = self.decoders.get(frame.can_id)
        if found is None:
            counters = inputs.counters._replace(unknown=inputs.counters.unknown + 1)
            return Inputs(inputs.channels, counters, inputs.long_t_us, watched)
        size, t_us = found.struct.size, frame.t_us
        if len(frame.data) < size:
            return self._short(inputs._replace(watched=watched), found)
        channels = list(inputs.channels)
        raw = found.struct.unpack_from(frame.data)
        for slot in found.slots:
            number = raw[slot.item]
            value = number * slot.scale + slot.offset if number != found.missing[slot.item] else nan
            channels[slot.signal] = self._judge(channels[slot.signal], slot, value, t_us, moving[slot.signal])
        if len(frame.data) == size:
            return Inputs(tuple(channels), inputs.counters, inputs.long_t_us, watched)
        counters = inputs.counters._replace(long=inputs.counters.long + 1)
        return Inputs(tuple(channels), counters, t_us, watched)

    def _short(self, inputs: Inputs, found: Decoder) -> Inputs:
        channels = list(inputs.channels)
        for slot in found.slots:
            channels[slot.signal] = channels[slot.signal]._replace(reason=Reason.SHORT_FRAME, good=0)
        return inputs._replace(
            channels=tuple(channels), counters=inputs.counters._replace(short=inputs.counters.short + 1)
        )

    def _judge(self, old: Channel, slot: Slot, value: float, t_us: int, moving: bool) -> Channel:
        hold_us = self._hold_us
        if not isfinite(value):
            return old._replace(reason=Reason.NOT_A_NUMBER, seen_us=t_us, good=0)
        if not slot.low <= value <= slot.high:
            return old._replace(reason=Reason.OUT_OF_RANGE, seen_us=t_us, good=0)
        leap = self._leap(old, slot.signal, value, t_us)
        if leap and old.jumps < JUMPS_BELIEVED:
            jump = old._replace(reason=Reason.IMPLAUSIBLE_JUMP, seen_us=t_us, good=0, jumps=old.jumps + 1)
            return jump._replace(leap=leap, last=value)
        leapt = old.leapt + leap
        equal = 0 if value != old.value else old.equal + moving
        if equal >= self.service.health.frozen_samples and self._noisy(slot.signal):
            return old._replace(reason=Reason.FROZEN, seen_us=t_us, good=0, equal=equal)
        good = old.good + 1 if t_us - old.seen_us <= hold_us else 1
        if t_us - old.t_us <= hold_us or good >= self.service.health.good_frames:
            return Channel(value, t_us, t_us, Reason.NONE, good, equal, 0, leapt=leapt)
        return old._replace(value=value, seen_us=t_us, good=good, equal=equal, jumps=0, leapt=leapt)

    def _leap(self, old: Channel, k: int, value: float, t_us: int) -> float:
        """By how much a value is off because the signal has leapt by more than is plausible: FASTEST times the time
        between two values, and the noise; 0: it is not. Time during which values were not yet accepted does not count,
        because the joint need not have moved then. After a leap it moves on, until it leaps back."""
        if self._plausible[k][0] == inf:
            return 0.0
        if old.jumps:
            by = value - old.last
            leap = old.leap + by * (abs(by) > self._room(k, 1e-6 * (t_us - old.seen_us)))
            return leap if abs(leap) > self._room(k, 0.0) else 0.0
        proving = t_us - old.t_us > self._hold_us and old.good > 0
        by, since_us = value - old.value, old.seen_us if proving else old.t_us
        return by if abs(by) > self._room(k, 1e-6 * (t_us - since_us)) else 0.0

    def _room(self, k: int, seconds: float) -> float:
        """By how much a signal may change in a time [s], but at least one of its periods."""
        fastest, period_s, noise = self._plausible[k]
        return fastest * max(seconds, period_s) + noise

    def leapt(self, inputs: Inputs) -> tuple[int, ...]:
        """Signals that leapt and stayed there: a joint, or the machine, is not where they say, now or before."""
        return tuple([k for k, c in enumerate(inputs.channels) if c.leapt and abs(c.leapt) > self._room(k, 0.0)])

    def _noisy(self, k: int) -> bool:
        """Whether the noise of this sensor is large enough to change the last digit, so that equal values mean a
        fault."""
        return self.service.machine.signals[k].standard_error >= 0.5 * self._quantum[k] > 0.0

    def restart(self, inputs: Inputs, node_id: int) -> Inputs:
        """The state after a sensor node booted: its earlier values are discarded, and its signals are used again only
        after enough good values."""
        mine = {slot.signal for d in self.decoders.values() if d.node_id == node_id for slot in d.slots}
        lost = Channel(float("nan"), NEVER, NEVER, Reason.NOT_OPERATIONAL, 0, 0, 0)
        channels = tuple(lost._replace(leapt=c.leapt) if k in mine else c for k, c in enumerate(inputs.channels))
        return inputs._replace(channels=channels, watched=self.supervisor.restarted(inputs.watched, node_id))

    def sample(self, inputs: Inputs, t_us: int) -> Sample:
        """The sample at a tick. The last value of a signal that is late or was refused is used for `hold_s`; after that
        the signal is invalid."""
        hold_us, none = self._hold_us, Reason.NONE
        reasons = [none] * len(inputs.channels)
        late = none
        for k, (channel, late_us) in enumerate(zip(inputs.channels, self._late_us, strict=True)):
            age, reason = t_us - channel.t_us, channel.reason
            if not -hold_us <= age <= hold_us:  # a negative age: the clock was set back meanwhile
                reasons[k] = Reason.SIGNAL_STALE if reason is none else reason
            elif reason is not none or age > late_us:
                late = Reason.SIGNAL_STALE if reason is none else reason
        for k, reason in self.supervisor.reasons(inputs.watched, t_us).items():
            reasons[k] = max(reasons[k], reason)
        values = np.array([c.value for c in inputs.channels])
        return Sample(t_us, values, tuple(reasons), late)

    def ages(self, inputs: Inputs, t_us: int) -> tuple[float, ...]:
        """Age (S,) [s] of each value at a time; infinite where there never was one."""
        return tuple(1e-6 * (t_us - c.t_us) if c.t_us != NEVER else inf for c in inputs.channels)


JUMPS_BELIEVED = 100  # implausible values in a row after which the new level is accepted as real; chosen
