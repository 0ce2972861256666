"""The load in the bucket, and the smooth transition with which loads and forces come and go."""

from typing import NamedTuple

import numpy as np

from cylforce.signals.estimate import Array

RAMP = 0.35  # s in which the teeth enter and leave the soil; chosen


class CarriedLoad(NamedTuple):
    """Load in the bucket at T instants.

    mass:    (T,) [kg]
    centre:  (T, 2) = (x, z) [m] in the last link's frame
    inertia: (T,) moment of inertia about the last pin [kg m^2]
    """

    mass: Array
    centre: Array
    inertia: Array


def smooth(t: Array, start: float, stop: float) -> Array:
    """Return the transition (T,) at times t (T,) [s]: 0 before `start` [s], 1 after `stop` [s], a minimum-jerk
    polynomial between.
    """
    u = np.clip((t - start) / (stop - start), 0.0, 1.0)
    return np.asarray(u**3 * (10 - 15 * u + 6 * u**2))
