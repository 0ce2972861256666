"""What drifts: friction (Coulomb, viscous) and the zeros of the pressures, and how far before anything is seen."""

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.model import BetweenStrokes, Model
from cylforce.signals.estimate import Array

SMALLEST_FRICTION = 100.0  # Pa: least standard error of a friction, as a pressure on the head side; chosen


def kinds(model: Model) -> NDArray[np.int_]:
    """For each of the D drifts 0 where it is a friction, 1 where it is a zero."""
    return np.repeat([0, 1], (len(model.changing_friction), len(model.machine.cylinders)))


def drift_spread(model: Model, values: Array, differs: BetweenStrokes) -> Array:
    """Standard errors (D,) of the drift, from the parameters `values` (P,): friction [N, N s/m], zeros [N]."""
    least = SMALLEST_FRICTION * model.machine.cylinders[0].area_head
    friction = np.maximum(differs.friction * np.abs(values[model.changing_friction]), least)
    zero = [differs.zero * c.area_head for c in model.machine.cylinders]
    return np.concatenate([friction, zero])
