"""Who sends: whether each node's heartbeat goes on, whether only one node sends each identifier, and whether somebody
else sends ours. Pure, so that a replay of the log gives the same verdicts."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeVar

from cylforce.mechanics.installation import SensorNode, Service
from cylforce.signals.estimate import Reason
from cylforce.signals.events import Frame
from cylforce.signals.layout import Pdo

T = TypeVar("T")

CONSUMER_FACTOR = 3  # a node counts as lost after three missing heartbeats
QUIET_US = 2_000_000  # after the last sign of a second producer, until an identifier is trusted again; chosen
FAST_CLOCK = 0.0158  # largest tolerance of a CAN node's oscillator (Bosch, CAN Specification 2.0, chapter 9)
# A frame may be early by up to a period, and CAN itself may deliver one frame twice (error in the last bit of its end):
# what is beyond these two was sent by somebody else
EXCESS = 2.0
FORGOTTEN = 0.9  # share of what a producer owes that is left after each regular frame: gone within 0.2 s; chosen
_HEARTBEAT, _OPERATIONAL, _EMERGENCY, _ANSWER = 0x700, 5, 0x80, 0x580
_NEVER = -(1 << 62)


class LastHeartbeat(NamedTuple):
    """A node's last heartbeat: time [us] and state; _NEVER: none yet. `booted`: it has told that it booted, so that its
    heartbeat must follow its first PDO."""

    t_us: int = _NEVER
    state: int = _OPERATIONAL
    booted: bool = False


class PdoRate(NamedTuple):
    """A PDO: time of its last frame [us], frames beyond those that one producer sends, time of the last sign of a
    second one [us]."""

    t_us: int = _NEVER
    excess: float = 0.0
    doubled_us: int = _NEVER

    def doubled(self, t_us: int) -> bool:
        """Whether more than one node sends it."""
        return abs(t_us - self.doubled_us) < QUIET_US


class Senders(NamedTuple):
    """State of all nodes and PDOs, and when somebody else last sent one of our identifiers [us]."""

    nodes: tuple[LastHeartbeat, ...]
    pdos: tuple[PdoRate, ...]
    ours_us: int = _NEVER

    def spoofed(self, t_us: int) -> bool:
        """Whether somebody else sends our identifiers."""
        return abs(t_us - self.ours_us) < QUIET_US


NOBODY = Senders((), ())


def advanced(pace: PdoRate, t_us: int, period_us: float) -> PdoRate:
    """The pace after one frame more; `period_us`: the shortest that one producer can have.

    `excess` sums 1 - dt/period over the frames: for one producer it stays within the jitter, whatever the number of
    frames, and it grows by one with each frame of another. What one producer owes after a pause it may send at once
    (frames that waited while the bus or the reader was busy); with regular frames that is forgotten."""
    dt = (t_us - pace.t_us) / period_us
    if pace.t_us == _NEVER or dt < 0.0:
        return PdoRate(t_us, 0.0, pace.doubled_us)
    excess = pace.excess + 1.0 - dt
    if 0.5 <= dt <= 1.5:  # a regular frame: the nearest multiple of the period is one
        excess = max(excess, FORGOTTEN * excess)
    if excess > EXCESS:
        return PdoRate(t_us, 1.0, t_us)  # the next two frames of the other one are the next sign
    return PdoRate(t_us, excess, pace.doubled_us)


@dataclass(frozen=True)
class Supervisor:
    """Watches nodes and identifiers. Pure: every method returns the new state, or a verdict."""

    service: Service

    @cached_property
    def _nodes(self) -> dict[int, int]:
        return {_HEARTBEAT + node.node_id: k for k, node in enumerate(self.service.nodes)}

    @cached_property
    def pdos(self) -> tuple[tuple[SensorNode, Pdo], ...]:
        """Every PDO and who sends it, in the order of `Senders.pdos`."""
        return tuple((node, pdo) for node in self.service.nodes for pdo in node.pdos)

    @cached_property
    def _places(self) -> dict[int, int]:
        return {pdo.can_id: k for k, (_, pdo) in enumerate(self.pdos)}

    @cached_property
    def _periods_us(self) -> tuple[float, ...]:
        """Shortest periods."""
        return tuple(1e6 * pdo.period_s * (1.0 - FAST_CLOCK) for _, pdo in self.pdos)

    @cached_property
    def _patience_us(self) -> tuple[float, ...]:
        """Of each PDO's node, the time after which it counts as lost."""
        return tuple(1e6 * CONSUMER_FACTOR * node.heartbeat_s for node, _ in self.pdos)

    @cached_property
    def _watching(self) -> tuple[int, ...]:
        """The place of each PDO's node among the nodes."""
        return tuple(self._nodes[_HEARTBEAT + node.node_id] for node, _ in self.pdos)

    @cached_property
    def _signals(self) -> tuple[tuple[int, ...], ...]:
        """Numbers of the signals that each PDO carries."""
        number = {signal.name: k for k, signal in enumerate(self.service.machine.signals)}
        return tuple(tuple(number[f.signal] for f in pdo.fields if f.signal in number) for _, pdo in self.pdos)

    @cached_property
    def ours(self) -> frozenset[int]:
        """The identifiers that only our node sends."""
        own = self.service.node_id
        pdos = (pdo.can_id for pdo in self.service.publication)
        return frozenset({*pdos, _EMERGENCY + own, _ANSWER + own, _HEARTBEAT + own})

    def begin(self) -> Senders:
        """The state before any frame."""
        return Senders((LastHeartbeat(),) * len(self.service.nodes), (PdoRate(),) * len(self.pdos))

    def received(self, watched: Senders, frame: Frame) -> Senders:
        """The state after a frame."""
        place = self._places.get(frame.can_id)
        if place is not None:
            before = watched.pdos[place]
            pace = advanced(before, frame.t_us, self._periods_us[place])
            watched = Senders(watched.nodes, _with(watched.pdos, place, pace), watched.ours_us)
            if before.t_us != _NEVER and 0 <= frame.t_us - before.t_us <= self._patience_us[place]:
                return watched
            return self._after_pause(watched, self.pdos[place][0], frame.t_us)
        node = self._nodes.get(frame.can_id)
        if node is not None and len(frame.data) == 1:
            heard = LastHeartbeat(frame.t_us, frame.data[0] & 0x7F)
            return watched._replace(nodes=_with(watched.nodes, node, heard))
        return watched._replace(ours_us=frame.t_us) if frame.can_id in self.ours else watched

    def _after_pause(self, senders: Senders, node: SensorNode, t_us: int) -> Senders:
        """With the first PDO after a boot, after a pause, or after a leap of the clock, the heartbeat has its whole
        time (once more)."""
        k = self._nodes[_HEARTBEAT + node.node_id]
        heard = senders.nodes[k]
        if heard.t_us == _NEVER and not heard.booted:
            return senders
        return senders._replace(nodes=_with(senders.nodes, k, heard._replace(t_us=t_us)))

    def restarted(self, watched: Senders, node_id: int) -> Senders:
        """The state after a node booted: what was known of it is forgotten."""
        nodes = tuple(
            LastHeartbeat(booted=True) if node.node_id == node_id else heard
            for node, heard in zip(self.service.nodes, watched.nodes, strict=True)
        )
        pdos = tuple(
            PdoRate() if node.node_id == node_id else pace
            for (node, _), pace in zip(self.pdos, watched.pdos, strict=True)
        )
        return watched._replace(nodes=nodes, pdos=pdos)

    def doubled(self, watched: Senders, t_us: int) -> tuple[Pdo, ...]:
        """The PDOs that more than one node sends."""
        return tuple(pdo for (_, pdo), pace in zip(self.pdos, watched.pdos, strict=True) if pace.doubled(t_us))

    def reasons(self, watched: Senders, t_us: int) -> dict[int, Reason]:
        """The signals that are not to be used now, and why."""
        return dict(self._distrusted(watched, t_us))

    def _distrusted(self, watched: Senders, t_us: int) -> Iterator[tuple[int, Reason]]:
        for k, pace in enumerate(watched.pdos):
            if not _runs(watched.nodes[self._watching[k]], self._patience_us[k], pace):
                yield from ((signal, Reason.NOT_OPERATIONAL) for signal in self._signals[k])
            if abs(t_us - pace.doubled_us) < QUIET_US:
                yield from ((signal, Reason.TWO_PRODUCERS) for signal in self._signals[k])


def _with(of: tuple[T, ...], place: int, item: T) -> tuple[T, ...]:
    return (*of[:place], item, *of[place + 1 :])


def _runs(heard: LastHeartbeat, patience_us: float, pace: PdoRate) -> bool:
    """Whether a node was operational and alive when its PDO came; a heartbeat that was never heard is not missed."""
    if heard.t_us == _NEVER or patience_us <= 0.0:
        return True
    return heard.state == _OPERATIONAL and pace.t_us - heard.t_us <= patience_us
