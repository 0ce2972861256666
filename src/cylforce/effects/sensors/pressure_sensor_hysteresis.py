"""A pressure sensor that reads less while the pressure rises than while it falls."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.recurrence import clipped, followed

STILL = 0.1  # share of the play by which a reading moves at least, and not by noise alone; chosen


@dataclass(frozen=True, slots=True)
class PressureSensorHysteresis:
    """A pressure sensor whose reading lags behind by half of its width `size` [Pa]: less while the pressure rises, more
    while it falls. After a reversal it either stands still until the pressure has moved by that width (play operator,
    Krasnosel'skii and Pokrovskii 1983: a sticking mechanism), or, with `opening`, approaches the other branch as
    exp(-way / opening): a diaphragm that is not quite elastic."""

    opening: float = 0.0  # Pa of pressure within which the other branch is approached; 0: play
    smoothing: float = 0.1  # s: only the mean over so long turns the sensor round, not a reading's noise; chosen

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

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Of a diaphragm: 3 to 100 bar. A play has none."""
        return (ShapeRange("opening", 3e5, 100e5, log=True),) if self.opening else ()

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """The signals (T, S) with signal `where` changed to p - error. A negative size takes the error out of a
        reading."""
        from scipy.ndimage import uniform_filter1d  # not needed by who reads results of recordings

        found, window = values.copy(), 2 * int(self.smoothing / 2.0 * (len(t) - 1) / max(t[-1] - t[0], 1e-9)) + 1
        pressure = uniform_filter1d(values[:, where], window, mode="nearest")
        still = size < 0.0 and not self.opening
        found[:, where] -= size / 2.0 * (self._told(pressure, -size) if still else self._branch(pressure, abs(size)))
        return found

    def _told(self, reading: Array, width: float) -> Array:
        """The branch that readings (T,) [Pa] tell: the one of their last way, from and to the samples at which they
        move; even between them, where they stand still while the pressure crosses the play."""
        branch = self._branch(reading, STILL * width)
        moving = np.flatnonzero(np.diff(reading, prepend=reading[0]) * branch * (np.abs(branch) == 1.0) > 0.0)
        return np.interp(np.arange(len(reading)), moving, branch[moving]) if moving.size else branch

    def _branch(self, pressure: Array, width: float) -> Array:
        """Where between both branches (-1 falling .. 1 rising) the reading of the pressures (T,) [Pa] is; in the middle
        at the first sample."""
        steps = np.diff(pressure, prepend=pressure[:1])
        if self.opening:
            return followed(np.copysign(1.0, steps), np.exp(-np.abs(steps) / self.opening))
        return clipped(2.0 * steps / width, 1.0) if width else np.zeros_like(steps)
