"""Nodes and identifiers to supervise: heartbeats, a second producer of an identifier, another sender of ours."""

from cylforce.mechanics.installation import SensorNode, Service
from cylforce.signals.identifiers import EMCY, HEARTBEAT, SDO_RESPONSE
from cylforce.signals.layout import Pdo

CONSUMER_FACTOR = 3  # a node counts as lost after three missing heartbeats
FAST_CLOCK = 0.0158  # largest tolerance of a CAN node's oscillator (Bosch, CAN Specification 2.0, chapter 9)


class Supervisor:
    """Nodes and identifiers that are supervised.

    pdos:        every PDO with the node that sends it
    nodes:       number of each node, by the identifier of its heartbeat
    periods_us:  shortest period of each PDO [us]
    patience_us: time without a heartbeat after which the node of each PDO counts as lost [us]
    senders:     number of each PDO's node
    ours:        identifiers that only our node sends
    """

    def __init__(self, service: Service) -> None:
        """Collect nodes, PDOs and identifiers of the machine file's `service` settings.

        A node's clock may be fast by FAST_CLOCK, which shortens the period of its PDOs. Our own identifiers are those
        of our PDOs, emergency messages, SDO answers and heartbeat (CiA 301)."""
        self.nodes = {HEARTBEAT + node.node_id: number for number, node in enumerate(service.nodes)}
        self.pdos: tuple[tuple[SensorNode, Pdo], ...] = tuple((n, pdo) for n in service.nodes for pdo in n.pdos)
        self.periods_us = tuple(1e6 * pdo.period_s * (1.0 - FAST_CLOCK) for _, pdo in self.pdos)
        self.patience_us = tuple(1e6 * CONSUMER_FACTOR * node.heartbeat_s for node, _ in self.pdos)
        self.senders = tuple(self.nodes[HEARTBEAT + node.node_id] for node, _ in self.pdos)
        own = service.node_id
        published = (pdo.can_id for pdo in service.publication)
        self.ours = frozenset({*published, EMCY + own, SDO_RESPONSE + own, HEARTBEAT + own})
