"""Moves of all joints at once, to postures that a commissioning has not yet seen: what single strokes tell only where
the other joints waited must hold wherever the machine works."""

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.commissioning.coverage import BINS, Plan
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

VISITED_S = 0.2  # of motion in a pair of neighbouring joints' bins, from which on it counts as visited
ENOUGH = 0.9  # of the pairs within reach
LOW = 0.4  # of the postures' heights: a tool below this quantile might touch the ground
BRISK = 2.5  # times the speed from which on motion is fast
ARRIVED = 0.6  # of a bin


class Reach(NamedTuple):
    """All joints to the posture `target` (N,) [rad], in `seconds`."""

    target: Array
    seconds: float


class Postures(NamedTuple):
    """The middles of the bins of all driven joints, where the tool is high: `theta` (K, N) [rad], `bins` (K, M), and
    `pairs` (M-1, BINS, BINS): which pairs of neighbouring bins they contain."""

    theta: Array
    bins: NDArray[np.intp]
    pairs: NDArray[np.bool_]


def postures(machine: Machine, plan: Plan) -> Postures:
    """The postures that may be asked for."""
    bins = np.array(list(product(range(BINS), repeat=len(plan.joints))), dtype=np.intp)
    theta = np.zeros((len(bins), machine.size))
    middles = (plan.edges[:, 1:] + plan.edges[:, :-1]) / 2.0
    for k, j in enumerate(plan.joints):
        theta[:, j] = middles[k, bins[:, k]]
    height = machine.tool_point(theta).place.imag
    high = height >= np.quantile(height, LOW)
    pairs = np.zeros((max(len(plan.joints) - 1, 0), BINS, BINS), dtype=bool)
    for k in range(len(pairs)):
        pairs[k, bins[high, k], bins[high, k + 1]] = True
    return Postures(theta[high], bins[high], pairs)


def visited(places: Postures, seconds: Array) -> float:
    """The share (0..1) of the pairs that `seconds` (M-1, BINS, BINS) of `coverage.planes` contain."""
    return float(np.mean(seconds[places.pairs] >= VISITED_S)) if np.any(places.pairs) else 1.0


def next_reach(
    machine: Machine, plan: Plan, places: Postures, seconds: Array, posture: Array, last: Reach | None
) -> Reach | None:
    """The posture to go to next from `posture` (N,) [rad] (NaN: nobody knows); None when enough was visited."""
    if visited(places, seconds) >= ENOUGH:
        return None
    joints, width = list(plan.joints), plan.edges[:, 1] - plan.edges[:, 0]
    here = np.where(np.isnan(posture[joints]), plan.edges.mean(axis=1), posture[joints])
    if last is not None and np.any(np.abs(last.target[joints] - here) > ARRIVED * width):
        return last
    new = np.zeros(len(places.theta))
    for k in range(len(places.pairs)):
        new += seconds[k, places.bins[:, k], places.bins[:, k + 1]] < VISITED_S
    away = np.sum(np.abs(places.theta[:, joints] - here) / (BINS * width), axis=1)
    target = places.theta[int(np.argmax(new + away / (1.0 + len(joints))))]
    return Reach(target, _seconds(machine, plan, posture, target))


def _seconds(machine: Machine, plan: Plan, posture: Array, target: Array) -> float:
    ends = machine.geometry(np.array([np.where(np.isnan(posture), target, posture), target])).length
    way = np.abs(ends[1] - ends[0])[list(plan.cylinders)]
    return float(np.max(way / (BRISK * plan.fast), initial=1.0))
