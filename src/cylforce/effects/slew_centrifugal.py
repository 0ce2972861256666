"""The house turns and the model does not know: size is the square of its rate."""

from dataclasses import dataclass

from cylforce.machine.candidate import SHAPES, About, Course, Place


@dataclass(frozen=True, slots=True)
class SlewCentrifugal:
    """The house turns and the model does not know: size is the square of its rate."""

    @property
    def about(self) -> About:
        """What it says of itself."""
        return About(
            "slew_centrifugal",
            "rad^2/s^2",
            0.005,
            2.0,
            Place.MACHINE,
            "while the house turns, as the centrifugal force of all links",
            "the same arm motion with the house still",
            1,
            axes=SHAPES,
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns whose sizes change."""
        return tuple(f"slew.{k}" for k in range(SHAPES))

    @property
    def course(self) -> Course:
        """How they change."""
        return Course.WINDOWS
