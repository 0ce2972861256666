"""Coverage: for how long each joint moved in each part of its range, in which direction and how fast, and what the
identification still needs."""

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
NEEDED_S = (1.0, 0.5)  # s of slow and of fast motion in each bin; chosen: some correlation times of the filters
TIGHT = 1e-9  # s, tolerance for rounding when seconds are compared


class Way(IntEnum):
    """Which way a joint's cylinder moves."""

    EXTENDING = 0
    RETRACTING = 1


class Pace(IntEnum):
    """How fast it moves."""

    SLOW = 0
    FAST = 1


class Plan(NamedTuple):
    """The motion that a recording must contain. For each of the M driven `joints`: the cylinder that moves it and the
    `edges` (M, BINS+1) [rad] of its angle's bins. `rest` [m/s]: the direction of friction of slower cylinders is
    uncertain; `fast` (M,) [m/s]: from this speed on motion counts as fast; `needed` (M, BINS, 2, 2) [s]: time per bin,
    direction and pace."""

    joints: tuple[int, ...]
    cylinders: tuple[int, ...]
    edges: Array
    rest: float
    fast: Array
    needed: Array


class Missing(NamedTuple):
    """Motion that is still missing: of `joint` between the angles `low` and `high` [rad], its cylinder in direction
    `way` at `pace`; `seconds` [s] were recorded of the `needed` [s]."""

    joint: int
    low: float
    high: float
    way: Way
    pace: Pace
    seconds: float
    needed: float


def plan(machine: Machine, rest: float, ranges: Array | None = None) -> Plan:
    """The motion that a recording of `machine` must contain within `ranges` (N, 2) [rad] of its joints (default: their
    working ranges); cylinders slower than `rest` [m/s] count as not moving. Fast motion is not needed in the outermost
    bins, where every motion starts and stops.

    Raises ValueError when a joint has no angle that its cylinders can drive."""
    joints = driven(machine)
    cylinders = tuple(_mover(machine, j) for j in joints)
    bounds = (working_range(machine) if ranges is None else ranges)[list(joints)]
    stroke = np.array([machine.cylinders[c].length_high - machine.cylinders[c].length_low for c in cylinders])
    needed = np.tile(np.array(NEEDED_S), (len(joints), BINS, 2, 1))
    needed[:, [0, -1], :, Pace.FAST] = 0.0
    return Plan(
        joints, cylinders, np.linspace(bounds[:, 0], bounds[:, 1], BINS + 1, axis=1), rest, stroke / CROSSING_S, needed
    )


def _mover(machine: Machine, j: int) -> int:
    """The cylinder that moves joint j: the one for which j is the outermost joint, else the first that acts on it."""
    acting = [c for c, span in enumerate(machine.spans) if j in span]
    return min(acting, key=lambda c: (max(machine.spans[c]) != j, c))


def coverage(plan: Plan, posture: Array, speed: Array, dt: float) -> Array:
    """Time (M, BINS, 2, 2) [s] per joint, bin of its angle, direction and pace of its cylinder, from samples `dt` [s]
    apart of the angles `posture` (T, N) [rad] of `drive` and cylinder speeds `speed` (T, C) [m/s]. The coverage of a
    recording is the sum of those of its parts; angles beyond the range count in the outermost bin."""
    found = np.zeros_like(plan.needed)
    for k, (j, c) in enumerate(zip(plan.joints, plan.cylinders, strict=True)):
        size = np.abs(speed[:, c])
        moves = np.logical_and(size > plan.rest, np.isfinite(posture[:, j]))
        part, v = _bin(plan.edges[k], posture[moves, j]), speed[moves, c]
        np.add.at(found[k], (part, (v < 0.0).astype(int), (size[moves] >= plan.fast[k]).astype(int)), dt)
    return found


def _bin(edges: Array, angle: Array) -> NDArray[np.intp]:
    return np.clip(np.searchsorted(edges, angle, side="right") - 1, 0, BINS - 1)


def planes(plan: Plan, posture: Array, speed: Array, dt: float) -> Array:
    """Time (M-1, BINS, BINS) [s] during which any cylinder moved, per pair of bins of each two neighbouring driven
    joints; arguments as in `coverage`."""
    moves = np.logical_and(np.any(np.abs(speed) > plan.rest, axis=1), np.all(np.isfinite(posture), axis=1))
    parts = [_bin(edges, posture[moves, j]) for edges, j in zip(plan.edges, plan.joints, strict=True)]
    found = np.zeros((max(len(parts) - 1, 0), BINS, BINS))
    for k, pair in enumerate(pairwise(parts)):
        np.add.at(found[k], pair, dt)
    return found


def share(plan: Plan, seconds: Array) -> float:
    """Share (0..1) of the needed time that the `seconds` of `coverage` contain."""
    return float(np.sum(np.minimum(seconds, plan.needed)) / np.sum(plan.needed))


def missing(plan: Plan, seconds: Array) -> tuple[Missing, ...]:
    """The motion that the `seconds` of `coverage` lack, neighbouring bins combined, the largest lack first."""
    gaps = [
        _gap(plan, seconds, k, part, way, pace)
        for k in range(len(plan.joints))
        for way in Way
        for pace in Pace
        for part in _runs(seconds[k, :, way, pace] < plan.needed[k, :, way, pace] - TIGHT)
    ]
    return tuple(sorted(gaps, key=lambda gap: gap.seconds - gap.needed))


def _runs(lacks: NDArray[np.bool_]) -> list[slice]:
    """The runs of consecutive true values in `lacks` (BINS,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lacks.astype(int), [0]])))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _gap(plan: Plan, seconds: Array, k: int, part: slice, way: Way, pace: Pace) -> Missing:
    low, high = float(plan.edges[k, part.start]), float(plan.edges[k, part.stop])
    there, needed = (float(np.sum(table[k, part, way, pace])) for table in (seconds, plan.needed))
    return Missing(plan.joints[k], low, high, way, pace, there, needed)
