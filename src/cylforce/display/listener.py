"""What a listener on the bus knows: the last PDOs of the service, the sensors' signals, nodes, traffic."""

from collections import deque
from typing import NamedTuple

from cylforce.canopen.bus_load import longest_frame
from cylforce.mechanics.installation import Service
from cylforce.service.assembler import Assembler
from cylforce.service.commands import ZERO
from cylforce.signals.codec import decode
from cylforce.signals.estimate import Sample
from cylforce.signals.events import Frame

LATE_US = 500_000  # from this age on a published value is not shown; chosen
SECOND_US = 1_000_000
ZEROED = bytes((0x60, ZERO & 0xFF, ZERO >> 8, 1))  # the SDO answer to a zero that was done


class ReceivedPdo(NamedTuple):
    """The last data of a PDO, and when it came [us]."""

    t_us: int
    data: bytes


class NodeState(NamedTuple):
    """A node's last NMT state and when it said so [us]."""

    state: int
    t_us: int


class Listener:
    """Takes frames; every question is answered for a time [us]."""

    def __init__(self, service: Service) -> None:
        self.service = service
        self._assembler = Assembler(service)
        self._inputs = self._assembler.begin()
        self._still = self._assembler.still
        self._ours = {pdo.can_id: pdo for pdo in service.publication}
        self._heard: dict[int, ReceivedPdo] = {}
        self.nodes: dict[int, NodeState] = {}
        self.emergencies: dict[int, int] = {}
        self._traffic: deque[tuple[int, int]] = deque()
        self._bits = 0
        self.zeroed_us = 0  # when the service last obeyed a zero command

    def on_frame(self, frame: Frame) -> None:
        """A frame from the bus."""
        self._count(frame)
        kind, node = frame.can_id & ~0x7F, frame.can_id & 0x7F
        if frame.can_id in self._ours:
            self._heard[frame.can_id] = ReceivedPdo(frame.t_us, frame.data)
        elif frame.can_id in self._assembler.decoders:
            self._inputs = self._assembler.receive(self._inputs, (frame,), self._still)
        elif frame.can_id == 0x580 + self.service.node_id and frame.data[:4] == ZEROED:
            self.zeroed_us = frame.t_us
        elif kind == 0x700 and len(frame.data) == 1:
            self.nodes[node] = NodeState(frame.data[0] & 0x7F, frame.t_us)
        elif kind == 0x080 and node and len(frame.data) >= 2:
            self.emergencies[node] = int.from_bytes(frame.data[:2], "little")

    def _count(self, frame: Frame) -> None:
        bits = longest_frame(len(frame.data))
        self._traffic.append((frame.t_us, bits))
        self._bits += bits
        self._forget(frame.t_us)

    def _forget(self, t_us: int) -> None:
        while self._traffic and t_us - self._traffic[0][0] > SECOND_US:
            self._bits -= self._traffic.popleft()[1]

    def bits_per_second(self, t_us: int) -> int:
        """Traffic of the last second, every frame at its longest."""
        self._forget(t_us)
        return self._bits

    def values(self, t_us: int) -> dict[str, float]:
        """Published SI values by name, NaN for "no value"; those of PDOs that are late or too short are missing."""
        found: dict[str, float] = {}
        for can_id, pdo in self._ours.items():
            heard = self._heard.get(can_id)
            if heard and t_us - heard.t_us < LATE_US and len(heard.data) >= pdo.length:
                found |= decode(pdo, heard.data)
        return found

    def sample(self, t_us: int) -> Sample:
        """All signals, with their ages and the reasons why they are not usable."""
        return self._assembler.sample(self._inputs, t_us)

    def ages(self, t_us: int) -> tuple[float, ...]:
        """Age [s] of each signal's last value; infinite where there never was one."""
        return self._assembler.ages(self._inputs, t_us)
