"""Coverage: time that each joint moved in each bin of its range, by direction and pace, and the missing motion."""

from enum import IntEnum
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.mechanics.machine import Machine
from cylforce.mechanics.workspace import driven, working_range
from cylforce.signals.estimate import Array

BINS = 6  # equal parts into which a joint's range is divided; chosen
CROSSING_S = 20.0  # s: a cylinder is fast when it would travel its whole stroke in less; chosen
NEEDED_S = (1.0, 0.5)  # s of slow and of fast motion needed in each bin; chosen: some correlation times of the filters
TIGHT = 1e-9  # s, tolerance for rounding when seconds are compared


class Way(IntEnum):
    """Direction in which a joint's cylinder moves."""

    EXTENDING = 0
    RETRACTING = 1


class Pace(IntEnum):
    """Speed class of a joint's cylinder; `Plan.fast` is the limit between both."""

    SLOW = 0
    FAST = 1


class Plan(NamedTuple):
    """The motion that a recording must contain, for each of the M driven joints.

    joints: (M,) numbers of the joints
    cylinders: (M,) for each joint the cylinder that moves it
    edges: (M, BINS+1) edges of the bins of its angle of `drive` [rad]
    rest: speed below which a cylinder counts as not moving, because the direction of its friction is uncertain [m/s]
    fast: (M,) speed from which on motion counts as fast [m/s]
    needed: (M, BINS, 2, 2) time needed per bin, direction and pace [s]
    """

    joints: tuple[int, ...]
    cylinders: tuple[int, ...]
    edges: Array
    rest: float
    fast: Array
    needed: Array


class Missing(NamedTuple):
    """Motion that is still missing.

    joint: number of the joint
    low: least angle of `drive` of its neighbouring bins that lack this motion [rad]
    high: greatest angle of `drive` of these bins [rad]
    way: direction of its cylinder
    pace: slow or fast
    seconds: recorded time, summed over these bins [s]
    needed: needed time, summed over these bins [s]
    """

    joint: int
    low: float
    high: float
    way: Way
    pace: Pace
    seconds: float
    needed: float


def plan(machine: Machine, rest: float, ranges: Array | None = None) -> Plan:
    """Return the motion that a recording of a machine must contain.

    Fast motion is not needed in the outermost bins, where every motion starts and stops. Raises ValueError when a joint
    has no angle that its cylinders can drive.

    rest: speed below which a cylinder counts as not moving [m/s]
    ranges: (N, 2) range of every angle of `drive` [rad]; default: the working ranges
    """
    joints = driven(machine)
    cylinders = tuple(_mover(machine, j) for j in joints)
    bounds = (working_range(machine) if ranges is None else ranges)[list(joints)]
    stroke = np.array([machine.cylinders[c].length_high - machine.cylinders[c].length_low for c in cylinders])
    needed = np.tile(np.array(NEEDED_S), (len(joints), BINS, 2, 1))
    needed[:, [0, -1], :, Pace.FAST] = 0.0
    return Plan(
        joints=joints,
        cylinders=cylinders,
        edges=np.linspace(bounds[:, 0], bounds[:, 1], BINS + 1, axis=1),
        rest=rest,
        fast=stroke / CROSSING_S,
        needed=needed,
    )


def _mover(machine: Machine, j: int) -> int:
    """Return the cylinder that moves joint j: the one whose outermost joint is j, else the first that acts on it."""
    acting = [c for c, span in enumerate(machine.spans) if j in span]
    return min(acting, key=lambda c: (max(machine.spans[c]) != j, c))


def coverage(plan: Plan, posture: Array, speed: Array, dt: float) -> Array:
    """Return the time of motion (M, BINS, 2, 2) [s] per joint, bin of its angle, direction and pace of its cylinder.

    The last two axes are numbered as `Way` and `Pace`. The coverage of a recording is the sum over its pieces. Angles
    beyond the range count in the outermost bin.

    posture: (T, N) angles of `drive` [rad]
    speed: (T, C) cylinder speeds [m/s]
    dt: time between two samples [s]
    """
    seconds = np.zeros_like(plan.needed)
    for k, (j, c) in enumerate(zip(plan.joints, plan.cylinders, strict=True)):
        size = np.abs(speed[:, c])
        moves = np.logical_and(size > plan.rest, np.isfinite(posture[:, j]))
        part, v = _bin(plan.edges[k], posture[moves, j]), speed[moves, c]
        np.add.at(seconds[k], (part, (v < 0.0).astype(int), (size[moves] >= plan.fast[k]).astype(int)), dt)
    return seconds


def _bin(edges: Array, angle: Array) -> NDArray[np.intp]:
    """Return the number of the bin of each angle (n,) [rad]; the outermost bins take the angles beyond them.

    edges: (BINS + 1,) limits of the bins, ascending [rad]
    """
    return np.clip(np.searchsorted(edges, angle, side="right") - 1, 0, BINS - 1)


def planes(plan: Plan, posture: Array, speed: Array, dt: float) -> Array:
    """Return the time (M-1, BINS, BINS) [s] in motion, per pair of bins of two neighbouring driven joints.

    Time counts while any cylinder moves and all angles are known.

    posture: (T, N) angles of `drive` [rad]; NaN: unknown
    speed: (T, C) cylinder speeds [m/s]
    dt: time between two samples [s]
    """
    moves = np.logical_and(np.any(np.abs(speed) > plan.rest, axis=1), np.all(np.isfinite(posture), axis=1))
    parts = [_bin(edges, posture[moves, j]) for edges, j in zip(plan.edges, plan.joints, strict=True)]
    seconds = np.zeros((max(len(parts) - 1, 0), BINS, BINS))
    for k, pair in enumerate(pairwise(parts)):
        np.add.at(seconds[k], pair, dt)
    return seconds


def share(plan: Plan, seconds: Array) -> float:
    """Return the share (0..1) of the needed time that is covered.

    seconds: coverage (M, BINS, 2, 2) [s]
    """
    return float(np.sum(np.minimum(seconds, plan.needed)) / np.sum(plan.needed))


def missing(plan: Plan, seconds: Array) -> tuple[Missing, ...]:
    """Return the motion that is still missing, neighbouring bins combined, the largest lack first.

    seconds: coverage (M, BINS, 2, 2) [s]
    """
    gaps = [
        _gap(plan, seconds, k, part, way, pace)
        for k in range(len(plan.joints))
        for way in Way
        for pace in Pace
        for part in _runs(seconds[k, :, way, pace] < plan.needed[k, :, way, pace] - TIGHT)
    ]
    return tuple(sorted(gaps, key=lambda gap: gap.seconds - gap.needed))


def _runs(lacks: NDArray[np.bool_]) -> list[slice]:
    """Return the runs of consecutive bins that lack motion, each as a slice of the bins.

    lacks: (BINS,) whether a bin lacks motion
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lacks.astype(int), [0]])))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _gap(plan: Plan, seconds: Array, k: int, part: slice, way: Way, pace: Pace) -> Missing:
    """Return the missing motion of the k-th driven joint in consecutive bins, one way and at one pace.

    seconds: coverage (M, BINS, 2, 2) [s]: joint, bin, way, pace
    part: the bins
    """
    low, high = float(plan.edges[k, part.start]), float(plan.edges[k, part.stop])
    recorded, needed = (float(np.sum(table[k, part, way, pace])) for table in (seconds, plan.needed))
    return Missing(joint=plan.joints[k], low=low, high=high, way=way, pace=pace, seconds=recorded, needed=needed)
