"""The zero of a pressure sensor that settles after the start of the machine."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class PressureZeroSettling:
    """A pressure sensor whose zero is wrong by `size` [Pa] at the start of the recording and settles as the sensor
    becomes warm: reading = p + size exp(-t / settling). A zero that is right at the start and then wanders off is
    `pressure_drift`."""

    settling: float = 300.0  # s, thermal time constant of sensor and block

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="pressure_zero_settling",
            unit="Pa",
            low=0.4e5,
            high=6e5,
            place=Place.PRESSURE,
            shows="at the start of the recording, at rest too, and then less and less",
            confirm="the zero with the lines relieved, before the start and after half an hour",
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Range of `settling`: a diaphragm in oil takes 20 s, a valve block an hour."""
        return (ShapeRange("settling", 20.0, 3600.0, log=True),)

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with pressure `where` changed to p + size exp(-t / settling) [Pa].

        t:    (T,) time since the start of the recording [s]
        size: error at the start [Pa]
        """
        found = values.copy()
        found[:, where] += size * np.exp(-t / self.settling)
        return found
