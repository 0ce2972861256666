"""A load that moves in the bucket."""

from dataclasses import dataclass

from cylforce.effects.fault import About, Place, TimeCourse


@dataclass(frozen=True, slots=True)
class PayloadShift:
    """A load that moves in the bucket: its centre changes, its mass does not, until the bucket is emptied."""

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "payload_shift",
            "kg m",
            40.0,
            1e3,
            Place.TOOL,
            "from one instant on, mostly in the last joint",
            "look into the bucket before and after",
            axes=2,
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns whose sizes change during the incident (see `fault.INCIDENTAL`)."""
        return ("load.X", "load.Z")

    @property
    def course(self) -> TimeCourse:
        """How these sizes change with time."""
        return TimeCourse.AFTER
