"""A pressure sensor whose zero wanders while it works: size t / hour."""

from dataclasses import dataclass

from cylforce.machine.candidate import About, Place
from cylforce.machine.machine import Machine
from cylforce.words.estimate import Array


@dataclass(frozen=True, slots=True)
class PressureDrift:
    """A pressure sensor whose zero wanders while it works: size t / hour."""

    @property
    def about(self) -> About:
        """What it says of itself."""
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
        """p + size t, t in hours from the recording's start."""
        found = values.copy()
        found[:, where] += size * t / 3600.0
        return found
