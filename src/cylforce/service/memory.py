"""Memory of the service, which a restart does not change."""

from dataclasses import dataclass, replace

from cylforce.mechanics.installation import STANDARD
from cylforce.service.booking import Weighed
from cylforce.service.commands import NO_SCALE, Scale
from cylforce.service.loading.truck import NO_TRUCK, Truck
from cylforce.signals.estimate import Booking


@dataclass(frozen=True, slots=True)
class Memory:
    """State that the service keeps over a restart.

    scale:       zero and tare
    truck:       that is being loaded
    booking:     the last booking
    tool:        name of the tool
    hanging:     weight of a loaded bucket that is not booked yet
    lost:        mass of a loaded bucket that may have been emptied during the interruption [kg]; 0: none
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
        """Return the memory for a bucket that may have been emptied, and filled again, since it was weighed.

        The load that was not booked yet (`hanging`) is no longer to be booked; its mass becomes `lost`."""
        return self if self.hanging is None else replace(self, hanging=None, lost=self.hanging.mass)


NOTHING_KEPT = Memory()
