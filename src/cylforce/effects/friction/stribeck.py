"""The extra friction of break-away: f exp(-(v / width)^2) sgn(v)."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class Stribeck:
    """The extra friction of break-away: f exp(-(v / width)^2) sgn(v)."""

    width: float = 0.015  # m/s
    rounding: float = 0.0005  # m/s

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "stribeck",
            "N",
            200.0,
            1e4,
            Place.CYLINDER,
            "below the speed `width`, gone above it",
            "creep both ways at 3 to 30 mm/s",
            1,
            form=0.2,  # widths, ways and powers differ from machine to machine
        )

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """exp(-(v / width)^2) sgn(v)."""
        fading = np.exp(-((speed / self.width) ** 2))
        return np.asarray(fading * np.tanh(speed / self.rounding))
