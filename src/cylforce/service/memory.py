"""What a restart of the service does not change."""

from dataclasses import dataclass, replace

from cylforce.mechanics.installation import STANDARD
from cylforce.service.booking import Weighed
from cylforce.service.commands import NO_SCALE, Scale
from cylforce.service.loading.truck import NO_TRUCK, Truck
from cylforce.signals.estimate import Booking


@dataclass(frozen=True, slots=True)
class Memory:
    """What the service remembers over a restart.

    scale:       zero and tare
    truck:       that is being loaded
    booking:     the last one
    tool:        name of the tool
    hanging:     weight of a bucket that hangs and is not booked yet
    lost:        mass of a bucket that hung so long ago that it may have been emptied [kg]; 0: none
    unconfirmed: whether the parameters were sealed on another controller, so that they may be another machine's
    """

    scale: Scale = NO_SCALE
    truck: Truck = NO_TRUCK
    booking: Booking | None = None
    tool: str = STANDARD
    hanging: Weighed | None = None
    lost: float = 0.0
    unconfirmed: bool = False

    def emptied(self) -> "Memory":
        """Return the memory when the bucket that hung may have been emptied since, and filled again."""
        return self if self.hanging is None else replace(self, hanging=None, lost=self.hanging.mass)


NOTHING_KEPT = Memory()
