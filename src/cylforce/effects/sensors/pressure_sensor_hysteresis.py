"""A pressure sensor that reads less while the pressure rises than while it falls."""

from dataclasses import dataclass
from math import copysign, exp

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class PressureSensorHysteresis:
    """A pressure sensor whose reading lags behind by half of its width `size` [Pa]: less while the pressure rises, more
    while it falls. After a reversal it either stands still until the pressure has moved by that width (play operator,
    Krasnosel'skii and Pokrovskii 1983: a sticking mechanism), or, with `opening`, approaches the other branch as
    exp(-way / opening): a diaphragm that is not quite elastic."""

    opening: float = 0.0  # Pa of pressure within which the other branch is approached; 0: play

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "pressure_sensor_hysteresis",
            "Pa",
            0.5e5,
            6e5,
            Place.PRESSURE,
            "with the sign of the pressure's change, at rest as it was before",
            "raise and lower the pressure in steps, with a second gauge",
            1,
            form=0.1,  # chosen: real loops lie between both forms
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """The signals (T, S) with signal `where` changed to p - error; a negative size has the opposite error."""
        found, pressure = values.copy(), values[:, where]
        found[:, where] -= size / 2.0 * self._branch(pressure, abs(size))
        return found

    def _branch(self, pressure: Array, width: float) -> Array:
        """Where between both branches (-1 falling .. 1 rising) the reading of the pressures (T,) [Pa] is; in the middle
        at the first sample."""
        found, z = np.zeros_like(pressure), 0.0
        for k, step in enumerate(np.diff(pressure).tolist(), 1):
            if self.opening:
                side = copysign(1.0, step)
                z = side + (z - side) * exp(-abs(step) / self.opening)
            elif width:
                z = min(max(z + 2.0 * step / width, -1.0), 1.0)
            found[k] = z
        return found
