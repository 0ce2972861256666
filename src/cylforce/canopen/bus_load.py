"""Load of a CAN bus by a machine's traffic: every frame at its longest, PDOs, SYNC and heartbeats."""

from collections.abc import Iterator
from typing import NamedTuple

from cylforce.mechanics.installation import Service
from cylforce.signals.identifiers import HEARTBEAT, SYNC

BIT_RATES = (125_000, 250_000, 500_000, 1_000_000)  # bit/s, of CiA 301
BUSY = 0.5  # share of the bit rate above which low priorities wait for several frames; chosen


class Traffic(NamedTuple):
    """Frames of one identifier.

    what: name for a table
    can_id: identifier
    data_bytes: bytes of data in each frame
    per_second: frames in a second
    """

    what: str
    can_id: int
    data_bytes: int
    per_second: float

    @property
    def bits_per_second(self) -> float:
        """Return the load [bit/s] with frames at their longest, stuff bits included."""
        return self.per_second * longest_frame(self.data_bytes)


def longest_frame(data_bytes: int) -> int:
    """Return the number of bits of the longest frame with an 11-bit identifier and `data_bytes` bytes of data.

    8 n + g + 13 + floor((g + 8 n - 1)/4), g = 34, with the most possible stuff bits and the pause of 3 bits behind the
    frame (Davis, Burns, Bril, Lukkien: Controller Area Network (CAN) schedulability analysis, Real-Time Systems 35,
    2007, equation 1).
    """
    stuffed = 34 + 8 * data_bytes
    return stuffed + 13 + (stuffed - 1) // 4


def traffic(service: Service) -> Iterator[Traffic]:
    """Yield the cyclic traffic on the bus while the service runs.

    SDO transfers are excluded: there are few after the start.
    """
    if service.sync_producer:
        yield Traffic("SYNC", SYNC, 0, service.filters.rate_hz)
    for node in service.nodes:
        for pdo in node.pdos:
            yield Traffic(f"{node.name} TPDO {pdo.number}", pdo.can_id, pdo.length, 1.0 / pdo.period_s)
        if node.heartbeat_s > 0.0:
            yield Traffic(f"{node.name} heartbeat", HEARTBEAT + node.node_id, 1, 1.0 / node.heartbeat_s)
    for pdo in service.publication:
        yield Traffic(f"cylforce TPDO {pdo.number}", pdo.can_id, pdo.length, 1.0 / pdo.period_s)
    yield Traffic("cylforce heartbeat", HEARTBEAT + service.node_id, 1, 1.0 / service.heartbeat_s)
