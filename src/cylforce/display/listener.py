"""Values received from the bus: the last PDOs of the service, the sensors' signals, nodes, bus load."""

from collections import deque
from typing import NamedTuple

from cylforce.canopen.bus_load import longest_frame
from cylforce.mechanics.installation import Service
from cylforce.service.assembler import assembler
from cylforce.service.commands import ZERO
from cylforce.signals.codec import decode
from cylforce.signals.estimate import Sample
from cylforce.signals.events import Frame
from cylforce.signals.identifiers import EMCY, HEARTBEAT, SDO_RESPONSE

LATE_US = 500_000  # us, age from which on a published value is not shown; chosen
SECOND_US = 1_000_000
ZEROED = bytes((0x60, ZERO & 0xFF, ZERO >> 8, 1))  # the SDO answer to a zero that was done


class ReceivedPdo(NamedTuple):
    """The last data of a PDO.

    t_us: time of reception [us]
    data: its data
    """

    t_us: int
    data: bytes


class NodeState(NamedTuple):
    """The last NMT state of a node.

    state: the state
    t_us: time of its heartbeat [us]
    """

    state: int
    t_us: int


class Listener:
    """Receives frames and returns values at a time [us].

    service: settings of the service
    nodes: last state of each node, by number
    emergencies: last error code of each node, by number
    zeroed_us: time at which the service last executed a zero command [us]
    """

    def __init__(self, service: Service) -> None:
        self.service = service
        self._inputs = assembler(service)
        self._ours = {pdo.can_id: pdo for pdo in service.publication}
        self._received: dict[int, ReceivedPdo] = {}
        self.nodes: dict[int, NodeState] = {}
        self.emergencies: dict[int, int] = {}
        self._traffic: deque[tuple[int, int]] = deque()  # time [us] and bits of the frames of the last second
        self._bits = 0  # their sum
        self.zeroed_us = 0

    def on_frame(self, frame: Frame) -> None:
        """Process a frame from the bus."""
        self._count(frame)
        kind, node = frame.can_id & ~0x7F, frame.can_id & 0x7F
        if frame.can_id in self._ours:
            self._received[frame.can_id] = ReceivedPdo(frame.t_us, frame.data)
        elif frame.can_id in self._inputs.constants.decoders:
            self._inputs.receive((frame,))
        elif frame.can_id == SDO_RESPONSE + self.service.node_id and frame.data[:4] == ZEROED:
            self.zeroed_us = frame.t_us
        elif kind == HEARTBEAT and len(frame.data) == 1:
            self.nodes[node] = NodeState(frame.data[0] & 0x7F, frame.t_us)
        elif kind == EMCY and node and len(frame.data) >= 2:
            self.emergencies[node] = int.from_bytes(frame.data[:2], "little")

    def _count(self, frame: Frame) -> None:
        """Add a frame to the bus load."""
        bits = longest_frame(len(frame.data))
        self._traffic.append((frame.t_us, bits))
        self._bits += bits
        self._forget(frame.t_us)

    def _forget(self, t_us: int) -> None:
        """Drop frames older than a second from the bus load."""
        while self._traffic and t_us - self._traffic[0][0] > SECOND_US:
            self._bits -= self._traffic.popleft()[1]

    def bits_per_second(self, t_us: int) -> int:
        """Return the bus load of the last second [bit/s], every frame at its longest."""
        self._forget(t_us)
        return self._bits

    def values(self, t_us: int) -> dict[str, float]:
        """Return published SI values by name, NaN for "no value"; those of outdated or short PDOs are
        missing.
        """
        published: dict[str, float] = {}
        for can_id, pdo in self._ours.items():
            received = self._received.get(can_id)
            if received and t_us - received.t_us < LATE_US and len(received.data) >= pdo.length:
                published |= decode(pdo, received.data)
        return published

    def sample(self, t_us: int) -> Sample:
        """Return all signals, with their ages and the reasons why they are not usable."""
        return self._inputs.sample(t_us)

    def ages(self, t_us: int) -> tuple[float, ...]:
        """Return the age [s] of each signal's last value; infinite where there was none."""
        return self._inputs.ages(t_us)
