"""Monitor the heartbeats of other nodes (1016h): which have booted, changed their state, or stopped sending."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from cylforce.signals.identifiers import HEARTBEAT

BOOTED = 0  # state byte of a boot-up message
STOPPED, OPERATIONAL, PRE_OPERATIONAL = 4, 5, 127  # NMT states in a heartbeat

OnPeer = Callable[[int, int | None], None]  # (node number, NMT state; None: silent)


@dataclass(slots=True)
class _Peer:
    """A monitored node.

    timeout_us: consumer time [us]
    state: NMT state in its last heartbeat; None: none was received yet, or it stopped sending
    last_us: time of its last heartbeat [us]
    """

    timeout_us: int
    state: int | None = None
    last_us: int = 0


class Heartbeats:
    """Monitors other nodes, each from its first message on (CiA 301).

    on_peer: called with node number and NMT state at each boot-up (0) and each change of state (4, 5, 127), of
        which the first heartbeat, also after silence, is one; called with None when no heartbeat has come for longer
        than the consumer time
    silent: numbers of the nodes that were present and stopped sending
    """

    def __init__(self, on_peer: OnPeer) -> None:
        self._on_peer = on_peer
        self._peers: dict[int, _Peer] = {}
        self.silent: set[int] = set()

    def watch(self, entries: Iterable[tuple[int, int]]) -> None:
        """Monitor exactly these nodes: (node number, consumer time [us]).

        An entry with a 0 is ignored. A node that was monitored before keeps its state and the time of its last
        heartbeat.
        """
        wanted = {node_id: timeout_us for node_id, timeout_us in entries if node_id and timeout_us}
        self._peers = {node_id: self._peers.get(node_id) or _Peer(us) for node_id, us in wanted.items()}
        for node_id, peer in self._peers.items():
            peer.timeout_us = wanted[node_id]
        self.silent &= wanted.keys()

    def state(self, node_id: int) -> int | None:
        """Return the last NMT state of a node; None: no heartbeat yet, silent, or not monitored."""
        peer = self._peers.get(node_id)
        return None if peer is None else peer.state

    def on_heartbeat(self, can_id: int, data: bytes | bytearray, t_us: int) -> None:
        """Store the state and time of a heartbeat, and report a boot-up or a change of state.

        A malformed heartbeat, or one of a node that is not monitored, is ignored.

        can_id: identifier, 700h + node number
        data: NMT state in the lower 7 bits of one byte
        t_us: time of the frame [us]
        """
        peer = self._peers.get(can_id - HEARTBEAT)
        if peer is None or len(data) != 1:
            return
        state, before = data[0] & 0x7F, peer.state
        peer.state, peer.last_us = state, t_us
        self.silent.discard(can_id - HEARTBEAT)
        if state == BOOTED or state != before:
            self._on_peer(can_id - HEARTBEAT, state)

    def poll(self, t_us: int) -> None:
        """Report the nodes whose heartbeat is overdue at `t_us` [us]."""
        for node_id, peer in self._peers.items():
            if peer.state is not None and t_us - peer.last_us > peer.timeout_us:
                peer.state = None
                self.silent.add(node_id)
                self._on_peer(node_id, None)
