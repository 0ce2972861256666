"""What drifts: friction (Coulomb, viscous) and the zeros of the pressures, and how far before anything is seen."""

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.model import EXPECTED, BetweenStrokes, Model
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

# 1/K, of the measuring range: largest temperature coefficient of the zero, as data sheets of pressure transmitters of
# class 0.5 print it (0.15 % in 10 K), evenly either way; K: standard deviation of the oil's temperature about that of
# the commissioning, so that 0 and 80 degC are two of them from 40.
ZERO_COEFFICIENT = 1.5e-4 / 3.0**0.5
WARMER = 20.0
SMALLEST_FRICTION = 100.0  # Pa: least standard error of a friction, as a pressure on the head side; chosen


def warming(machine: Machine) -> BetweenStrokes:
    """What differs while the oil warms, or on another day: friction as between strokes before anything is known, zeros
    as the temperature of their sensors."""
    ranges = [s.high - max(s.low, 0.0) for s in machine.signals if s.kind in (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE)]
    return BetweenStrokes(EXPECTED.friction, max([EXPECTED.zero, *(ZERO_COEFFICIENT * WARMER * r for r in ranges)]))


def kinds(model: Model) -> NDArray[np.int_]:
    """For each of the D drifts 0 where it is a friction, 1 where it is a zero."""
    return np.repeat([0, 1], (len(model.changing_friction), len(model.machine.cylinders)))


def drift_spread(model: Model, values: Array, differs: BetweenStrokes) -> Array:
    """Standard errors (D,) of the drift, from the parameters `values` (P,): friction [N, N s/m], zeros [N]."""
    least = SMALLEST_FRICTION * model.machine.cylinders[0].area_head
    friction = np.maximum(differs.friction * np.abs(values[model.changing_friction]), least)
    zero = [differs.zero * c.area_head for c in model.machine.cylinders]
    return np.concatenate([friction, zero])
