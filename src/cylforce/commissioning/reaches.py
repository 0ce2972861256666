"""Moves of all joints at once to postures that the recording does not contain yet.

Strokes of one joint measure only at the positions where the other joints wait. The model must be valid in the whole
working range.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.commissioning.coverage import BINS, Plan
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.workspace import joint_angles
from cylforce.signals.estimate import Array

VISITED_S = 0.2  # s of motion in a pair of bins of neighbouring joints, from which on the pair is visited; chosen
ENOUGH = 0.9  # share of the pairs within reach that must be visited; chosen
LOW = 0.4  # quantile of the tool's height over all postures, below which it might reach the ground; chosen
BRISK = 2.5  # speed of the fastest cylinder in such a move, times `Plan.fast`; chosen
ARRIVED = 0.6  # distance from the target at which it counts as reached, times a bin; chosen


class Reach(NamedTuple):
    """A move of all joints to a posture.

    target: (N,) posture at its end, angles of `drive` [rad]
    seconds: duration [s]
    """

    target: Array
    seconds: float


class Postures(NamedTuple):
    """K postures in which the tool is high enough, at the middles of the bins of all driven joints.

    theta: (K, N) angles of `drive` [rad]
    bins: (K, M) number of each driven joint's bin
    pairs: (M-1, BINS, BINS) whether any posture has this pair of bins of two neighbouring joints
    """

    theta: Array
    bins: NDArray[np.intp]
    pairs: NDArray[np.bool_]


def postures(machine: Machine, plan: Plan) -> Postures:
    """Return the postures that may be requested of the operator: those in which the tool is high enough (LOW)."""
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
    """Return the share (0..1) of the pairs of bins in which the machine was for VISITED_S or longer; 1 without any
    pair.

    seconds: (M-1, BINS, BINS) coverage of pairs, as from `coverage.planes` [s]
    """
    return float(np.mean(seconds[places.pairs] >= VISITED_S)) if np.any(places.pairs) else 1.0


def next_reach(
    machine: Machine, plan: Plan, places: Postures, seconds: Array, posture: Array, last: Reach | None
) -> Reach | None:
    """Return the next move: to the posture with most pairs not yet visited; None when enough pairs were visited.

    Among such postures it is the farthest one. The last move continues until its target is reached.

    places: the postures that may be requested
    seconds: (M-1, BINS, BINS) coverage of pairs, as from `coverage.planes` [s]
    posture: (N,) present angles of `drive` [rad]; NaN: unknown
    last: the move that was requested before
    """
    if visited(places, seconds) >= ENOUGH:
        return None
    joints, width = list(plan.joints), plan.edges[:, 1] - plan.edges[:, 0]
    angles = np.where(np.isnan(posture[joints]), plan.edges.mean(axis=1), posture[joints])
    if last is not None and np.any(np.abs(last.target[joints] - angles) > ARRIVED * width):
        return last
    unvisited = np.zeros(len(places.theta))
    for k in range(len(places.pairs)):
        unvisited += seconds[k, places.bins[:, k], places.bins[:, k + 1]] < VISITED_S
    distance = np.sum(np.abs(places.theta[:, joints] - angles) / (BINS * width), axis=1)
    target = places.theta[int(np.argmax(unvisited + distance / (1.0 + len(joints))))]
    return Reach(target, _seconds(machine, plan, posture, target))


def _seconds(machine: Machine, plan: Plan, posture: Array, target: Array) -> float:
    """Return the duration of a move [s], at least 1 s: its fastest cylinder moves at BRISK times its fast pace.

    posture: (N,) present angles of `drive` [rad]; NaN: unknown
    target: (N,) angles of `drive` at the end [rad]
    """
    ends = np.array([np.where(np.isnan(posture), target, posture), target])
    begin, end = machine.geometry(joint_angles(machine, ends)).length
    travel = np.abs(end - begin)[list(plan.cylinders)]
    return float(np.max(travel / (BRISK * plan.fast), initial=1.0))
