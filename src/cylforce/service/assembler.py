"""Frames to samples: the last value of every signal, its age, and the reason when it is not usable."""

from array import array
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import inf, nan
from struct import Struct
from typing import Any, NamedTuple

import numpy as np

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.inputs import NEVER, SIGNAL
from cylforce.estimation.kernel.making import counts, numbers
from cylforce.estimation.kernel.restricted import Counts, Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.mechanics.installation import LATE_PERIODS, Service
from cylforce.mechanics.unwrapping import Unwrapping
from cylforce.service.senders.inputs import QUIET_US, REASONS, Channel, Inputs, LastHeartbeat, PdoRate
from cylforce.service.senders.supervision import Supervisor
from cylforce.signals.codec import Decoder, decoders
from cylforce.signals.estimate import Reason, Sample
from cylforce.signals.events import Frame
from cylforce.signals.kinds import ANGLES, Kind
from cylforce.signals.quick import new, once
from cylforce.signals.turns import TURN

# rad/s and m/s: no joint or cylinder of such a machine is faster, so that a larger step is a sensor fault; chosen
FASTEST = {
    Kind.JOINT_ANGLE: 3.0,
    Kind.LINK_INCLINATION: 3.0,
    Kind.CYLINDER_LENGTH: 1.5,
    Kind.PITCH: 3.0,
    Kind.ROLL: 3.0,
}

# Angles of joints: they may be read beyond the range, a turn away. A chassis' tilt beyond its range is a fault.
TURNED = (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION)


class FrameOrder(NamedTuple):
    """Frames in an order of identifiers: what the kernel takes of each, PDO and 0; sizes of the data; layout of all."""

    sorts: Counts
    sizes: list[int]
    layout: Struct


@dataclass(frozen=True)
class Assembler:
    """Receives frames and gives samples. Pure: every method returns the new state."""

    service: Service

    @once
    def supervisor(self) -> Supervisor:
        """Watches who sends."""
        return Supervisor(self.service)

    @once
    def _unwrapping(self) -> Unwrapping:
        """Adds whole turns to angles."""
        return Unwrapping(self.service.machine)

    @once
    def decoders(self) -> dict[int, Decoder]:
        """Decoders of the sensors' PDOs by CAN identifier."""
        names = {s.name: k for k, s in enumerate(self.service.machine.signals)}
        return decoders(tuple(p for n in self.service.nodes for p in n.pdos), names)

    @once
    def _quantum(self) -> tuple[float, ...]:
        size = {f.signal: f.scale for n in self.service.nodes for p in n.pdos for f in p.fields if f.code != "f"}
        return tuple(size.get(s.name, 0.0) for s in self.service.machine.signals)

    @once
    def _plausible(self) -> tuple[tuple[float, float, float], ...]:
        """Per signal the fastest plausible change [SI/s], the period [s], and what noise and digits change [SI]."""
        return tuple(
            (FASTEST.get(s.kind, inf), s.period_s, 6.0 * s.standard_error + 2.0 * quantum)
            for s, quantum in zip(self.service.machine.signals, self._quantum, strict=True)
        )

    @once
    def _kernel(self) -> Any:  # noqa: ANN401 - of either form
        return choice.chosen()

    @once
    def _plan(self) -> Any:  # noqa: ANN401 - the compiled or the interpreted class
        machine, health, watcher = self.service.machine, self.service.health, self.supervisor
        found = [self.decoders[pdo.can_id] for _, pdo in watcher.pdos]
        slots = [slot for decoder in found for slot in decoder.slots]
        missing = [nan if (m := d.missing[slot.item]) is None else m for d in found for slot in d.slots]
        first = np.cumsum([0, *(len(decoder.slots) for decoder in found)]).tolist()
        noisy = [self._noisy(k) for k in range(len(machine.signals))]
        whole = [first, [s.signal for s in slots], [s.item for s in slots], noisy, watcher.senders]
        whole.append([len(decoder.missing) for decoder in found])
        fields = [[getattr(s, name) for s in slots] for name in ("scale", "offset", "low", "high")]
        limits = [1e6 * health.hold_s, QUIET_US, health.frozen_samples, health.good_frames]
        senders = [watcher.periods_us, watcher.patience_us]
        late = [1e6 * LATE_PERIODS * s.period_s for s in machine.signals]
        turns = [TURN if s.kind in ANGLES else 0.0 for s in machine.signals]
        around = [TURN if machine.signals[s.signal].kind in TURNED else 0.0 for s in slots]
        parts = [*fields, missing, *senders, *zip(*self._plausible, strict=True), late, turns, around, limits]
        return self._kernel.KernelInputs([counts(x) for x in whole], [numbers(x) for x in parts])

    @once
    def _mapped(self) -> dict[int, tuple[int, int, Callable[..., tuple[Any, ...]]]]:
        """By identifier a sensor's PDO: its place, the size of its data, what gives its items."""
        found = {}
        for place, (_, pdo) in enumerate(self.supervisor.pdos):
            layout = self.decoders[pdo.can_id].struct
            found[pdo.can_id] = (place, layout.size, layout.unpack_from)
        return found

    @once
    def still(self) -> Numbers:
        """`moving` of `receive` where nothing moves."""
        return ZERO * len(self.service.machine.signals)

    def begin(self) -> Inputs:
        """The state before any frame."""
        sizes = (len(self.service.machine.signals), len(self.supervisor.pdos), len(self.service.nodes))
        empty = Channel(nan, NEVER, NEVER, Reason.SIGNAL_MISSING, 0, 0, 0)
        parts = [*empty * sizes[0], *PdoRate() * sizes[1], *LastHeartbeat() * sizes[2], 0, 0, 0, NEVER, NEVER]
        return Inputs(numbers(parts), sizes)

    def receive(self, inputs: Inputs, frames: Sequence[Frame], moving: Numbers) -> Inputs:
        """The state after frames: length and range are checked, unknown identifiers are counted. `moving`, per signal:
        not 0 where the machine moves so that an equal value from this sensor means that it is frozen."""
        if not frames:
            return inputs
        times, ids, parts = zip(*frames, strict=True)
        order = self._orders(ids)
        if order is None:
            return self._by_turns(inputs, frames, moving)
        if [*map(len, parts)] != order.sizes:
            return self._one_by_one(inputs, frames, moving)
        raw = order.layout.unpack(b"".join(parts))
        return self._judged(inputs, order.sorts, times, raw, moving)

    def _by_turns(self, inputs: Inputs, frames: Sequence[Frame], moving: Numbers) -> Inputs:
        """The same of frames among which are unknown ones: what comes between them is judged together."""
        begin = 0
        for k, frame in enumerate(frames):
            if frame.can_id not in self._mapped:
                inputs = self._unknown(self.receive(inputs, frames[begin:k], moving), frame)
                begin = k + 1
        return self.receive(inputs, frames[begin:], moving)

    def _one_by_one(self, inputs: Inputs, frames: Sequence[Frame], moving: Numbers) -> Inputs:
        """The same of frames some of which are of another length."""
        for t_us, can_id, data in frames:
            place, size, unpack = self._mapped[can_id]
            sorts = array("q", (place, (len(data) > size) - (len(data) < size)))
            inputs = self._judged(inputs, sorts, (t_us,), unpack(data) if len(data) >= size else (), moving)
        return inputs

    @once
    def _orders(self) -> Callable[[tuple[int, ...]], "FrameOrder | None"]:
        """How frames with these identifiers are read: those of a tick come in an order that hardly changes."""
        return lru_cache(maxsize=64)(self._order)

    def _order(self, ids: tuple[int, ...]) -> "FrameOrder | None":
        if not set(ids) <= set(self._mapped):
            return None
        found, layouts = [self._mapped[can_id] for can_id in ids], [self.decoders[can_id].struct for can_id in ids]
        whole = Struct("<" + "".join(layout.format.removeprefix("<") for layout in layouts))
        return FrameOrder(counts(x for place, *_ in found for x in (place, 0)), [size for _, size, _ in found], whole)

    def _judged(
        self, inputs: Inputs, sorts: Counts, times: Iterable[float], raw: Iterable[float], moving: Numbers
    ) -> Inputs:
        """The state after frames of sensors, as the kernel takes them."""
        kept = inputs.kept[:]
        self._kernel.receive(self._plan, kept, sorts, len(sorts) // 2, array("d", times), array("d", raw), moving)
        return new(Inputs, (kept, inputs.sizes))

    def _unknown(self, inputs: Inputs, frame: Frame) -> Inputs:
        found = self.supervisor.received(inputs, frame)
        kept = found.kept[:]
        kept[-5] += 1.0
        return Inputs(kept, found.sizes)

    def leapt(self, inputs: Inputs) -> tuple[int, ...]:
        """Signals that leapt and stayed there: a joint, or the machine, is not where they say, now or before."""
        found = self.still[:]
        self._kernel.leapt(self._plan, inputs.kept, found)
        return tuple(k for k, leapt in enumerate(found) if leapt)

    def _noisy(self, k: int) -> bool:
        """Whether the noise of this sensor is large enough to change the last digit, so that equal values mean a
        fault."""
        return self.service.machine.signals[k].standard_error >= 0.5 * self._quantum[k] > 0.0

    def restart(self, inputs: Inputs, node_id: int) -> Inputs:
        """The state after a sensor node booted: its earlier values are discarded, and its signals are used again only
        after enough good values."""
        inputs = self.supervisor.restarted(inputs, node_id)
        lost, kept = Channel(nan, NEVER, NEVER, Reason.NOT_OPERATIONAL, 0, 0, 0), inputs.kept
        for k in {slot.signal for d in self.decoders.values() if d.node_id == node_id for slot in d.slots}:
            begin, end = SIGNAL * k, SIGNAL * (k + 1)
            kept[begin:end] = numbers(lost._replace(leapt=kept[begin + 9]))
        return inputs

    def sample(self, inputs: Inputs, t_us: int) -> Sample:
        """The sample at a tick. The last value of a signal that is late or was refused is used for `hold_s`; after that
        the signal is invalid. Angles have the whole turns that the joints allow."""
        size = inputs.sizes[0]
        found = ZERO * (2 * size + 2)
        bad = self._kernel.usable(self._plan, inputs.kept, t_us, found)
        reasons = tuple([REASONS[x] for x in found[size:-2]]) if bad else self._fine
        leapt = self.leapt(inputs) if found[-1] else ()
        values = found[:size]
        self._unwrapping.apply(values)
        return new(Sample, (t_us, values, reasons, REASONS[found[-2]], leapt))

    def came(self, inputs: Inputs) -> Numbers:
        """Return the time (S,) [us] at which the frame of each signal's last accepted value came."""
        return inputs.kept[1 : SIGNAL * inputs.sizes[0] : SIGNAL]

    @once
    def _fine(self) -> tuple[Reason, ...]:
        return (Reason.NONE,) * len(self.service.machine.signals)

    def ages(self, inputs: Inputs, t_us: int) -> tuple[float, ...]:
        """Age (S,) [s] of each value at a time; infinite where there never was one."""
        return tuple(1e-6 * (t_us - c.t_us) if c.t_us != NEVER else inf for c in inputs.channels)
