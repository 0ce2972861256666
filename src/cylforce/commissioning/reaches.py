"""Moves of all joints at once to postures that the recording does not contain yet. Strokes of one joint measure only at
the positions where the other joints wait; the model must be valid in the whole working range."""

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.commissioning.coverage import BINS, Plan
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.workspace import joint_angles
from cylforce.signals.estimate import Array

VISITED_S = 0.2  # s of motion in a pair of bins of neighbouring joints, from which on the pair is visited; chosen
ENOUGH = 0.9  # of the pairs within reach, which must be visited; chosen
LOW = 0.4  # quantile of the tool's height over all postures, below which it might reach the ground; chosen
BRISK = 2.5  # times `Plan.fast`: speed of the fastest cylinder in such a move; chosen
ARRIVED = 0.6  # times a bin: distance from the target at which it counts as reached; chosen


class Reach(NamedTuple):
    """A move of all joints to the posture `target` (N,) [rad] in `seconds` [s]."""

    target: Array
    seconds: float


class Postures(NamedTuple):
    """K postures, at the middles of the bins of all driven joints, in which the tool is high enough: joint angles
    `theta` (K, N) [rad]; their `bins` (K, M); `pairs` (M-1, BINS, BINS): whether any of them has this pair of bins of
    two neighbouring joints."""

    theta: Array
    bins: NDArray[np.intp]
    pairs: NDArray[np.bool_]


def postures(machine: Machine, plan: Plan) -> Postures:
    """The postures that the operator may be asked for."""
    bins = np.array(list(product(range(BINS), repeat=len(plan.joints))), dtype=np.intp)
    theta = np.zeros((len(bins), machine.size))
    middles = (plan.edges[:, 1:] + plan.edges[:, :-1]) / 2.0
    for k, j in enumerate(plan.joints):
        theta[:, j] = middles[k, bins[:, k]]
    height = machine.tool_point(joint_angles(machine, theta)).place.imag
    high = height >= np.quantile(height, LOW)
    pairs = np.zeros((max(len(plan.joints) - 1, 0), BINS, BINS), dtype=bool)
    for k in range(len(pairs)):
        pairs[k, bins[high, k], bins[high, k + 1]] = True
    return Postures(theta[high], bins[high], pairs)


def visited(places: Postures, seconds: Array) -> float:
    """Share (0..1) of the pairs of angles in `places` in which the machine was for VISITED_S or longer, by the
    `seconds` (M-1, BINS, BINS) of `coverage.planes`; 1 without any pair."""
    return float(np.mean(seconds[places.pairs] >= VISITED_S)) if np.any(places.pairs) else 1.0


def next_reach(
    machine: Machine, plan: Plan, places: Postures, seconds: Array, posture: Array, last: Reach | None
) -> Reach | None:
    """The next move from `posture` (N,) [rad] (NaN: unknown): to the posture with most pairs not yet visited; the
    `last` move until its target is reached; None when enough was visited."""
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
    both = np.array([np.where(np.isnan(posture), target, posture), target])
    ends = machine.geometry(joint_angles(machine, both)).length
    way = np.abs(ends[1] - ends[0])[list(plan.cylinders)]
    return float(np.max(way / (BRISK * plan.fast), initial=1.0))
