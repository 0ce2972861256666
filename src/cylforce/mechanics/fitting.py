"""Estimate pins and bar lengths that nobody has measured.

They are those nearest to typical ones with which the cylinder's stroke covers the joint's range.
"""

from collections.abc import Callable

import numpy as np

from cylforce.mechanics.linkages import Linkage
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.workspace import joint_angles
from cylforce.signals.estimate import Array

STEPS = 200  # Newton steps at most: they zigzag where the shortest length jumps between two postures; chosen
CLOSE = 1e-5  # m, error of both lengths at which the iteration ends; chosen
STEP = 1e-6  # m, width of the central difference that gives the derivative; chosen
FARTHEST = 0.15  # m, largest change of a coordinate in one step; chosen
GRID = 61  # postures along the range of the driven joint; chosen
ACROSS = 5  # angles, over its range, of every joint that the cylinder reaches over; chosen


def range_postures(machine: Machine, c: int) -> Array:
    """Return joint angles (K, N) [rad] over the whole range of the joint that cylinder c drives, both ends included.

    K = GRID postures for a cylinder that acts on one joint: its angle rises, all others are in mid-range. The joint
    driven by a cylinder that reaches over n others is the outermost one, and K = GRID * ACROSS^n: the angle of
    `workspace.drive` rises, and at each of its values the joints reached over pass through their own ranges. That angle
    covers the range in which the driven joint stays within its own range, wherever the joints reached over are.
    """
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
    """Return the shortest and longest length [m] of cylinder c over the `range_postures` of the joint that it drives.

    Both are NaN where the linkage cannot be closed in one of these postures.

    linkage: linkage of the cylinder, in place of that of the machine
    """
    length = linkage.stretch(machine.pose(range_postures(machine, c))).length
    return float(np.min(length)), float(np.max(length))


def fitted(
    start: Array, ease: Array, ends: Callable[[Array], tuple[float, float]], wanted: tuple[float, float]
) -> Array:
    """Return pin coordinates and bar lengths x (K,) [m] near `start`, with which a cylinder has the wanted lengths.

    Newton's method for two equations with K unknowns. Each step is the shortest that solves them to first order:
    x - E (J E)^+ (ends(x) - wanted), E = diag(ease); no number changes by more than FARTHEST in one step. Raises
    ValueError when both lengths are not right to CLOSE within STEPS steps, or a linkage on the way cannot be closed.

    start: (K,) typical coordinates and bar lengths [m]
    ease: (K,) how far each of them may change relative to the others; 1: freely, 0: not at all
    ends: function of x that returns the cylinder's shortest and longest length [m] over its joint's range
    wanted: its shortest and longest length [m]
    """
    x, target = start.astype(np.float64), np.array(wanted)
    for _ in range(STEPS):
        error = np.array(ends(x)) - target
        if np.max(np.abs(error)) < CLOSE:
            return x
        step = ease * (np.linalg.pinv(_slopes(x, ends) * ease) @ error)
        x = x - step * min(1.0, FARTHEST / float(np.max(np.abs(step))))
        if not np.all(np.isfinite(x)):
            break
    raise ValueError("no pins near the typical ones give these lengths")


def _slopes(x: Array, ends: Callable[[Array], tuple[float, float]]) -> Array:
    """Return the derivatives (2, K) [m/m] of two lengths by x (K,) [m], as central differences.

    x: pin coordinates and bar lengths [m]
    ends: function of x that returns the cylinder's shortest and longest length [m]
    """
    columns = [np.subtract(ends(x + d), ends(x - d)) / (2.0 * STEP) for d in STEP * np.eye(len(x))]
    return np.stack(columns, axis=-1)
