"""Viscous friction of a cylinder."""

from dataclasses import dataclass
from typing import ClassVar

from cylforce.effects.fault import About, Place, RunToRun
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class ViscousFriction:
    """Friction in proportion to the speed v of a cylinder, which supplies the additional force f v; v > 0: it extends.

    As a fault f is the difference of the coefficient from that of the model: f > 0 is more friction.
    """

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
