"""Sensors that shake: their white noise in the field, against what they declare and what the references show. The
diagnosis filters it away, so that nothing else here sees it."""

from collections.abc import Sequence

import numpy as np

from cylforce.diagnosis.numbers import SHAKES
from cylforce.diagnosis.rows import Recorded
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

NORMAL = 1.4826  # standard deviation of a normal distribution over its median absolute deviation
SECOND = 6.0**0.5  # standard deviation of the second difference of white noise, over the noise's
FEWEST = 100  # samples, below which no noise is told


def white_noise(recordings: Sequence[Recorded]) -> Array:
    """Standard deviation (S,) of each signal's white noise: from second differences, in which motion hardly shows, and
    their median, in which single glitches do not show. NaN where there are too few samples."""
    each = [np.diff(r.values, 2, axis=0) for r in recordings if len(r.values) > 2]
    if sum(len(part) for part in each) < FEWEST:
        return np.full(recordings[0].values.shape[1] if recordings else 0, np.nan)
    return np.asarray(NORMAL * np.nanmedian(np.abs(np.concatenate(each)), axis=0) / SECOND)


def shaking(machine: Machine, faulty: Sequence[Recorded], clean: Sequence[Recorded]) -> str:
    """A sentence that names the sensors whose noise is SHAKES times what they declare and what the references show;
    empty if there are none."""
    seen = white_noise(faulty)
    declared = np.array([s.standard_error for s in machine.signals])
    before = np.fmax(declared, white_noise(clean)) if clean else declared
    found = [
        f"{signal.name} {seen[k]:.2g} ({seen[k] / before[k]:.0f} times as much as usual)"
        for k, signal in enumerate(machine.signals)
        if seen[k] > SHAKES * before[k]
    ]
    words = f"noisy sensors, standard deviation in SI units: {', '.join(found)}: check plug, cable, mounting"
    return words if found else ""
