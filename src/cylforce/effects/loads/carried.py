"""The load that lies in the bucket, and how what comes and goes does so without a step."""

from typing import NamedTuple

import numpy as np

from cylforce.signals.estimate import Array

RAMP = 0.35  # s in which the teeth enter and leave the soil


class CarriedLoad(NamedTuple):
    """A load at T instants: `mass` (T,) [kg], `centre` (T, 2) [m] and `inertia` (T,) [kg m^2] about the last
    pin."""

    mass: Array
    centre: Array
    inertia: Array


def smooth(t: Array, start: float, stop: float) -> Array:
    """0 before `start`, 1 after `stop`, minimum jerk between."""
    u = np.clip((t - start) / (stop - start), 0.0, 1.0)
    return np.asarray(u**3 * (10 - 15 * u + 6 * u**2))
