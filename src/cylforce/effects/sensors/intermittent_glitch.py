"""Sensor with short jumps of its reading: a loose contact."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

LONGEST = 0.35  # s: a jump that lasts longer is no glitch; chosen
EDGE = 0.5  # share of a jump that happens between two samples: a joint or a pressure takes longer; chosen
# percentile of all steps from sample to sample, up to which they are those of motion; a step of more than CLEAR times
# that percentile may begin a jump; chosen
ORDINARY, CLEAR = 98.0, 2.0


@dataclass(frozen=True, slots=True)
class IntermittentGlitch:
    """Sensor whose reading jumps by size times the range in which its values are accepted, up or down.

    It jumps once at a random instant of each stretch of `every` seconds, for `shortest` to `longest` seconds. The
    instants are those of the `seed`, unless `jumps` is given. A diagnosis finds the jumps in the readings (`glitches`)
    and gives them as `jumps`: begin [s], duration [s] and direction (1 or -1) of each, one after the other.
    """

    every: float = 6.0  # s, length of the stretches, each with one jump
    shortest: float = 0.05  # s, least duration of a jump
    longest: float = 0.3  # s, greatest duration of a jump
    seed: int = 0  # of the random instants, durations and directions
    jumps: tuple[float, ...] = ()  # begin [s], duration [s] and direction of each jump; empty: random ones

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="intermittent_glitch",
            unit="1",
            low=0.002,
            high=1.0,
            place=Place.SENSOR,
            shows="for fractions of a second at random instants, in one sensor alone",
            confirm="shake plug and cable of that sensor while its reading is watched",
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with signal `where` changed by size times its range during each jump.

        t:    (T,) time since the start of the recording [s]
        size: height of the jumps, as a share of the sensor's range
        """
        signal, found = machine.signals[where], values.copy()
        for begin, length, way in self._when(t):
            inside = slice(*np.searchsorted(t, (begin, begin + length)))
            found[inside, where] += way * size * (signal.high - signal.low)
        return found

    def _when(self, t: Array) -> Iterator[tuple[float, float, float]]:
        """Yield begin [s], duration [s] and direction (1 or -1) of every jump within times t (T,) [s].

        Given `jumps` are all yielded, whether within these times or not.
        """
        if self.jumps:
            yield from zip(self.jumps[::3], self.jumps[1::3], self.jumps[2::3], strict=True)
            return
        for number in range(int(np.min(t) // self.every), int(np.max(t) // self.every) + 1):
            at, lasting, way = np.random.default_rng((self.seed, number)).random(3)
            length = self.shortest + lasting * (self.longest - self.shortest)
            yield number * self.every + at * (self.every - length), length, 1.0 if way < 0.5 else -1.0


def glitches(reading: Array, dt: float) -> NDArray[np.bool_]:
    """Return for each sample (T,) of one sensor whether it belongs to a jump (True).

    A jump begins with a step of more than CLEAR times the percentile ORDINARY of all steps, and ends within LONGEST
    with a step back of more than EDGE of its first step. All its samples are off the running median, over twice
    LONGEST, by more than EDGE of the first step and in its direction. A pressure may jump on a healthy machine: compare
    it with the references.

    reading: (T,) readings, in any unit
    dt:      time between samples [s]
    """
    from scipy.ndimage import median_filter  # not needed by who reads results of recordings

    window = round(LONGEST / dt)
    off = reading - median_filter(reading, 2 * window + 1, mode="nearest")
    step = np.diff(reading, prepend=reading[0])
    clear = CLEAR * float(np.percentile(np.abs(step), ORDINARY)) + 1e-12
    found = np.zeros(len(reading), dtype=bool)
    for k in np.flatnonzero(np.abs(step) > clear).tolist():
        height = EDGE * step[k]
        back = np.flatnonzero(step[k + 1 : k + 1 + window] / -height > 1.0)
        inside = slice(k, k + 1 + int(back[0]) if back.size else k)
        found[inside] |= np.all(off[inside] / height > 1.0)
    return found
