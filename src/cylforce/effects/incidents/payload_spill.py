"""A part of the load falls out."""

from dataclasses import dataclass

from cylforce.effects.fault import About, Place, TimeCourse


@dataclass(frozen=True, slots=True)
class PayloadSpill:
    """A part of the load falls out."""

    @property
    def about(self) -> About:
        """What it says of itself."""
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
        """The columns whose sizes change."""
        return ("load.mass", "load.X", "load.Z")

    @property
    def course(self) -> TimeCourse:
        """How they change."""
        return TimeCourse.AFTER
