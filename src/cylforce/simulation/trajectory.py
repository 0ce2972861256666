"""Motion of the simulated machine: minimum-jerk strokes, which overlap between joints as under an operator.

Angles, rates and accelerations are analytic. The roles of the links follow from their order, not from their names: the
last link is the tool, the one before it the stick, all others lift. Larger joint angles raise, reach out and open the
tool; smaller ones curl it.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from cylforce.signals.estimate import Array
from cylforce.simulation.soil import Dig


class Phase(IntEnum):
    """What the machine does at a time; written into the truth file."""

    AIR = 0
    REACH = 1
    DIG = 2
    LIFT = 3
    DUMP = 4
    RETURN = 5


class Move(NamedTuple):
    """A minimum-jerk stroke from `start` to `stop` [s] that changes the angle by `rise` [rad]."""

    start: float
    stop: float
    rise: float


class JointCourse(NamedTuple):
    """One joint's (or the house's) angle.

    begin:   angle at the start [rad]
    steps:   strokes added to it
    sampled: change since the start [rad] over time [s] of a motion that a table gives, added too; None: there is none
    """

    begin: float
    steps: tuple[Move, ...] = ()
    sampled: CubicSpline | None = None

    @property
    def end(self) -> float:
        """The angle [rad] after all strokes."""
        last = 0.0 if self.sampled is None else float(self.sampled(self.sampled.x[-1]))
        return self.begin + last + sum(step.rise for step in self.steps)

    def at(self, t: Array) -> Array:
        """Angle, rate and acceleration (3, T) [rad, rad/s, rad/s^2] at times (T,) [s], which ascend:
        rise (10 u^3 - 15 u^4 + 6 u^5), u = (t - start)/(stop - start) within 0..1.

        Each stroke is evaluated where it moves only, so that hours of strokes take memory and time in proportion."""
        found, done = np.zeros((3, len(t))), np.zeros(len(t) + 1)
        for step in self.steps:
            first, after = np.searchsorted(t, (step.start, step.stop))
            found[:, first:after] += _stroke(step, t[first:after])
            done[after] += step.rise
        found[0] += self.begin + np.cumsum(done[:-1])
        if self.sampled is not None:
            found += np.stack([self.sampled(t, order) for order in range(3)])
        return found


def _stroke(step: Move, t: Array) -> Array:
    """Angle, rate and acceleration (3, T) that a stroke adds at times (T,) [s] between its start and its stop."""
    length = step.stop - step.start
    u = (t - step.start) / length
    angle = u**3 * (10 - 15 * u + 6 * u**2)
    rate = 30 * u**2 * (1 - u) ** 2 * (step.rise / length)
    return np.stack([angle * step.rise, rate, 60 * u * (1 - u) * (1 - 2 * u) * (step.rise / length**2)])


class Scene(NamedTuple):
    """A part of a run: its `duration` [s], the courses of joints and house, (start [s], phase) in order of time, and
    the digging operation."""

    duration: float
    joints: tuple[JointCourse, ...]
    slew: JointCourse
    phases: tuple[tuple[float, Phase], ...]
    dig: Dig | None = None


class Kinematics(NamedTuple):
    """The motion of a scene at T instants: joint angles `theta` [rad], rates `thetad` [rad/s], accelerations `thetadd`
    [rad/s^2] (T, N); house angle `turn` [rad] and rate `slew` [rad/s] (T,); `phase` (T,)."""

    theta: Array
    thetad: Array
    thetadd: Array
    turn: Array
    slew: Array
    phase: Array


def follow(scene: Scene, t: Array) -> Kinematics:
    """The motion of a scene at times t (T,) [s] from its start."""
    theta, thetad, thetadd = np.stack([course.at(t) for course in scene.joints], axis=-1)
    turn, slew, _ = scene.slew.at(t)
    starts = np.array([start for start, _ in scene.phases])
    names = np.array([float(phase) for _, phase in scene.phases])
    phase = names[np.maximum(np.searchsorted(starts, t, side="right") - 1, 0)]
    return Kinematics(theta, thetad, thetadd, turn, slew, phase)
