"""White noise of sensors in a recording, compared with what they declare and with what the references show.

The filters of the diagnosis remove it, so that nothing else shows a noisy sensor."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cylforce.mechanics.machine import Machine
from cylforce.readings.constants import NOISY
from cylforce.readings.recording import Recording
from cylforce.signals.estimate import Array

NORMAL = 1.4826  # standard deviation of a normal distribution over its median absolute deviation
SECOND_DIFFERENCE = 6.0**0.5  # standard deviation of the second difference of white noise, over the noise's
FARTHEST = 5.0  # standard deviations; convention: white noise is never farther
FEWEST = 100  # samples, below which no noise is computed


def white_noise(recordings: Sequence[Recording]) -> Array:
    """Return the standard deviation (S,) of each signal's white noise; NaN with too few samples.

    It is the mean square of second differences, in which motion hardly shows. Differences beyond FARTHEST are left out,
    so that jumps do not count. (A median alone is wrong by half where a reading has coarse steps.)
    """
    each = [np.diff(r.values, 2, axis=0) for r in recordings if len(r.values) > 2]
    if sum(len(part) for part in each) < FEWEST:
        return np.full(recordings[0].values.shape[1] if recordings else 0, np.nan)
    second = np.abs(np.concatenate(each))
    most = FARTHEST * NORMAL * np.nanmedian(second, axis=0)
    kept = np.where((second <= most) | (most == 0.0), second, np.nan)
    return np.asarray(np.sqrt(np.nanmean(kept**2, axis=0)) / SECOND_DIFFERENCE)


def usual_noise(machine: Machine, recordings: Sequence[Recording]) -> Array:
    """Return the white noise (S,) that recordings show of every sensor, or where they show none, what it declares."""
    declared = np.array([s.standard_error for s in machine.signals])
    shown = white_noise(recordings) if recordings else np.full(len(declared), np.nan)
    return np.asarray(np.where(np.nan_to_num(shown) > 0.0, shown, declared))


@dataclass(frozen=True)
class SensorNoise:
    """White noise of a sensor, standard deviations in SI units.

    sensor:   its name
    seen:     in the field recordings
    declared: in the machine file
    before:   in the references; None without any
    shakes:   whether `seen` is NOISY times both
    """

    sensor: str
    seen: float
    declared: float
    before: float | None
    shakes: bool


def sensor_noise(machine: Machine, field: Sequence[Recording], references: Sequence[Recording]) -> list[SensorNoise]:
    """Return the noise of every sensor of which it is known, the noisiest against its usual noise first."""
    seen = white_noise(field)
    before = white_noise(references) if references else np.full(len(seen), np.nan)
    declared = np.array([s.standard_error for s in machine.signals])
    usual = np.fmax(declared, before)
    order = [k for k in np.argsort(-seen / usual).tolist() if np.isfinite(seen[k])]
    return [
        SensorNoise(
            machine.signals[k].name,
            float(seen[k]),
            float(declared[k]),
            float(before[k]) if np.isfinite(before[k]) else None,
            bool(seen[k] > NOISY * usual[k]),
        )
        for k in order
    ]


def noise_warning(noises: Sequence[SensorNoise]) -> str:
    """Return a sentence that names the noisy sensors; empty if there are none."""
    found = [
        f"{n.sensor} {n.seen:.2g} ({n.seen / max(n.declared, n.before or 0.0):.0f} times as much as usual)"
        for n in noises
        if n.shakes
    ]
    words = f"noisy sensors, standard deviation in SI units: {', '.join(found)}: check plug, cable, mounting"
    return words if found else ""
