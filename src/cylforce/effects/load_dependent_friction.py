"""Friction that grows with the force that the seals and pins carry: a |F| sgn(v)."""

from dataclasses import dataclass

import numpy as np

from cylforce.machine.candidate import About, Place
from cylforce.words.estimate import Array


@dataclass(frozen=True, slots=True)
class LoadDependentFriction:
    """Friction that grows with the force that the seals and pins carry: a |F| sgn(v)."""

    rounding: float = 0.002  # m/s

    @property
    def about(self) -> About:
        """What it says of itself."""
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
        """|F| sgn(v)."""
        return np.asarray(np.abs(force) * np.tanh(speed / self.rounding))
