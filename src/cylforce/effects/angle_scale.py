"""An angle (or length) sensor whose scale is off."""

from dataclasses import dataclass

from cylforce.machine.candidate import About, Place
from cylforce.machine.machine import Machine
from cylforce.words.estimate import Array


@dataclass(frozen=True, slots=True)
class AngleScale:
    """An angle (or length) sensor whose scale is off."""

    @property
    def about(self) -> About:
        """What it says of itself."""
        return About(
            "angle_scale",
            "1",
            0.004,
            0.08,
            Place.ANGLE,
            "more the farther from the zero",
            "each joint at both end stops",
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """a (1 + size)."""
        found = values.copy()
        found[:, where] *= 1.0 + size
        return found
