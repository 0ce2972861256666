"""Viscous friction of a cylinder."""

from dataclasses import dataclass
from typing import ClassVar

from cylforce.effects.fault import About, Place
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class ViscousFriction:
    """Friction in proportion to the cylinder's speed: force f v. As a fault: by how much it is larger than in the
    model."""

    depends_on: ClassVar[tuple[str, ...]] = ("speed", "lever")

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "viscous_friction",
            "N s/m",
            1e3,
            1e5,
            Place.CYLINDER,
            "at speed, nothing at creep",
            "the same stroke at three speeds: the difference grows in proportion",
        )

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """Force per N s/m of f: the speed v [m/s]."""
        return speed
