"""Dry (Coulomb) friction of a cylinder."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cylforce.effects.fault import About, Place, RunToRun
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class CoulombFriction:
    """Dry friction of a cylinder, which supplies the additional force f sgn(v) against it; v > 0: it extends.

    As a fault f is the difference of the friction from that of the model: f > 0 is more friction.
    """

    depends_on: ClassVar[tuple[str, ...]] = ("speed", "lever")

    rounding: float = 0.002  # m/s, speed scale of the smooth sgn(v)

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="coulomb_friction",
            unit="N",
            low=200.0,
            high=2e4,
            place=Place.CYLINDER,
            shows="in motion, reversing with the direction, whatever the speed",
            confirm="slow strokes both ways at one speed, then at twice that speed: the jump at reversal stays",
            varies=RunToRun.VARYING,
        )

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """Return the force [N] per newton of f, shaped as `speed` v [m/s]: sgn(v), rounded as tanh(v / rounding)."""
        return np.asarray(np.tanh(speed / self.rounding))
