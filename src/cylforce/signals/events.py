"""Inputs of the service: frames and ticks, each with its time in integer microseconds. It has no other input."""

from typing import NamedTuple

# Flag bits of SocketCAN (linux/can.h) in the identifier. A flagged frame matches no table of 11-bit identifiers.
EXTENDED = 0x80000000
REMOTE = 0x40000000
ERROR = 0x20000000
EXACTLY = EXTENDED | REMOTE | 0x7FF  # a mask: this 11-bit identifier and no other frame


class Frame(NamedTuple):
    """A CAN frame received.

    t_us:   time [us]
    can_id: identifier with SocketCAN's flag bits
    data:   0 to 8 bytes
    """

    t_us: int
    can_id: int
    data: bytes


class Tick(NamedTuple):
    """Time of one step of the estimator.

    t_us: [us]
    """

    t_us: int


Event = Frame | Tick
