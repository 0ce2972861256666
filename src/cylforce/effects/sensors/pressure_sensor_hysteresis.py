"""A pressure sensor that reads less while the pressure rises than while it falls."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.recurrence import clipped, followed

MEDIAN_TO_SIGMA = 1.4826  # of normal noise: its standard deviation over the median of its absolute values
STILL = 0.1  # share of the loop's width by which a reading must have moved at least; chosen
NOISE_RANGE = 8.0  # standard deviations of noise from the lowest to the highest of thousands of samples


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
            # Own simulator, five machines: 0.2 to 0.44. The readings do not tell where in the loop the pressure is.
            torque_error=0.35,
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
        if size < 0.0 and not self.opening:
            noise = float(np.median(np.abs(np.diff(values[:, where])))) * MEDIAN_TO_SIGMA / np.sqrt(2.0 * window)
            branch = self._branch_of_reading(pressure, -size, max(-size * STILL, NOISE_RANGE * noise), window)
        else:
            branch = self._branch(pressure, abs(size))
        found[:, where] -= size / 2.0 * branch
        return found

    def _branch_of_reading(self, reading: Array, width: float, still: float, window: int) -> Array:
        """Return the branch (T,) on which a sensor with play reads, from its readings: -1 falling .. 1 rising.

        At a sample at which the reading moves it is the direction of that motion, at the first sample 0. In between, it
        is constant: the pressure stays where it was, and crosses the play just before the reading moves in the
        other direction, at half the speed that the reading has then (the mean speed of what begins to move).

        reading: (T,) [Pa]
        width:   of the loop [Pa]
        still:   change of the reading that may be noise alone [Pa]
        window:  samples in which its speed is measured
        """
        branch = self._branch(reading, still)
        moves = np.diff(reading, prepend=reading[0]) * branch * (np.abs(branch) == 1.0) > 0.0
        moves[0], branch[0] = True, 0.0
        at = np.flatnonzero(moves)
        speed = np.abs(reading[np.minimum(at + window, len(reading) - 1)] - reading[at]) / window
        takes = np.abs(np.diff(branch[at])) * width / np.maximum(speed[1:], 1e-12)
        leaves = at[1:] - np.minimum(takes, np.diff(at))
        places = np.append(np.column_stack([at[:-1], leaves]).ravel(), at[-1])
        levels = np.append(np.repeat(branch[at[:-1]], 2), branch[at[-1]])
        return np.asarray(np.interp(np.arange(len(reading)), places, levels))

    def _branch(self, pressure: Array, width: float) -> Array:
        """Return the position (T,) of the reading between both branches: -1 falling .. 1 rising, 0 at the first sample.

        pressure: (T,) [Pa]
        width:    of the loop [Pa]
        """
        steps = np.diff(pressure, prepend=pressure[:1])
        if self.opening:
            return followed(np.copysign(1.0, steps), np.exp(-np.abs(steps) / self.opening))
        return clipped(2.0 * steps / width, 1.0) if width else np.zeros_like(steps)
