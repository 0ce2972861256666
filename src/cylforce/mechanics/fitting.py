"""Pins that nobody has measured yet: the nearest ones to given ones with which a cylinder's stroke covers its range."""

from collections.abc import Callable

import numpy as np

from cylforce.mechanics.linkages import Linkage
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.workspace import joint_angles
from cylforce.signals.estimate import Array

STEPS = 200  # where the shortest length jumps between two postures, steps zigzag
CLOSE = 1e-5  # m, to which the lengths are met
STEP = 1e-6  # m, of the difference that gives the derivative
FARTHEST = 0.15  # m, by which no number changes in one step
GRID = 61  # postures along the range
ACROSS = 5  # of every joint that the cylinder reaches over


def range_postures(machine: Machine, c: int) -> Array:
    """Joint angles (K, N) [rad] all over the range of the joint that cylinder c drives, ends included, along the first
    axis as that joint's angle of `drive` rises; joints that the cylinder reaches over in all of their ranges as well.

    A link's angle range is that of its joint; where the cylinder reaches over others, the range that remains of the
    angle of `drive` in every position of those."""
    span = machine.spans[c]
    j, over = max(span), span[:-1]
    low, high = np.array([(link.angle_low, link.angle_high) for link in machine.links]).T
    u = np.tile((low + high) / 2.0, (GRID, ACROSS ** len(over), 1))
    inner = np.meshgrid(*(np.linspace(low[i], high[i], ACROSS) for i in over), indexing="ij")
    for i, angles in zip(over, inner, strict=True):
        u[..., i] = angles.reshape(-1)
    ends = low[j] + sum(high[i] for i in over), high[j] + sum(low[i] for i in over)
    u[..., j] = np.linspace(*ends, GRID)[:, None]
    return joint_angles(machine, u.reshape(-1, machine.size))


def lengths(machine: Machine, c: int, linkage: Linkage) -> tuple[float, float]:
    """Shortest and longest length [m] over the range; NaN where the linkage cannot be closed."""
    found = linkage.stretch(machine.pose(range_postures(machine, c))).length
    return float(np.min(found)), float(np.max(found))


def fitted(
    start: Array, ease: Array, ends: Callable[[Array], tuple[float, float]], wanted: tuple[float, float]
) -> Array:
    """The numbers x (K,) [m] nearest to `start` (K,) for which `ends(x)` = `wanted`, shortest and longest length [m];
    `ease` (K,): how easily each moves, as a share. Newton's method for two equations with K unknowns, each step the
    shortest that solves them to first order: x - E (J E)^+ (ends(x) - wanted), E = diag(ease).

    Raises ValueError when there are none nearby."""
    x, target = start.astype(np.float64), np.array(wanted)
    for _ in range(STEPS):
        left = np.array(ends(x)) - target
        if np.max(np.abs(left)) < CLOSE:
            return x
        step = ease * (np.linalg.pinv(_slopes(x, ends) * ease) @ left)
        x = x - step * min(1.0, FARTHEST / float(np.max(np.abs(step))))
        if not np.all(np.isfinite(x)):
            break
    raise ValueError("no pins near the typical ones give these lengths")


def _slopes(x: Array, ends: Callable[[Array], tuple[float, float]]) -> Array:
    """Derivatives (2, K) of both lengths."""
    columns = [np.subtract(ends(x + d), ends(x - d)) / (2.0 * STEP) for d in STEP * np.eye(len(x))]
    return np.stack(columns, axis=-1)
