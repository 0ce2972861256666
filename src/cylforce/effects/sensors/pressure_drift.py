"""A drift of a pressure sensor's zero."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class PressureDrift:
    """A drift of a pressure sensor's zero: size [Pa/h] times the time, or, with `fading`, ever slower as the sensor
    becomes warm."""

    fading: float = 0.0  # 1/s, inverse of the sensor's thermal time constant; 0: the drift goes on

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="pressure_drift",
            unit="Pa/h",
            low=4e5,
            high=2e8,
            place=Place.PRESSURE,
            shows="more and more as the recording goes on",
            confirm="the zero before and after the shift",
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Range of `fading`: from a constant drift to a sensor that is warm within 20 s."""
        return (ShapeRange("fading", 0.0, 1.0 / 20.0, log=True, shift=1.0 / 2000.0),)

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with pressure `where` changed to p + size t [Pa].

        With `fading` f it is p + size (1 - exp(-f t)) / f.

        t:    (T,) time since the start of the recording [s]
        size: of the drift [Pa/h]
        """
        drifting_s = -np.expm1(-self.fading * t) / self.fading if self.fading else t
        found = values.copy()
        found[:, where] += size * drifting_s / 3600.0
        return found
