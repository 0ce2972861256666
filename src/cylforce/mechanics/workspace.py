"""Working ranges: joint angles clear of end stops and dead points, and the time that a stroke takes."""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from cylforce.mechanics.machine import Geometry, Machine
from cylforce.signals.estimate import Array

PEAK = 1.875  # times the mean speed: peak speed of a minimum-jerk stroke (15/8)
SHARP = 5.77  # times stroke / time^2: peak acceleration of a minimum-jerk stroke (10/sqrt(3))
HASTE = 0.3  # m/s^2, largest acceleration of a cylinder in such a stroke; chosen: gentle for a hydraulic excavator
GRID = 201  # angles at which a joint's range is examined; chosen
ACROSS = 9  # positions examined of every joint that a cylinder reaches over; chosen
MIN_TRANSMISSION = 0.25  # sine at the linkage below which it counts as too near its dead point; chosen
STOP_MARGIN = 0.03  # times a cylinder's stroke: distance kept from its end stops; chosen


def drive(machine: Machine) -> Array:
    """(N, N) matrix D of theta = D u: joint angles from the angles u that the cylinders set.

    Where a joint's cylinder reacts on the body next to it, u is the joint's angle (D: identity). Where it reacts on a
    body farther in (a wheel loader's tilt cylinder, which keeps the bucket's direction while the arm rises), u is the
    link's angle from that body: the sum of theta over the joints that the cylinder reaches over."""
    sums = np.eye(machine.size)
    for span in machine.spans:
        sums[max(span), list(span)] = 1.0
    return np.asarray(np.linalg.inv(sums))


def drive_angles(machine: Machine, theta: Array) -> Array:
    """Angles (..., N) [rad] of `drive` from joint angles (..., N) [rad]."""
    D = drive(machine)
    return theta if np.array_equal(D, machine.identity) else np.asarray(theta @ np.linalg.inv(D).T)


def joint_angles(machine: Machine, u: Array) -> Array:
    """Joint angles (..., N) [rad] from angles (..., N) [rad] of `drive`."""
    D = drive(machine)
    return u if np.array_equal(D, machine.identity) else np.asarray(u @ D.T)


def working_range(machine: Machine) -> Array:
    """Lowest and highest value (N, 2) [rad] of every angle of `drive` clear of end stops and dead points, with the
    other joints in mid-range: the longest such part of the joint's range. Joints that the cylinder reaches over may be
    anywhere in their own working range.

    Raises ValueError when a joint has no such angle."""
    found = np.array([(link.angle_low, link.angle_high) for link in machine.links])
    middle = found.mean(axis=1)
    for j in range(machine.size):
        found[j] = _clear(machine, middle, found, j)
    return found


def _clear(machine: Machine, middle: Array, ranges: Array, j: int) -> Array:
    over = sorted({i for span in machine.spans if max(span) == j for i in span if i < j})
    inner = np.array(list(product(*(np.linspace(ranges[i, 0], ranges[i, 1], ACROSS) for i in over))))
    u = np.tile(middle, (len(inner), GRID, 1))
    u[..., over] = inner[:, None, :]
    carried = inner.sum(axis=1)
    u[..., j] = np.linspace(ranges[j, 0] + carried.max(), ranges[j, 1] + carried.min(), GRID)
    theta = u.copy()
    theta[..., j] -= carried[:, None]
    good = np.all(_drivable(machine, machine.geometry(theta), j), axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    if edges.size == 0:
        raise ValueError(f"link {machine.links[j].name}: no angle of its range lies between its cylinder's end stops")
    runs = edges.reshape(-1, 2)
    first, behind = runs[np.argmax(runs[:, 1] - runs[:, 0])]
    return np.array([u[0, first, j], u[0, behind - 1, j]])


def _drivable(machine: Machine, at: Geometry, j: int) -> NDArray[np.bool_]:
    """Which poses (...,) leave every cylinder that ends at joint j clear of its end stops and dead points."""
    good = np.ones(at.length.shape[:-1], dtype=bool)
    for c, cylinder in enumerate(machine.cylinders):
        if max(machine.spans[c]) == j:
            margin = STOP_MARGIN * (cylinder.length_high - cylinder.length_low)
            inside = (at.length[..., c] > cylinder.length_low + margin) & (
                at.length[..., c] < cylinder.length_high - margin
            )
            good &= inside & (at.transmission[..., c] > MIN_TRANSMISSION)
    return good


def stroke_time(machine: Machine, u: Array, j: int, target: float, speed: float) -> float:
    """Shortest time [s] of a minimum-jerk stroke of angle j of `drive` from u (N,) to `target` [rad] whose cylinders
    stay below `speed` [m/s] and HASTE [m/s^2]; a joint without a cylinder is given a lever of 1 m."""
    poses = np.tile(u, (17, 1))
    poses[:, j] = np.linspace(u[j], target, 17)
    levers = driven_lever(machine, poses)[:, :, j] if machine.cylinders else np.zeros(0)
    stroke = abs(target - float(u[j])) * (float(np.max(np.abs(levers), initial=0.0)) or 1.0)
    return float(max(PEAK * stroke / speed, np.sqrt(SHARP * stroke / HASTE)))


def driven_lever(machine: Machine, u: Array) -> Array:
    """d(length)/du (..., C, N) [m/rad] at angles u (..., N) [rad] of `drive`."""
    D, lever = drive(machine), machine.geometry(joint_angles(machine, u)).lever
    return lever if np.array_equal(D, machine.identity) else np.asarray(lever @ D)  # as it is where it is infinite


def is_loader(machine: Machine) -> bool:
    """Whether the tool's cylinder reaches over the arm that carries the tool, as a wheel loader's does."""
    return any(len(span) > 1 and max(span) == machine.size - 1 for span in machine.spans)


def lifting(machine: Machine) -> tuple[int, ...]:
    """Numbers of the driven joints that lift all the others: a loader's arm, else those before the stick."""
    return tuple(j for j in driven(machine) if j < machine.size - (1 if is_loader(machine) else 2))


def driven(machine: Machine) -> tuple[int, ...]:
    """Numbers of the joints on which at least one cylinder acts; the others are taken as locked."""
    return tuple(sorted({j for span in machine.spans for j in span}))
