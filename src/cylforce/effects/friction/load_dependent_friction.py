"""Friction that grows with the force that the seals and pins carry: a |F| sgn(v)."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class LoadDependentFriction:
    """Friction that grows with the force that the seals and pins carry, in proportion or ever less."""

    rounding: float = 0.002  # m/s
    easing: float = 0.0  # 1/N, one over the force about which it saturates: a seal that is pressed on fully

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "load_dependent_friction",
            "1",
            0.004,
            0.08,
            Place.CYLINDER,
            "in motion, more under load",
            "the same slow strokes empty and with a known load",
        )

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """|F| sgn(v), or (1 - exp(-e |F|)) / e sgn(v)."""
        load = -np.expm1(-self.easing * np.abs(force)) / self.easing if self.easing else np.abs(force)
        return np.asarray(load * np.tanh(speed / self.rounding))
