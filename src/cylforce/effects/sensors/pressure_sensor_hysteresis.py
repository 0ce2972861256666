"""A pressure sensor that reads less while the pressure rises than while it falls."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.recurrence import clipped, followed

STILL = 0.1  # share of the loop's width: a reading that has moved by less may have done so by noise alone; chosen


@dataclass(frozen=True, slots=True)
class PressureSensorHysteresis:
    """Pressure sensor whose reading lags by half of its width `size` [Pa]: less while the pressure rises, more while it
    falls.

    After a reversal the reading stays constant until the pressure has moved by that width (play operator,
    Krasnosel'skii and Pokrovskii 1983: a sticking mechanism). With `opening` it approaches the other branch as exp(-way
    / opening): a diaphragm that is not quite elastic.
    """

    opening: float = 0.0  # Pa of pressure within which the other branch is approached; 0: play
    smoothing: float = 0.1  # s: only the mean over so long turns the sensor round, not a reading's noise; chosen

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="pressure_sensor_hysteresis",
            unit="Pa",
            low=0.5e5,
            high=6e5,
            place=Place.PRESSURE,
            shows="with the sign of the pressure's change, at rest as it was before",
            confirm="raise and lower the pressure in steps, with a second gauge",
            sign=1,
            form=0.1,  # chosen: real loops lie between both forms
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Range of `opening` for a diaphragm: 3 to 100 bar; a play has none."""
        return (ShapeRange("opening", 3e5, 100e5, log=True),) if self.opening else ()

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with pressure `where` [Pa] changed to p - size/2 b.

        b is the branch on which the sensor reads: 1 while the pressure rises, -1 while it falls. A negative size
        removes the error from a reading.

        values: (T, S) signals [SI]: true values, or, with a negative size, readings
        t:      (T,) time, evenly spaced [s]
        size:   width of the loop [Pa]
        """
        from scipy.ndimage import uniform_filter1d  # not needed by who reads results of recordings

        found, window = values.copy(), 2 * int(self.smoothing / 2.0 * (len(t) - 1) / max(t[-1] - t[0], 1e-9)) + 1
        pressure = uniform_filter1d(values[:, where], window, mode="nearest")
        from_reading = size < 0.0 and not self.opening
        branch = self._branch_of_reading(pressure, -size) if from_reading else self._branch(pressure, abs(size))
        found[:, where] -= size / 2.0 * branch
        return found

    def _branch_of_reading(self, reading: Array, width: float) -> Array:
        """Return the branch (T,) on which a sensor with play reads, from its readings: -1 falling .. 1 rising.

        At a sample at which the reading moves it is the direction of that motion. It is interpolated between these
        samples, where the reading is constant because the pressure crosses the play.

        reading: (T,) [Pa]
        width:   of the loop [Pa]
        """
        branch = self._branch(reading, STILL * width)
        moving = np.flatnonzero(np.diff(reading, prepend=reading[0]) * branch * (np.abs(branch) == 1.0) > 0.0)
        return np.interp(np.arange(len(reading)), moving, branch[moving]) if moving.size else branch

    def _branch(self, pressure: Array, width: float) -> Array:
        """Return the position (T,) of the reading between both branches: -1 falling .. 1 rising, 0 at the first sample.

        pressure: (T,) [Pa]
        width:    of the loop [Pa]
        """
        steps = np.diff(pressure, prepend=pressure[:1])
        if self.opening:
            return followed(np.copysign(1.0, steps), np.exp(-np.abs(steps) / self.opening))
        return clipped(2.0 * steps / width, 1.0) if width else np.zeros_like(steps)
