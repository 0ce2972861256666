"""A load of which a part falls out."""

from dataclasses import dataclass

from cylforce.effects.fault import About, Place, TimeCourse


@dataclass(frozen=True, slots=True)
class PayloadSpill:
    """A load of which a part falls out: its mass and first moments change at one instant, until the bucket is emptied.
    The next load is whole."""

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "payload_spill",
            "kg",
            40.0,
            3e3,
            Place.TOOL,
            "from one instant on, like a smaller load",
            "weigh what is left",
            -1,
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns whose sizes change during the incident (see `fault.INCIDENTAL`)."""
        return ("load.mass", "load.X", "load.Z")

    @property
    def course(self) -> TimeCourse:
        """How these sizes change with time."""
        return TimeCourse.AFTER
