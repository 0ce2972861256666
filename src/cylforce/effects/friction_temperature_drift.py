"""Friction that falls as the oil warms while it works: f v (1 - t / hour), to first order in time."""

from dataclasses import dataclass

import numpy as np

from cylforce.machine.candidate import About, Place
from cylforce.words.estimate import Array


@dataclass(frozen=True, slots=True)
class FrictionTemperatureDrift:
    """Friction that falls as the oil warms while it works: f v (1 - t / hour), to first order in time."""

    @property
    def about(self) -> About:
        """What it says of itself."""
        return About(
            "friction_temperature_drift",
            "N s/m per h",
            2e4,
            2e6,
            Place.CYLINDER,
            "at speed, more and more (or less) as the recording goes on",
            "the same strokes at the start and the end of a shift, oil temperature noted",
        )

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """v t, t in hours."""
        hours = t / 3600.0
        return np.asarray(speed * hours)
