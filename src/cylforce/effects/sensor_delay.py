"""A sensor that tells what was: its values are late."""

from dataclasses import dataclass

import numpy as np

from cylforce.machine.candidate import About, Place
from cylforce.machine.machine import Machine
from cylforce.words.estimate import Array


@dataclass(frozen=True, slots=True)
class SensorDelay:
    """A sensor that tells what was: its values are late."""

    @property
    def about(self) -> About:
        """What it says of itself."""
        return About(
            "sensor_delay",
            "s",
            0.008,
            0.2,
            Place.SENSOR,
            "while the motion changes, nothing at constant speed",
            "quick starts and stops of that joint alone",
            1,
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """a(t - size), along a line between samples."""
        found = values.copy()
        found[:, where] = np.interp(t - size, t, values[:, where])
        return found
