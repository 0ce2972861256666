"""How much of a CAN bus a machine's traffic takes: every frame at its longest, PDOs, SYNC and heartbeats."""

from collections.abc import Iterator
from typing import NamedTuple

from cylforce.mechanics.installation import Service

BIT_RATES = (125_000, 250_000, 500_000, 1_000_000)  # bit/s that CiA 301 has
BUSY = 0.5  # of the bit rate: above it, low priorities wait for several frames


class Traffic(NamedTuple):
    """Frames of one identifier: what they are, how many bytes of data each has, how many come in a second."""

    what: str
    can_id: int
    data_bytes: int
    per_second: float

    @property
    def bits_per_second(self) -> float:
        """At the longest, stuff bits included."""
        return self.per_second * longest_frame(self.data_bytes)


def longest_frame(data_bytes: int) -> int:
    """Bits of a frame with an 11-bit identifier and `data_bytes` bytes of data, with the most stuff bits that can be
    and the pause of 3 bits behind it: 8 n + g + 13 + floor((g + 8 n - 1)/4), g = 34 (Davis, Burns, Bril, Lukkien:
    Controller Area Network (CAN) schedulability analysis, Real-Time Systems 35, 2007, equation 1)."""
    stuffed = 34 + 8 * data_bytes
    return stuffed + 13 + (stuffed - 1) // 4


def traffic(service: Service) -> tuple[Traffic, ...]:
    """All that goes over the bus while the service runs; without SDO transfers, of which there are few after start."""
    return tuple(_traffic(service))


def _traffic(service: Service) -> Iterator[Traffic]:
    if service.sync_producer:
        yield Traffic("SYNC", 0x80, 0, service.filters.rate_hz)
    for node in service.nodes:
        for pdo in node.pdos:
            yield Traffic(f"{node.name} TPDO {pdo.number}", pdo.can_id, pdo.length, 1.0 / pdo.period_s)
        if node.heartbeat_s > 0.0:
            yield Traffic(f"{node.name} heartbeat", 0x700 + node.node_id, 1, 1.0 / node.heartbeat_s)
    for pdo in service.publication:
        yield Traffic(f"cylforce TPDO {pdo.number}", pdo.can_id, pdo.length, 1.0 / pdo.period_s)
    yield Traffic("cylforce heartbeat", 0x700 + service.node_id, 1, 1.0 / service.heartbeat_s)
