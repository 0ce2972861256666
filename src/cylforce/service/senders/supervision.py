"""Who sends: whether each node's heartbeat goes on, whether only one node sends each identifier, and whether somebody
else sends ours. Pure, so that a replay of the log gives the same verdicts."""

from array import array
from dataclasses import dataclass

from cylforce.estimation.kernel.inputs import SENDER
from cylforce.mechanics.installation import SensorNode, Service
from cylforce.service.senders.inputs import QUIET_US, Inputs, LastHeartbeat, PdoRate
from cylforce.signals.events import Frame
from cylforce.signals.layout import Pdo
from cylforce.signals.quick import once

CONSUMER_FACTOR = 3  # a node counts as lost after three missing heartbeats
FAST_CLOCK = 0.0158  # largest tolerance of a CAN node's oscillator (Bosch, CAN Specification 2.0, chapter 9)
_HEARTBEAT, _EMERGENCY, _ANSWER = 0x700, 0x80, 0x580


@dataclass(frozen=True)
class Supervisor:
    """Watches nodes and identifiers. Pure: every method returns the new state, or a verdict."""

    service: Service

    @once
    def _nodes(self) -> dict[int, int]:
        return {_HEARTBEAT + node.node_id: k for k, node in enumerate(self.service.nodes)}

    @once
    def pdos(self) -> tuple[tuple[SensorNode, Pdo], ...]:
        """Every PDO and who sends it, in the order of `Senders.pdos`."""
        return tuple((node, pdo) for node in self.service.nodes for pdo in node.pdos)

    @once
    def periods_us(self) -> tuple[float, ...]:
        """Shortest periods."""
        return tuple(1e6 * pdo.period_s * (1.0 - FAST_CLOCK) for _, pdo in self.pdos)

    @once
    def patience_us(self) -> tuple[float, ...]:
        """Of each PDO's node, the time after which it counts as lost."""
        return tuple(1e6 * CONSUMER_FACTOR * node.heartbeat_s for node, _ in self.pdos)

    @once
    def senders(self) -> tuple[int, ...]:
        """The place of each PDO's node among the nodes."""
        return tuple(self._nodes[_HEARTBEAT + node.node_id] for node, _ in self.pdos)

    @once
    def ours(self) -> frozenset[int]:
        """The identifiers that only our node sends."""
        own = self.service.node_id
        pdos = (pdo.can_id for pdo in self.service.publication)
        return frozenset({*pdos, _EMERGENCY + own, _ANSWER + own, _HEARTBEAT + own})

    def received(self, inputs: Inputs, frame: Frame) -> Inputs:
        """The state after a frame that is no sensor's PDO."""
        node = self._nodes.get(frame.can_id)
        if node is not None and len(frame.data) == 1:
            o, kept = inputs.place_of_node(node), inputs.kept[:]
            kept[o], kept[o + 1], kept[o + 2] = frame.t_us, frame.data[0] & 0x7F, 0.0
            return Inputs(kept, inputs.sizes)
        if frame.can_id in self.ours:
            return Inputs(inputs.kept[:-1] + array("d", [frame.t_us]), inputs.sizes)
        return inputs

    def restarted(self, inputs: Inputs, node_id: int) -> Inputs:
        """The state after a node booted: what was known of it is forgotten."""
        kept = inputs.kept[:]
        for k, node in enumerate(self.service.nodes):
            if node.node_id == node_id:
                o = inputs.place_of_node(k)
                kept[o : o + SENDER] = array("d", LastHeartbeat(booted=1.0))
        for k, (node, _) in enumerate(self.pdos):
            if node.node_id == node_id:
                o = inputs.place_of_pdo(k)
                kept[o : o + SENDER] = array("d", PdoRate())
        return inputs._replace(kept=kept)

    def doubled(self, inputs: Inputs, t_us: int) -> tuple[Pdo, ...]:
        """The PDOs that more than one node sends."""
        last = inputs.kept[inputs.place_of_pdo(0) + 2 : inputs.place_of_node(0) : SENDER]
        return tuple([self.pdos[k][1] for k, at in enumerate(last) if abs(t_us - at) < QUIET_US])
