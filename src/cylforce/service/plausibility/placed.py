"""Is what seems to hang in an empty bucket a mass in it?

Torques tell a mass m and its first moments m x, m z about the last pin. Whatever sticks in a bucket lies within a
distance R of that pin:

    |(m x, m z)| <= R m

Moments without such a mass are no load. An angle of the bucket that has slipped turns the bucket's own weight, and
looks just so: its mass is known to be there. The distance of the estimate from the nearest possible mass, in its own
standard errors, is the root of chi-squared."""

from math import hypot, pi

import numpy as np

from cylforce.signals.estimate import Array

DIRECTIONS = np.linspace(0.0, 2.0 * pi, 360, endpoint=False)  # in which the nearest mass may lie


def impossible(moments: Array, covariance: Array, reach: float) -> float:
    """Distance of `moments` (3,), a mass [kg] and its first moments x, z [kg m], from the nearest mass within `reach`
    [m], by their `covariance` (3, 3) in standard errors; 0 for a possible one. Raises numpy.linalg.LinAlgError if the
    covariance is singular."""
    mass, x, z = moments.tolist()
    if hypot(x, z) <= reach * mass:
        return 0.0
    edges = np.stack([np.ones_like(DIRECTIONS), reach * np.cos(DIRECTIONS), reach * np.sin(DIRECTIONS)])
    known = np.linalg.inv(covariance)
    along = np.maximum(moments @ known @ edges, 0.0)
    nearest = moments @ known @ moments - (along**2 / (edges * (known @ edges)).sum(axis=0)).max()
    return float(np.sqrt(max(nearest, 0.0)))
