"""The tool touches something where the model has it in the air."""

from dataclasses import dataclass

from cylforce.machine.candidate import About, Course, Place


@dataclass(frozen=True, slots=True)
class SoilContact:
    """The tool touches something where the model has it in the air."""

    @property
    def about(self) -> About:
        """What it says of itself."""
        return About(
            "soil_contact",
            "N",
            1e3,
            1e5,
            Place.TOOL,
            "for some seconds at a time, in all joints as one force at the teeth",
            "the same moves higher above the ground",
            axes=6,
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns whose sizes change."""
        return ("tip.x.0", "tip.z.0", "tip.x.1", "tip.z.1", "tip.x.2", "tip.z.2")

    @property
    def course(self) -> Course:
        """How they change."""
        return Course.WINDOWS
