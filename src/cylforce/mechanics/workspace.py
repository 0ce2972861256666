"""Working ranges: joint angles clear of end stops and dead points, and the time that a stroke takes."""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from cylforce.mechanics.machine import Geometry, Machine
from cylforce.signals.estimate import Array

PEAK = 1.875  # peak speed of a minimum-jerk stroke, times its mean speed (15/8)
SHARP = 5.77  # peak acceleration of a minimum-jerk stroke, times stroke / time^2 (10/sqrt(3))
HASTE = 0.3  # m/s^2, largest acceleration of a cylinder in such a stroke; chosen: gentle for a hydraulic excavator
GRID = 201  # angles at which a joint's range is examined; chosen
ACROSS = 9  # positions examined of every joint that a cylinder reaches over; chosen
MIN_TRANSMISSION = 0.25  # transmission below which a linkage counts as too near its dead point; chosen
STOP_MARGIN = 0.03  # distance kept from a cylinder's end stops, times its stroke; chosen


def drive(machine: Machine) -> Array:
    """Return the matrix D (N, N) of theta = D u: joint angles from the angles u that the cylinders set.

    Where a joint's cylinder reacts on the body next to it, u is the joint's angle (D: identity). Where it reacts on a
    body farther in, u is the link's angle from that body: the sum of theta over the joints that the cylinder reaches
    over. A wheel loader's tilt cylinder does so, and keeps the bucket's direction while the arm rises.
    """
    sums = np.eye(machine.size)
    for span in machine.spans:
        sums[max(span), list(span)] = 1.0
    return np.asarray(np.linalg.inv(sums))


def drive_angles(machine: Machine, theta: Array) -> Array:
    """Return the angles u (..., N) [rad] of `drive` from joint angles theta (..., N) [rad]."""
    D = drive(machine)
    return theta if np.array_equal(D, machine.identity) else np.asarray(theta @ np.linalg.inv(D).T)


def joint_angles(machine: Machine, u: Array) -> Array:
    """Return joint angles (..., N) [rad] from angles u (..., N) [rad] of `drive`."""
    D = drive(machine)
    return u if np.array_equal(D, machine.identity) else np.asarray(u @ D.T)


def working_range(machine: Machine) -> Array:
    """Return the lowest and highest value (N, 2) [rad] of every angle of `drive` clear of end stops and dead points.

    It is the longest such interval of each joint's range, with the other joints in mid-range. Joints that the cylinder
    reaches over may be anywhere in their own working range. A joint without a cylinder has its whole range. Raises
    ValueError when a joint has no such angle.
    """
    ranges = np.array([(link.angle_low, link.angle_high) for link in machine.links])
    middle = ranges.mean(axis=1)
    for j in range(machine.size):
        ranges[j] = _clear(machine, middle, ranges, j)
    return ranges


def _clear(machine: Machine, middle: Array, ranges: Array, j: int) -> Array:
    """Return the longest interval (2,) [rad] of an angle of `drive`, that of joint j, clear of end stops and dead
    points. Raises ValueError when there is none.

    middle: (N,) middles of the joints' ranges, where the other joints stand [rad]
    ranges: (N, 2) lowest and highest angle of every joint [rad], of joints before j in their working range already
    j: number of the joint, from 0
    """
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
    first, end = runs[np.argmax(runs[:, 1] - runs[:, 0])]
    return np.array([u[0, first, j], u[0, end - 1, j]])


def _drivable(machine: Machine, at: Geometry, j: int) -> NDArray[np.bool_]:
    """Return whether at each pose (...,) no cylinder whose outermost joint is j is near an end stop or dead point.

    Clear is a length more than STOP_MARGIN of the stroke from both ends, and a transmission above MIN_TRANSMISSION.

    at: lengths [m] and transmissions of all cylinders at the poses
    """
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
    """Return the shortest time [s] of a minimum-jerk stroke of one joint within the limits of its cylinders.

    The speed of every cylinder stays below `speed`, its acceleration below HASTE, both computed with the largest lever
    on the way. A joint without a cylinder has a lever of 1 m.

    u: start (N,) [rad], angles of `drive`
    j: number of the joint whose angle of `drive` changes; the others stay
    target: angle of `drive` at the end of the stroke [rad]
    speed: highest cylinder speed [m/s]
    """
    poses = np.tile(u, (17, 1))
    poses[:, j] = np.linspace(u[j], target, 17)
    levers = driven_lever(machine, poses)[:, :, j] if machine.cylinders else np.zeros(0)
    stroke = abs(target - float(u[j])) * (float(np.max(np.abs(levers), initial=0.0)) or 1.0)
    return float(max(PEAK * stroke / speed, np.sqrt(SHARP * stroke / HASTE)))


def driven_lever(machine: Machine, u: Array) -> Array:
    """Return d(length)/du (..., C, N) [m/rad] at angles u (..., N) [rad] of `drive`."""
    D, lever = drive(machine), machine.geometry(joint_angles(machine, u)).lever
    return (
        lever if np.array_equal(D, machine.identity) else np.asarray(lever @ D)
    )  # not multiplied by 1: inf * 0 is NaN


def is_loader(machine: Machine) -> bool:
    """Return whether the tool's cylinder reaches over the arm that carries the tool, as a wheel loader's does."""
    return any(len(span) > 1 and max(span) == machine.size - 1 for span in machine.spans)


def lifting(machine: Machine) -> tuple[int, ...]:
    """Return the numbers of the driven joints that lift all the others.

    On a loader they are all but the last joint, else all but the last two (stick and tool).
    """
    return tuple(j for j in driven(machine) if j < machine.size - (1 if is_loader(machine) else 2))


def driven(machine: Machine) -> tuple[int, ...]:
    """Return the numbers (from 0) of the joints on which at least one cylinder acts; the others are taken as locked."""
    return tuple(sorted({j for span in machine.spans for j in span}))
