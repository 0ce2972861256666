"""Friction that is larger in one direction than in the other."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class AsymmetricFriction:
    """Friction that is larger in one direction than in the other: force f |sgn(v)|, beside the symmetric f_c sgn(v)."""

    rounding: float = 0.0005  # m/s, speed scale of the smooth sgn(v)

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "asymmetric_friction",
            "N",
            100.0,
            1.8e3,
            Place.CYLINDER,
            "in motion either way, the same sign; nothing at rest",
            "slow strokes both ways, then hold each pose reached from either side: at rest it must vanish",
        )

    @property
    def of_dry(self) -> float:
        """0.3: f is half the difference between both directions, which is taken to be at most 60 % of dry friction."""
        return 0.3

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """Force per newton of f: |sgn(v)|, rounded as |tanh(v / rounding)|."""
        return np.asarray(np.abs(np.tanh(speed / self.rounding)))
