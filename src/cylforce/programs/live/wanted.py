"""Frames that our node needs: its sensors', its own requests, and its own identifiers, which nobody else may use."""

from collections.abc import Iterable

from cylforce.can.bus import Filter
from cylforce.canopen import j1939
from cylforce.mechanics.installation import Service
from cylforce.service.senders.supervision import Supervisor
from cylforce.signals.events import EXACTLY
from cylforce.signals.identifiers import EMCY, HEARTBEAT, NMT, SDO_REQUEST, SDO_RESPONSE, SYNC


def wanted(service: Service, subscribed: Iterable[int] = ()) -> tuple[Filter, ...]:
    """Return filters for `Bus.accept`.

    subscribed: further identifiers that the node needs (1016h may have been changed)
    """
    found = {NMT, SYNC, SDO_REQUEST + service.node_id, *Supervisor(service).ours, *subscribed}
    for node in service.nodes:
        found |= {base + node.node_id for base in (EMCY, SDO_RESPONSE, HEARTBEAT)}
        found |= {pdo.can_id for pdo in node.pdos}
    exact = tuple((can_id, EXACTLY) for can_id in sorted(found) if can_id <= 0x7FF)
    return exact + (() if service.j1939_address is None else j1939.filters())
