"""The part of a force that a mass in the bucket explains."""

import numpy as np

from cylforce.signals.estimate import Array
from cylforce.signals.units import STANDARD_GRAVITY

HEAVIEST = 2.0  # times the rated payload: largest mass in the bucket; chosen


def without_mass(force: Array, spread: Array, rated_payload: float) -> Array:
    """The force (2,) [N] less that of the mass of 0 to HEAVIEST rated payloads that explains most of it: the weight w
    downwards that minimises (f + w z)' C^-1 (f + w z), C = `spread` (2, 2)."""
    (xx, xz), _ = spread.tolist()
    x, z = force.tolist()
    weight = min(max((xz * x - xx * z) / xx, 0.0), HEAVIEST * rated_payload * STANDARD_GRAVITY)
    return np.array([x, z + weight])
