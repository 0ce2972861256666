"""The tool touches something where the model has it in the air."""

from dataclasses import dataclass

from cylforce.machine.candidate import SHAPES, About, Course, Place


@dataclass(frozen=True, slots=True)
class SoilContact:
    """The tool touches something where the model has it in the air."""

    @property
    def about(self) -> About:
        """What it says of itself."""
        return About(
            "soil_contact",
            "N",
            3e3,
            1e5,
            Place.TOOL,
            "for some seconds at a time, in all joints as one force at the teeth",
            "the same moves higher above the ground",
            axes=2 * SHAPES,
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns whose sizes change."""
        return tuple(f"tip.{axis}.{k}" for k in range(SHAPES) for axis in "xz")

    @property
    def course(self) -> Course:
        """How they change."""
        return Course.WINDOWS
