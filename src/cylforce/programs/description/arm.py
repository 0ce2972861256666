"""The numbers of an arm: ranges, cylinder lengths against strokes, levers, torques, the reach of the tool."""

from itertools import product
from typing import NamedTuple

import numpy as np

from cylforce.mechanics.fitting import range_postures
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.workspace import drive_angles, driven_lever, joint_angles
from cylforce.signals.estimate import Array

PRESSURE = 300e5  # Pa at which torques are given: a typical working pressure
GRID = 25  # postures of each joint for the reach


class CylinderNumbers(NamedTuple):
    """Numbers of a cylinder and of the angle that it sets, at that angle's low end, middle and high end.

    name:         of the cylinder
    joint:        number of the joint, from 0
    reaches_over: numbers of the other joints that it reaches over, midway in their range
    angle:        (3,) angle [rad]
    length:       (3,) length [m]
    lever:        (3,) d(length)/d(angle) [m/rad]
    closed:       shortest length [m]
    opened:       longest length [m]
    left:         remaining stroke [m], closed and open, at the worst posture
    push:         (3,) torque at PRESSURE in the head chamber [N m]
    pull:         (3,) torque at PRESSURE in the rod chamber [N m]
    """

    name: str
    joint: int
    reaches_over: tuple[int, ...]
    angle: Array
    length: Array
    lever: Array
    closed: float
    opened: float
    left: tuple[float, float]
    push: Array
    pull: Array


class Extent(NamedTuple):
    """Reach of the tool from the first pin.

    forward: [m]
    up:      [m]
    down:    [m]
    """

    forward: float
    up: float
    down: float


def set_ranges(machine: Machine) -> Array:
    """Return the range (N, 2) [rad] of each angle of `drive`, from the joints' angle ranges."""
    found = np.array([(link.angle_low, link.angle_high) for link in machine.links])
    for c, span in enumerate(machine.spans):
        u = drive_angles(machine, range_postures(machine, c))[:, max(span)]
        found[max(span)] = u.min(), u.max()
    return found


def cylinder_numbers(machine: Machine) -> tuple[CylinderNumbers, ...]:
    """Return the numbers of every cylinder."""
    return tuple(_numbers(machine, c) for c in range(len(machine.cylinders)))


def _numbers(machine: Machine, c: int) -> CylinderNumbers:
    cylinder, span = machine.cylinders[c], machine.spans[c]
    j, ranges = max(span), set_ranges(machine)
    u = np.tile(ranges.mean(axis=1), (3, 1))
    u[:, j] = ranges[j, 0], ranges[j].mean(), ranges[j, 1]
    length = machine.geometry(joint_angles(machine, u)).length[:, c]
    every = machine.geometry(range_postures(machine, c)).length[:, c]
    lever = driven_lever(machine, u)[:, c, j]
    return CylinderNumbers(
        name=cylinder.name,
        joint=j,
        reaches_over=span[:-1],
        angle=u[:, j],
        length=length,
        lever=lever,
        closed=cylinder.length_low,
        opened=cylinder.length_high,
        left=(float(every.min()) - cylinder.length_low, cylinder.length_high - float(every.max())),
        push=PRESSURE * cylinder.area_head * lever,
        pull=-PRESSURE * cylinder.area_rod * lever,
    )


def postures(machine: Machine) -> Array:
    """Return the joint angles (3, N) [rad] at the low ends, the middles and the high ends of all ranges."""
    low, high = set_ranges(machine).T
    return joint_angles(machine, np.array([low, (low + high) / 2.0, high]))


def extent(machine: Machine) -> Extent:
    """Return the reach over all joint ranges, with a level chassis and without regard to the ground."""
    grids = (np.linspace(low, high, GRID) for low, high in set_ranges(machine))
    places = machine.tool_point(joint_angles(machine, np.array(list(product(*grids))))).place
    return Extent(float(places.real.max()), float(places.imag.max()), -float(places.imag.min()))


def pin_heights(machine: Machine) -> tuple[float, float]:
    """Return the lowest and highest position [m] of the last link's pin above the first pin, chassis level."""
    grids = (np.linspace(low, high, GRID) for low, high in set_ranges(machine))
    heights = machine.pose(joint_angles(machine, np.array(list(product(*grids))))).origin[..., -1].imag
    return float(heights.min()), float(heights.max())
