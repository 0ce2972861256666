"""Everything that ever enters the service: frames and ticks, each with its time in integer microseconds."""

from typing import NamedTuple

EXTENDED = 0x80000000  # SocketCAN's flag bits: a foreign frame simply misses every table of 11-bit identifiers
REMOTE = 0x40000000
ERROR = 0x20000000


class Frame(NamedTuple):
    """A CAN frame received: time `t_us`, identifier with SocketCAN's flag bits, 0..8 bytes of data."""

    t_us: int
    can_id: int
    data: bytes


class Tick(NamedTuple):
    """The moment of one step of the estimator."""

    t_us: int


Event = Frame | Tick
