"""Events of the contact between tool and ground."""

from enum import IntEnum
from typing import NamedTuple

KEPT = 32  # events that the service remembers; older ones are in the log


class EventKind(IntEnum):
    """What happened; published as one byte."""

    NONE = 0
    CONTACT_BEGINS = 1
    CONTACT_ENDS = 2
    SOIL_LEFT = 3
    STIFF_OBJECT = 4
    SLOPE_CHANGES = 5


class ContactEvent(NamedTuple):
    """An event: its `number` since the start, time [us], kind, place of the teeth x (forward) and z (up) [m] from the
    first pin, `confidence` 0 to 1."""

    number: int
    t_us: int
    kind: EventKind
    x: float
    z: float
    confidence: float
