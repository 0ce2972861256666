"""Frames to samples: the last value of every signal, its age, and the reason when it is not usable."""

from dataclasses import dataclass
from functools import cached_property
from math import inf, isfinite
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
    `jumps`: number of implausible jumps in a row, the first of them by `leap`; `leapt`: sum of the leaps after which it
    stayed where it was."""

    value: float
    t_us: int
    seen_us: int
    reason: Reason
    good: int
    equal: int
    jumps: int
    leap: float = 0.0
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
    def _fastest(self) -> tuple[float, ...]:
        """Per signal the fastest plausible change [SI/s]."""
        return tuple(FASTEST.get(s.kind, inf) for s in self.service.machine.signals)

    def begin(self) -> Inputs:
        """The state before any frame."""
        empty = Channel(float("nan"), NEVER, NEVER, Reason.SIGNAL_MISSING, 0, 0, 0)
        return Inputs((empty,) * len(self.service.machine.signals), FrameCounters(), NEVER, self.supervisor.begin())

    def receive(self, inputs: Inputs, frame: Frame, moving: tuple[bool, ...]) -> Inputs:
        """The state after a frame: length and range are checked, unknown identifiers are counted. `moving`, per signal:
        whether the machine moves so that an equal value from this sensor means that it is frozen."""
        inputs = inputs._replace(watched=self.supervisor.received(inputs.watched, frame))
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
            return inputs._replace(channels=tuple(channels))
        counters = inputs.counters._replace(long=inputs.counters.long + 1)
        return inputs._replace(channels=tuple(channels), counters=counters, long_t_us=frame.t_us)

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
        if old.jumps < JUMPS_BELIEVED and self._jumps(old, slot, value, t_us):
            leap = old.leap if old.jumps else value - old.value
            return old._replace(reason=Reason.IMPLAUSIBLE_JUMP, seen_us=t_us, good=0, jumps=old.jumps + 1, leap=leap)
        leapt = old.leapt + old.leap * (old.jumps == JUMPS_BELIEVED)
        equal = 0 if value != old.value else old.equal + moving
        if equal >= self.service.health.frozen_samples and self._noisy(slot.signal):
            return old._replace(reason=Reason.FROZEN, seen_us=t_us, good=0, equal=equal)
        good = old.good + 1 if t_us - old.seen_us <= hold_us else 1
        if t_us - old.t_us <= hold_us or good >= self.service.health.good_frames:
            return Channel(value, t_us, t_us, Reason.NONE, good, equal, 0, 0.0, leapt)
        return old._replace(value=value, seen_us=t_us, good=good, equal=equal, jumps=0, leapt=leapt)

    def _jumps(self, old: Channel, slot: Slot, value: float, t_us: int) -> bool:
        """Whether the value differs from the last one by more than is plausible: FASTEST times the time between them,
        and the noise. Time during which values jumped or were not yet accepted does not count, because the joint
        need not have moved then."""
        if self._fastest[slot.signal] == inf:
            return False
        proving = t_us - old.t_us > self._hold_us and old.good > 0
        since_us = old.seen_us if old.jumps or proving else old.t_us
        return abs(value - old.value) > self._room(slot.signal, (t_us - since_us) * 1e-6)

    def _room(self, k: int, seconds: float) -> float:
        """By how much a signal may change in a time [s], but at least one of its periods."""
        signal = self.service.machine.signals[k]
        return self._fastest[k] * max(seconds, signal.period_s) + 6.0 * signal.standard_error + 2.0 * self._quantum[k]

    def leapt(self, inputs: Inputs) -> tuple[int, ...]:
        """Signals that leapt and stayed there: a joint, or the machine, is not where they say, now or before."""
        return tuple(k for k, c in enumerate(inputs.channels) if c.leapt and abs(c.leapt) > self._room(k, 0.0))

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
        hold_us = self._hold_us
        reasons: list[Reason] = []
        late = Reason.NONE
        for channel, signal in zip(inputs.channels, self.service.machine.signals, strict=True):
            age = t_us - channel.t_us
            if abs(age) > hold_us:  # a negative age: the clock was set back meanwhile
                reasons.append(Reason.SIGNAL_STALE if channel.reason is Reason.NONE else channel.reason)
                continue
            reasons.append(Reason.NONE)
            if channel.reason is not Reason.NONE or age > 1.5e6 * signal.period_s:
                late = Reason.SIGNAL_STALE if channel.reason is Reason.NONE else channel.reason
        for k, reason in self.supervisor.reasons(inputs.watched, t_us).items():
            reasons[k] = max(reasons[k], reason)
        values = np.array([c.value for c in inputs.channels])
        return Sample(t_us, values, tuple(reasons), late)

    def ages(self, inputs: Inputs, t_us: int) -> tuple[float, ...]:
        """Age (S,) [s] of each value at a time; infinite where there never was one."""
        return tuple(1e-6 * (t_us - c.t_us) if c.t_us != NEVER else inf for c in inputs.channels)


JUMPS_BELIEVED = 100  # implausible values in a row after which the new level is accepted as real; chosen
