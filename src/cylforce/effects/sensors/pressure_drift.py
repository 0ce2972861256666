"""A pressure sensor whose zero wanders while it works."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class PressureDrift:
    """A pressure sensor whose zero wanders while it works: size t / hour, and as it gets warm ever less."""

    fading: float = 0.0  # 1/s, how fast it gets warm

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "pressure_drift",
            "Pa/h",
            4e5,
            2e8,
            Place.PRESSURE,
            "more and more as the recording goes on",
            "the zero before and after the shift",
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """p + size t, t in hours from the recording's start; p + size (1 - exp(-f t)) / f if that fades."""
        since = -np.expm1(-self.fading * t) / self.fading if self.fading else t
        found = values.copy()
        found[:, where] += size * since / 3600.0
        return found
