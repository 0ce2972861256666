"""How the simulated machine is moved: strokes of minimum jerk, overlapping between joints as an operator's
levers do.

Positions, velocities and accelerations are analytic. No code knows a link's name: the last link is the tool,
the one before it the stick, all before that lift. Larger joint angles raise, reach out and open; smaller ones
curl.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from cylforce.core.soil import Dig
from cylforce.machine.machine import Geometry, Machine
from cylforce.words.estimate import Array

PEAK = 1.875  # largest speed of a minimum-jerk stroke over its mean speed
SHARP = 5.77  # largest acceleration over stroke / time^2
HASTE = 0.3  # m/s^2, of any cylinder
GRID = 201
MIN_TRANSMISSION = 0.25  # the sine below which a linkage comes too near its dead point to be driven there
STOP_MARGIN = 0.03  # of a cylinder's stroke kept free at its end stops


class Phase(IntEnum):
    """What the machine does; written into the truth."""

    AIR = 0
    REACH = 1
    DIG = 2
    LIFT = 3
    DUMP = 4
    RETURN = 5


class Step(NamedTuple):
    """A stroke of minimum jerk from `start` to `stop` [s] by `rise` [rad]."""

    start: float
    stop: float
    rise: float


class Course(NamedTuple):
    """One joint's (or the house's) angle: `begin` [rad] and the strokes added to it."""

    begin: float
    steps: tuple[Step, ...] = ()

    @property
    def end(self) -> float:
        """The angle [rad] after all strokes."""
        return self.begin + sum(step.rise for step in self.steps)

    def at(self, t: Array) -> Array:
        """Angle, rate and acceleration (3, T) [rad, rad/s, rad/s^2] at times (T,) [s]:
        rise (10 u^3 - 15 u^4 + 6 u^5), u = (t - start)/(stop - start) within 0..1."""
        start, stop, rise = np.array(self.steps).reshape(-1, 3).T
        length = stop - start
        u = np.clip((t[:, None] - start) / length, 0.0, 1.0)
        angle = self.begin + (u**3 * (10 - 15 * u + 6 * u**2)) @ rise
        rate = (30 * u**2 * (1 - u) ** 2) @ (rise / length)
        return np.stack([angle, rate, (60 * u * (1 - u) * (1 - 2 * u)) @ (rise / length**2)])


class Scene(NamedTuple):
    """A piece of a run: `duration` [s], the joints' and the house's courses, (start [s], phase) in order, the
    digging."""

    duration: float
    joints: tuple[Course, ...]
    slew: Course
    phases: tuple[tuple[float, Phase], ...]
    dig: Dig | None = None


class Kinematics(NamedTuple):
    """A scene at T instants: `theta`, `thetad`, `thetadd` (T, N), house angle `turn` and rate `slew` (T,),
    `phase` (T,)."""

    theta: Array
    thetad: Array
    thetadd: Array
    turn: Array
    slew: Array
    phase: Array


def follow(scene: Scene, t: Array) -> Kinematics:
    """The scene at times (T,) [s] from its own start."""
    theta, thetad, thetadd = np.stack([course.at(t) for course in scene.joints], axis=-1)
    turn, slew, _ = scene.slew.at(t)
    starts = np.array([start for start, _ in scene.phases])
    names = np.array([float(phase) for _, phase in scene.phases])
    phase = names[np.maximum(np.searchsorted(starts, t, side="right") - 1, 0)]
    return Kinematics(theta, thetad, thetadd, turn, slew, phase)


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
