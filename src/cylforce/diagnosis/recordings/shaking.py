"""Sensors that shake: their white noise in the field, against what they declare and what the references show. The
diagnosis filters it away, so that nothing else here sees it."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.numbers import SHAKES
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

NORMAL = 1.4826  # standard deviation of a normal distribution over its median absolute deviation
SECOND = 6.0**0.5  # standard deviation of the second difference of white noise, over the noise's
FARTHEST = 5.0  # standard deviations; convention: of white noise none is farther
FEWEST = 100  # samples, below which no noise is told


def white_noise(recordings: Sequence[Recorded]) -> Array:
    """Standard deviation (S,) of each signal's white noise: from the mean square of second differences, in which motion
    hardly shows, and of these only what is within FARTHEST of the usual one, so that glitches do not show. (A median
    alone is wrong by half where a reading has coarse steps.) NaN where there are too few samples."""
    each = [np.diff(r.values, 2, axis=0) for r in recordings if len(r.values) > 2]
    if sum(len(part) for part in each) < FEWEST:
        return np.full(recordings[0].values.shape[1] if recordings else 0, np.nan)
    second = np.abs(np.concatenate(each))
    most = FARTHEST * NORMAL * np.nanmedian(second, axis=0)
    kept = np.where((second <= most) | (most == 0.0), second, np.nan)
    return np.asarray(np.sqrt(np.nanmean(kept**2, axis=0)) / SECOND)


class SensorNoise(NamedTuple):
    """The white noise of a sensor in SI units, standard deviations: in the field, `seen`; as its file says, `declared`;
    in the references, `before` (None without any); whether it `shakes`: SHAKES times what both say."""

    sensor: str
    seen: float
    declared: float
    before: float | None
    shakes: bool


def noises(machine: Machine, faulty: Sequence[Recorded], clean: Sequence[Recorded]) -> list[SensorNoise]:
    """Of every sensor whose noise can be told, the worst first."""
    seen = white_noise(faulty)
    before = white_noise(clean) if clean else np.full(len(seen), np.nan)
    declared = np.array([s.standard_error for s in machine.signals])
    usual = np.fmax(declared, before)
    order = [k for k in np.argsort(-seen / usual).tolist() if np.isfinite(seen[k])]
    return [
        SensorNoise(
            machine.signals[k].name,
            float(seen[k]),
            float(declared[k]),
            float(before[k]) if np.isfinite(before[k]) else None,
            bool(seen[k] > SHAKES * usual[k]),
        )
        for k in order
    ]


def shaking(each: Sequence[SensorNoise]) -> str:
    """A sentence that names the sensors that shake; empty if there are none."""
    found = [
        f"{n.sensor} {n.seen:.2g} ({n.seen / max(n.declared, n.before or 0.0):.0f} times as much as usual)"
        for n in each
        if n.shakes
    ]
    words = f"noisy sensors, standard deviation in SI units: {', '.join(found)}: check plug, cable, mounting"
    return words if found else ""
