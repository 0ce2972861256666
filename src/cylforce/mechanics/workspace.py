"""Working ranges: joint angles clear of end stops and dead points, and the time that a stroke takes."""

import numpy as np

from cylforce.mechanics.machine import Geometry, Machine
from cylforce.signals.estimate import Array

PEAK = 1.875  # times the mean speed: peak speed of a minimum-jerk stroke (15/8)
SHARP = 5.77  # times stroke / time^2: peak acceleration of a minimum-jerk stroke (10/sqrt(3))
HASTE = 0.3  # m/s^2, largest acceleration of a cylinder in such a stroke; chosen: gentle for a hydraulic excavator
GRID = 201  # angles at which a joint's range is examined; chosen
MIN_TRANSMISSION = 0.25  # sine at the linkage below which it counts as too near its dead point; chosen
STOP_MARGIN = 0.03  # times a cylinder's stroke: distance kept from its end stops; chosen


def working_range(machine: Machine) -> Array:
    """Lowest and highest angle (N, 2) [rad] of every joint clear of end stops and dead points, with the other joints in
    mid-range: the longest such part of the joint's range.

    Raises ValueError when a joint has no such angle."""
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
    """Which poses (T,) leave every cylinder on joint j clear of its end stops and dead points."""
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
    """Shortest time [s] of a minimum-jerk stroke of joint j from pose `theta` (N,) to `target` [rad] whose cylinders
    stay below `speed` [m/s] and HASTE [m/s^2]; a joint without a cylinder is given a lever of 1 m."""
    poses = np.tile(theta, (17, 1))
    poses[:, j] = np.linspace(theta[j], target, 17)
    lever = float(np.max(np.abs(machine.geometry(poses).lever[:, :, j]), initial=0.0)) if machine.cylinders else 0.0
    stroke = abs(target - float(theta[j])) * (lever or 1.0)
    return float(max(PEAK * stroke / speed, np.sqrt(SHARP * stroke / HASTE)))


def driven(machine: Machine) -> tuple[int, ...]:
    """Numbers of the joints on which at least one cylinder acts; the others are taken as locked."""
    return tuple(sorted({j for span in machine.spans for j in span}))
