"""Viscous friction of a cylinder."""

from dataclasses import dataclass
from typing import ClassVar

from cylforce.effects.fault import About, Place, RunToRun
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class ViscousFriction:
    """Friction in proportion to the cylinder's speed: force f v. As a fault: by how much it is larger than in the
    model."""

    depends_on: ClassVar[tuple[str, ...]] = ("speed", "lever")

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="viscous_friction",
            unit="N s/m",
            low=1e3,
            high=1e5,
            place=Place.CYLINDER,
            shows="at speed, nothing at creep",
            confirm="the same stroke at three speeds: the difference grows in proportion",
            varies=RunToRun.VARYING,
        )

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """Return the force [N] per N s/m of f, shaped as `speed`: the speed v [m/s]."""
        return speed
