"""Where an arm can be driven, and how fast: joint ranges clear of end stops and dead points, times of strokes."""

import numpy as np

from cylforce.mechanics.machine import Geometry, Machine
from cylforce.signals.estimate import Array

PEAK = 1.875  # largest speed of a minimum-jerk stroke over its mean speed
SHARP = 5.77  # largest acceleration over stroke / time^2
HASTE = 0.3  # m/s^2, of any cylinder
GRID = 201
MIN_TRANSMISSION = 0.25  # the sine below which a linkage comes too near its dead point to be driven there
STOP_MARGIN = 0.03  # of a cylinder's stroke kept free at its end stops


def working_range(machine: Machine) -> Array:
    """Joint angles (N, 2) [rad] that can be driven: clear of end stops and dead points, the other joints
    midway."""
    middle = np.array([(link.angle_low + link.angle_high) / 2 for link in machine.links])
    return np.array([_clear(machine, middle, j) for j in range(machine.size)])


def _clear(machine: Machine, middle: Array, j: int) -> Array:
    theta = np.tile(middle, (GRID, 1))
    theta[:, j] = np.linspace(machine.links[j].angle_low, machine.links[j].angle_high, GRID)
    good = np.concatenate([[False], _drivable(machine, machine.geometry(theta), j), [False]])
    edges = np.flatnonzero(np.diff(good.astype(int)))
    if edges.size == 0:
        raise ValueError(f"link {machine.links[j].name}: no angle of its range lies between its cylinder's end stops")
    runs = edges.reshape(-1, 2)
    first, behind = runs[np.argmax(runs[:, 1] - runs[:, 0])]
    return np.array([theta[first, j], theta[behind - 1, j]])


def _drivable(machine: Machine, at: Geometry, j: int) -> Array:
    """Which of the poses every cylinder on joint j can hold (T,)."""
    good = np.ones(at.length.shape[0], dtype=bool)
    for c, cylinder in enumerate(machine.cylinders):
        if j in machine.spans[c]:
            margin = STOP_MARGIN * (cylinder.length_high - cylinder.length_low)
            inside = (at.length[:, c] > cylinder.length_low + margin) & (
                at.length[:, c] < cylinder.length_high - margin
            )
            good &= inside & (at.transmission[:, c] > MIN_TRANSMISSION)
    return good


def stroke_time(machine: Machine, theta: Array, j: int, target: float, speed: float) -> float:
    """Shortest time [s] of a stroke of joint j from pose `theta` (N,) to `target` [rad] whose cylinders stay
    below `speed` [m/s] and HASTE [m/s^2]; a joint without a cylinder counts as one with a lever of 1 m."""
    poses = np.tile(theta, (17, 1))
    poses[:, j] = np.linspace(theta[j], target, 17)
    lever = float(np.max(np.abs(machine.geometry(poses).lever[:, :, j]), initial=0.0)) if machine.cylinders else 0.0
    stroke = abs(target - float(theta[j])) * (lever or 1.0)
    return float(max(PEAK * stroke / speed, np.sqrt(SHARP * stroke / HASTE)))


def driven(machine: Machine) -> tuple[int, ...]:
    """The joints that some cylinder moves; the others are locked."""
    return tuple(sorted({j for span in machine.spans for j in span}))
