"""Frames to samples: the last value of every signal, its age, and the reason when it cannot be believed."""

from dataclasses import dataclass
from functools import cached_property
from math import inf, isfinite
from typing import NamedTuple

import numpy as np

from cylforce.mechanics.installation import Service
from cylforce.signals.codec import Decoder, Slot, decoders
from cylforce.signals.estimate import Reason, Sample
from cylforce.signals.events import Frame
from cylforce.signals.kinds import Kind

NEVER = -(1 << 62)  # longer ago than any clock can tell
# No joint of such a machine turns, and no cylinder runs, faster than this: a larger step is the sensor's fault.
FASTEST = {
    Kind.JOINT_ANGLE: 3.0,
    Kind.LINK_INCLINATION: 3.0,
    Kind.CYLINDER_LENGTH: 1.5,
    Kind.PITCH: 3.0,
    Kind.ROLL: 3.0,
}


class Channel(NamedTuple):
    """One signal: its last believed value (while it proves itself: its last), when that came, when anything came last,
    what was wrong last, good values since, equal values in motion, leaps in a row."""

    value: float
    t_us: int
    seen_us: int
    reason: Reason
    good: int
    equal: int
    jumps: int


class FrameCounters(NamedTuple):
    """What the bus did wrong so far."""

    unknown: int = 0
    short: int = 0
    long: int = 0
    rejected: int = 0


class Inputs(NamedTuple):
    """All channels and counters."""

    channels: tuple[Channel, ...]
    counters: FrameCounters
    long_t_us: int


@dataclass(frozen=True)
class Assembler:
    """Receives frames, gives samples; pure: every method returns the new inputs."""

    service: Service

    @cached_property
    def decoders(self) -> dict[int, Decoder]:
        """By CAN identifier."""
        names = {s.name: k for k, s in enumerate(self.service.machine.signals)}
        return decoders(tuple(p for n in self.service.nodes for p in n.pdos), names)

    @cached_property
    def _quantum(self) -> tuple[float, ...]:
        size = {f.signal: f.scale for n in self.service.nodes for p in n.pdos for f in p.fields if f.code != "f"}
        return tuple(size.get(s.name, 0.0) for s in self.service.machine.signals)

    def begin(self) -> Inputs:
        """Nothing received yet."""
        empty = Channel(float("nan"), NEVER, NEVER, Reason.SIGNAL_MISSING, 0, 0, 0)
        return Inputs((empty,) * len(self.service.machine.signals), FrameCounters(), NEVER)

    def receive(self, inputs: Inputs, frame: Frame, moving: tuple[bool, ...]) -> Inputs:
        """Take a frame in: length and range are checked, unknown identifiers counted; `moving` tells, per signal,
        whether the machine moves so that a sensor which repeats itself must be frozen."""
        found = self.decoders.get(frame.can_id)
        if found is None:
            return inputs._replace(counters=inputs.counters._replace(unknown=inputs.counters.unknown + 1))
        if len(frame.data) < found.struct.size:
            return self._short(inputs, found)
        channels = list(inputs.channels)
        raw = found.struct.unpack_from(frame.data)
        for slot in found.slots:
            value = raw[slot.item] * slot.scale + slot.offset
            usable = raw[slot.item] != found.missing[slot.item]
            channels[slot.signal] = self._judge(
                channels[slot.signal],
                slot,
                value if usable else float("nan"),
                frame.t_us,
                moving[slot.signal],
            )
        if len(frame.data) == found.struct.size:
            return Inputs(tuple(channels), inputs.counters, inputs.long_t_us)
        counters = inputs.counters._replace(long=inputs.counters.long + 1)
        return Inputs(tuple(channels), counters, frame.t_us)

    def _short(self, inputs: Inputs, found: Decoder) -> Inputs:
        channels = list(inputs.channels)
        for slot in found.slots:
            channels[slot.signal] = channels[slot.signal]._replace(reason=Reason.SHORT_FRAME, good=0)
        return inputs._replace(
            channels=tuple(channels), counters=inputs.counters._replace(short=inputs.counters.short + 1)
        )

    def _judge(self, old: Channel, slot: Slot, value: float, t_us: int, moving: bool) -> Channel:
        hold_us = 1e6 * self.service.health.hold_s
        if not isfinite(value):
            return old._replace(reason=Reason.NOT_A_NUMBER, seen_us=t_us, good=0)
        if not slot.low <= value <= slot.high:
            return old._replace(reason=Reason.OUT_OF_RANGE, seen_us=t_us, good=0)
        if old.jumps < JUMPS_BELIEVED and abs(value - old.value) > self._room(old, slot, t_us):
            return old._replace(reason=Reason.IMPLAUSIBLE_JUMP, seen_us=t_us, good=0, jumps=old.jumps + 1)
        equal = 0 if value != old.value else old.equal + moving
        if equal >= self.service.health.frozen_samples and self._noisy(slot.signal):
            return old._replace(reason=Reason.FROZEN, seen_us=t_us, good=0, equal=equal)
        good = old.good + 1 if t_us - old.seen_us <= hold_us else 1
        if t_us - old.t_us <= hold_us or good >= self.service.health.good_frames:
            return Channel(value, t_us, t_us, Reason.NONE, good, equal, 0)
        return old._replace(value=value, seen_us=t_us, good=good, equal=equal, jumps=0)

    def _room(self, old: Channel, slot: Slot, t_us: int) -> float:
        """How far the next value may lie from the last. Time in which a sensor leapt, or was still to prove itself, is
        no excuse: nobody believes that the joint moved meanwhile."""
        signal = self.service.machine.signals[slot.signal]
        proving = t_us - old.t_us > 1e6 * self.service.health.hold_s and old.good > 0
        since_us = old.seen_us if old.jumps or proving else old.t_us
        room = FASTEST.get(signal.kind, inf) * max((t_us - since_us) * 1e-6, signal.period_s)
        return room + 6.0 * signal.standard_error + 2.0 * slot.scale

    def _noisy(self, k: int) -> bool:
        """Whether a working sensor's own noise keeps its last digit moving."""
        return self.service.machine.signals[k].standard_error >= 0.5 * self._quantum[k] > 0.0

    def restart(self, inputs: Inputs, node_id: int) -> Inputs:
        """A sensor node booted: nothing that it said before counts, and it must prove itself anew."""
        mine = {slot.signal for d in self.decoders.values() if d.node_id == node_id for slot in d.slots}
        lost = Channel(float("nan"), NEVER, NEVER, Reason.NOT_OPERATIONAL, 0, 0, 0)
        return inputs._replace(channels=tuple(lost if k in mine else c for k, c in enumerate(inputs.channels)))

    def sample(self, inputs: Inputs, t_us: int) -> Sample:
        """What is known at a tick. A signal that is late, or was refused, is held for a short time, then invalid."""
        hold_us = 1e6 * self.service.health.hold_s
        reasons: list[Reason] = []
        late = Reason.NONE
        for channel, signal in zip(inputs.channels, self.service.machine.signals, strict=True):
            age = t_us - channel.t_us
            if abs(age) > hold_us:  # from the future: the clock was set back meanwhile
                reasons.append(Reason.SIGNAL_STALE if channel.reason is Reason.NONE else channel.reason)
                continue
            reasons.append(Reason.NONE)
            if channel.reason is not Reason.NONE or age > 1.5e6 * signal.period_s:
                late = Reason.SIGNAL_STALE if channel.reason is Reason.NONE else channel.reason
        return Sample(t_us, np.array([c.value for c in inputs.channels]), tuple(reasons), late)


JUMPS_BELIEVED = 100  # a step that lasts is no outlier: the value is then taken, and must prove itself
