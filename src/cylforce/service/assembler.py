"""Samples from frames: the last value of every signal, its age, and the reason when it is not usable."""

from array import array
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, dataclass
from functools import lru_cache
from math import inf, nan
from struct import Struct
from typing import Any, Self

import numpy as np

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.inputs import NEVER, KernelInputs
from cylforce.estimation.kernel.layout import InputLayout, SampleLayout
from cylforce.estimation.kernel.making import counts, numbers
from cylforce.estimation.kernel.restricted import Counts, Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.mechanics.installation import LATE_PERIODS, Service
from cylforce.mechanics.unwrapping import Unwrapping
from cylforce.service.senders.channels import QUIET_US, REASONS, Channel, FrameCounters, LastHeartbeat, PdoRate
from cylforce.service.senders.supervision import Supervisor
from cylforce.service.snapshot import Constants, Estimator
from cylforce.signals.codec import decoders
from cylforce.signals.estimate import Reason, Sample
from cylforce.signals.events import Frame
from cylforce.signals.kinds import ANGLES, Kind
from cylforce.signals.layout import Pdo
from cylforce.signals.turns import TURN

# rad/s and m/s: no joint or cylinder of such a machine is faster, so that a larger step is a sensor fault; chosen
FASTEST = {
    Kind.JOINT_ANGLE: 3.0,
    Kind.LINK_INCLINATION: 3.0,
    Kind.CYLINDER_LENGTH: 1.5,
    Kind.PITCH: 3.0,
    Kind.ROLL: 3.0,
}

# Angles of joints may read a whole turn away from their range. A tilt of the chassis beyond its range is a fault.
TURNED = (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION)


@dataclass(frozen=True, slots=True)
class MappedPdo:
    """Sensor's PDO, for decoding its frames.

    number: of the PDO, in the order of `Supervisor.pdos`
    size:   number of bytes of its data
    unpack: function that returns its items, as numbers on the bus
    """

    number: int
    size: int
    unpack: Callable[..., tuple[Any, ...]]


@dataclass(frozen=True, slots=True)
class FrameOrder:
    """Plan for decoding frames with one order of identifiers together.

    frame_kinds: number of each frame's PDO and 0 (length as mapped), as the kernel takes them
    sizes:       number of bytes of each frame's data
    layout:      of the concatenated data of all frames
    """

    frame_kinds: Counts
    sizes: list[int]
    layout: Struct


class AssemblerConstants(Constants):
    """Constants of the sensors of one machine file.

    service:    settings of the machine file
    supervisor: nodes and identifiers that are supervised
    decoders:   of the sensors' PDOs, by CAN identifier
    layout:     names of the places in the state of `Assembler`
    sample:     names of the places in the kernel's array for a sample
    plan:       constants of all signals and PDOs, as the kernel takes them
    unwrapping: adds whole turns to angles
    still:      (S,) `moving` of `Assembler.receive` while nothing moves
    fine:       (S,) reasons of a sample without an unusable signal
    mapped:     sensors' PDOs, by CAN identifier
    orders:     function that returns the cached plan for an order of identifiers, which hardly changes between ticks
    """

    def __init__(self, service: Service) -> None:
        """Compute what is needed to read the sensors' frames: decoders of their PDOs, checks, places in the state.

        service: settings of the machine file: machine with its signals, sensor nodes with their PDOs, health limits
        """
        machine, self.service = service.machine, service
        self.kernel = choice.chosen()
        self.supervisor = Supervisor(service)
        names = {signal.name: number for number, signal in enumerate(machine.signals)}
        self.decoders = decoders(tuple(pdo for node in service.nodes for pdo in node.pdos), names)
        self.layout = InputLayout(len(machine.signals), len(self.supervisor.pdos), len(service.nodes))
        self.sample = SampleLayout(len(machine.signals))
        self.unwrapping = Unwrapping(machine)
        self.still: Numbers = ZERO * len(machine.signals)
        self.plan = self._plan()
        self.fine = (Reason.NONE,) * len(machine.signals)
        self.mapped = {
            pdo.can_id: MappedPdo(number, struct.size, struct.unpack_from)
            for number, (_, pdo) in enumerate(self.supervisor.pdos)
            for struct in (self.decoders[pdo.can_id].struct,)
        }
        self.orders = lru_cache(maxsize=64)(self._order)

    def _order(self, ids: tuple[int, ...]) -> FrameOrder | None:
        """Return the plan for decoding successive frames with these identifiers together.

        It is None where one of the identifiers is no sensor's.

        ids: CAN identifiers of the frames, in their order
        """
        if not set(ids) <= set(self.mapped):
            return None
        found = [self.mapped[can_id] for can_id in ids]
        formats = [self.decoders[can_id].struct.format.removeprefix("<") for can_id in ids]
        frame_kinds = counts(x for pdo in found for x in (pdo.number, 0))
        return FrameOrder(frame_kinds, [pdo.size for pdo in found], Struct("<" + "".join(formats)))

    def _plan(self) -> KernelInputs:
        """Return the constants of all signals and PDOs in the form that the kernel takes.

        They are, of each field that carries a signal: its place, scale, range [SI] and the raw value for "no value"; of
        each PDO: its shortest period and the patience with its node [us]; of each signal: its fastest change [SI/s],
        period [s], noise [SI], age above which it is late [us], the turn after which it repeats [rad], and whether
        repeated values mean a fault; the limits of the machine file."""
        machine, health, watcher = self.service.machine, self.service.health, self.supervisor
        found = [self.decoders[pdo.can_id] for _, pdo in watcher.pdos]
        slots = [slot for decoder in found for slot in decoder.slots]
        missing = [nan if (m := d.missing[slot.item]) is None else m for d in found for slot in d.slots]
        first = np.cumsum([0, *(len(decoder.slots) for decoder in found)]).tolist()
        quantum = self._quantum()
        # equal values mean a fault where the noise of a sensor is large enough to change the last digit
        noisy = [s.standard_error >= 0.5 * step > 0.0 for s, step in zip(machine.signals, quantum, strict=True)]
        whole = [first, [s.signal for s in slots], [s.item for s in slots], noisy, watcher.senders]
        whole.append([len(decoder.missing) for decoder in found])
        fields = [[getattr(s, name) for s in slots] for name in ("scale", "offset", "low", "high")]
        limits = [1e6 * health.hold_s, QUIET_US, health.frozen_samples, health.good_frames]
        senders = [watcher.periods_us, watcher.patience_us]
        fastest = [FASTEST.get(s.kind, inf) for s in machine.signals]
        periods = [s.period_s for s in machine.signals]
        # largest change of a value by noise and quantisation [SI]
        noise = [6.0 * s.standard_error + 2.0 * step for s, step in zip(machine.signals, quantum, strict=True)]
        late = [1e6 * LATE_PERIODS * s.period_s for s in machine.signals]
        turns = [TURN if s.kind in ANGLES else 0.0 for s in machine.signals]
        around = [TURN if machine.signals[s.signal].kind in TURNED else 0.0 for s in slots]
        parts = [*fields, missing, *senders, fastest, periods, noise, late, turns, around, limits]
        return self.kernel.KernelInputs([counts(x) for x in whole], [numbers(x) for x in parts])

    def _quantum(self) -> list[float]:
        """Return the resolution (S,) of each signal [SI]: the change of its value by one integer on the bus.

        It is 0 for a signal that is sent as a float, or that no PDO carries."""
        fields = (f for node in self.service.nodes for pdo in node.pdos for f in pdo.fields)
        step = {f.signal: f.scale for f in fields if f.code != "f"}  # "f": float; `scale` gives SI
        return [step.get(signal.name, 0.0) for signal in self.service.machine.signals]


@dataclass(slots=True)
class Assembler(Estimator):
    """Last value of every signal.

    constants: of the sensors
    state:     of all signals, PDOs and nodes, and frame counters, as the kernel keeps them (`InputLayout`)
    """

    constants: AssemblerConstants
    state: Numbers

    @classmethod
    def start(cls, constants: AssemblerConstants) -> Self:
        """Return the state of the sensors' inputs before any frame.

        The signals have no value (reason SIGNAL_MISSING), the PDOs and heartbeats have never been received, and neither
        a frame that is too long nor another sender of our identifiers has been seen."""
        layout = constants.layout
        made = cls(constants, ZERO * layout.size)
        for number in range(layout.signals):
            made._put(layout.signal(number), Channel.without_value(Reason.SIGNAL_MISSING))
        for number in range(layout.pdos):
            made._put(layout.pdo(number), PdoRate())
        for number in range(layout.nodes):
            made._put(layout.node(number), LastHeartbeat())
        made.state[layout.long_us] = made.state[layout.foreign_us] = NEVER
        return made

    def receive(self, frames: Sequence[Frame], moving: Numbers | None = None) -> None:
        """Decode frames, check their lengths and values, and count frames with unknown identifiers.

        A value is refused if it means "no value", is out of range, steps by more than is plausible, or is repeated too
        often. The rate of each PDO shows whether a second node sends it.

        frames: in the order of their reception
        moving: (S,) not 0 where an equal value means a frozen sensor, because the machine moves; None: nothing moves
        """
        if not frames:
            return
        moving = self.constants.still if moving is None else moving
        times, ids, parts = zip(*frames, strict=True)
        order = self.constants.orders(ids)
        if order is None:
            self._receive_with_unknown(frames, moving)
        elif [*map(len, parts)] != order.sizes:
            self._receive_one_by_one(frames, moving)
        else:
            self._take(order.frame_kinds, times, order.layout.unpack(b"".join(parts)), moving)

    def _receive_with_unknown(self, frames: Sequence[Frame], moving: Numbers) -> None:
        """Decode sensors' frames, as many together as follow each other, and count frames that are no sensor's.

        frames: in the order of their reception
        moving: (S,) not 0 where an equal value means a frozen sensor
        """
        begin = 0
        for k, frame in enumerate(frames):
            if frame.can_id not in self.constants.mapped:
                self.receive(frames[begin:k], moving)
                self._receive_unknown(frame)
                begin = k + 1
        self.receive(frames[begin:], moving)

    def _receive_one_by_one(self, frames: Sequence[Frame], moving: Numbers) -> None:
        """Decode sensors' frames one after the other, because some are shorter or longer than their mapping.

        No value of a frame that is too short is used. All values of a frame that is too long are used.

        frames: in the order of their reception
        moving: (S,) not 0 where an equal value means a frozen sensor
        """
        for frame in frames:
            pdo = self.constants.mapped[frame.can_id]
            longer = len(frame.data) - pdo.size
            frame_kinds = array("q", (pdo.number, (longer > 0) - (longer < 0)))
            self._take(frame_kinds, (frame.t_us,), pdo.unpack(frame.data) if longer >= 0 else (), moving)

    def _take(self, frame_kinds: Counts, times: Iterable[float], raw: Iterable[float], moving: Numbers) -> None:
        """Update the state of signals and PDOs with sensors' frames: decode their values, check their plausibility.

        frame_kinds: number of each frame's PDO, then -1, 0, 1: too short, as mapped, too long
        times:       of each frame [us]
        raw:         items of all frames, as numbers on the bus
        moving:      (S,) not 0 where an equal value means a frozen sensor
        """
        constants, size = self.constants, len(frame_kinds) // 2
        constants.kernel.receive(
            constants.plan, self.state, frame_kinds, size, array("d", times), array("d", raw), moving
        )

    def _receive_unknown(self, frame: Frame) -> None:
        """Count a frame that is no sensor's PDO.

        A heartbeat of a sensor node updates its NMT state; a frame with one of our identifiers is noted with its time,
        because another node sends it."""
        layout, supervisor = self.constants.layout, self.constants.supervisor
        node = supervisor.nodes.get(frame.can_id)
        if node is not None and len(frame.data) == 1:
            self._put(layout.node(node), LastHeartbeat(frame.t_us, frame.data[0] & 0x7F))
        elif frame.can_id in supervisor.ours:
            self.state[layout.foreign_us] = frame.t_us
        self.state[layout.unknown] += 1.0

    def restart(self, node_id: int) -> None:
        """Discard the values of a sensor node that booted; its signals are used again after enough good values.

        The steps [SI] that its angles made before remain known.

        node_id: of the node
        """
        constants, layout = self.constants, self.constants.layout
        for number, node in enumerate(constants.service.nodes):
            if node.node_id == node_id:
                self._put(layout.node(number), LastHeartbeat(booted=1.0))
        for number, (node, _) in enumerate(constants.supervisor.pdos):
            if node.node_id == node_id:
                self._put(layout.pdo(number), PdoRate())
        for k in {s.signal for d in constants.decoders.values() if d.node_id == node_id for s in d.slots}:
            self._put(layout.signal(k), Channel.without_value(Reason.NOT_OPERATIONAL, self.channels[k].stepped))

    def _put(self, place: slice, record: Channel | PdoRate | LastHeartbeat) -> None:
        """Write the fields of a record, in their order, at its place in the state."""
        self.state[place] = numbers(astuple(record))

    def sample(self, t_us: int) -> Sample:
        """Return the sample at a tick: the last value (S,) of each signal [SI], and the reason where it is not usable.

        Whole turns are added to angles as their ranges require. The last value of a signal that is late or was refused
        is used for the machine file's `hold_s` [s]; after that it is not usable. The signals of a PDO that two nodes
        send, or whose node is lost or not operational, become unusable without that delay.

        t_us: time of the tick [us]
        """
        constants, place = self.constants, self.constants.sample
        found = ZERO * place.size
        bad = constants.kernel.usable(constants.plan, self.state, t_us, found)
        reasons = tuple([REASONS[x] for x in found[place.reasons]]) if bad else constants.fine
        values = found[place.values]
        constants.unwrapping.apply(values)
        return Sample(t_us, values, reasons, REASONS[found[place.late]], self.stepped if found[place.stepped] else ())

    @property
    def stepped(self) -> tuple[int, ...]:
        """Numbers of the signals that have stepped: their values before or after the step are wrong."""
        found = self.constants.still[:]
        self.constants.kernel.stepped(self.constants.plan, self.state, found)
        return tuple(k for k, stepped in enumerate(found) if stepped)

    @property
    def arrivals_us(self) -> Numbers:
        """Time (S,) [us] at which the frame of each signal's last accepted value was received."""
        return self.state[self.constants.layout.arrivals]

    def ages(self, t_us: int) -> tuple[float, ...]:
        """Return the age (S,) [s] of each signal's last accepted value at a time [us]; infinite without one."""
        return tuple(1e-6 * (t_us - c.t_us) if c.t_us != NEVER else inf for c in self.channels)

    @property
    def channels(self) -> tuple[Channel, ...]:
        """State of each signal."""
        layout = self.constants.layout
        return tuple(Channel(*self.state[layout.signal(k)]) for k in range(layout.signals))

    @property
    def pdos(self) -> tuple[PdoRate, ...]:
        """Rate of each PDO, in the order of `Supervisor.pdos`."""
        layout = self.constants.layout
        return tuple(PdoRate(*self.state[layout.pdo(k)]) for k in range(layout.pdos))

    @property
    def nodes(self) -> tuple[LastHeartbeat, ...]:
        """Last heartbeat of each node."""
        layout = self.constants.layout
        return tuple(LastHeartbeat(*self.state[layout.node(k)]) for k in range(layout.nodes))

    @property
    def counters(self) -> FrameCounters:
        """Numbers of unexpected frames."""
        layout, state = self.constants.layout, self.state
        return FrameCounters(state[layout.unknown], state[layout.short], state[layout.long])

    @property
    def long_us(self) -> float:
        """Time of the last frame that was longer than its mapping [us]."""
        return self.state[self.constants.layout.long_us]

    def spoofed(self, t_us: int) -> bool:
        """Return whether another node has sent one of our identifiers in QUIET_US [us] before the time `t_us`."""
        return abs(t_us - self.state[self.constants.layout.foreign_us]) < QUIET_US

    def doubled(self, t_us: int) -> tuple[Pdo, ...]:
        """Return the layouts of the PDOs that more than one node has sent in QUIET_US [us] before the time `t_us`."""
        constants = self.constants
        last = self.state[constants.layout.second_us]
        pdos = constants.supervisor.pdos
        return tuple([pdos[k][1] for k, at in enumerate(last) if abs(t_us - at) < QUIET_US])


def assembler(service: Service) -> Assembler:
    """Return the state of a machine file's sensors before any frame."""
    return Assembler.start(AssemblerConstants(service))
