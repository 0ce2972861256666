"""A constant error of an angle or length sensor: mounted off its zero, or slipped."""

from dataclasses import dataclass

from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class AngleOffset:
    """A constant error of an angle or length sensor: reading = true value + size [rad or m]."""

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="angle_offset",
            unit="rad (m)",
            low=0.003,
            high=0.06,
            place=Place.ANGLE,
            shows="with the posture, at rest too",
            confirm="each joint at its end stop, or a spirit level on the link",
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with `size` added to signal `where`, an angle [rad] or a length [m]."""
        found = values.copy()
        found[:, where] += size
        return found
