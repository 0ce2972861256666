"""Events of the contact between tool and ground."""

from dataclasses import dataclass
from enum import IntEnum
from math import nan

KEPT = 32  # events that the service remembers; older ones are in the log


class EventKind(IntEnum):
    """Kind of an event; published as one byte."""

    NONE = 0
    CONTACT_BEGINS = 1
    CONTACT_ENDS = 2
    SOIL_LEFT = 3
    STIFF_OBJECT = 4
    SLOPE_CHANGES = 5


@dataclass(frozen=True, slots=True)
class ContactEvent:
    """An event at the teeth.

    number:     count of events since the start
    t_us:       time [us]
    kind:       kind of the event
    x, z:       place of the teeth, forward of and above the first pin [m]
    confidence: probability that it happened, 0 to 1
    """

    number: int
    t_us: int
    kind: EventKind
    x: float
    z: float
    confidence: float


# Before the first event
NO_EVENT = ContactEvent(number=0, t_us=0, kind=EventKind.NONE, x=nan, z=nan, confidence=nan)
