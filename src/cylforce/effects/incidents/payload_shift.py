"""A load that moves in the bucket."""

from dataclasses import dataclass

from cylforce.effects.fault import About, Place, TimeCourse


@dataclass(frozen=True, slots=True)
class PayloadShift:
    """A load that moves in the bucket: its centre changes, its mass does not, until the bucket is emptied.

    The two sizes are the changes of its first moments X and Z about the last pin, in the last link's frame [kg m].
    """

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="payload_shift",
            unit="kg m",
            low=40.0,
            high=1e3,
            place=Place.TOOL,
            shows="from one instant on, mostly in the last joint",
            confirm="look into the bucket before and after",
            axes=2,
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns whose sizes change during the incident (see `fault.INCIDENTAL`)."""
        return ("load.X", "load.Z")

    @property
    def course(self) -> TimeCourse:
        """Course of the sizes over time."""
        return TimeCourse.AFTER
