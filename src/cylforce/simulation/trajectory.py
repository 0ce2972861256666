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
    """Phase of the work cycle; written into the truth file."""

    AIR = 0
    REACH = 1
    DIG = 2
    LIFT = 3
    DUMP = 4
    RETURN = 5


class Move(NamedTuple):
    """A minimum-jerk stroke.

    start, stop: time from the start of the scene [s]
    rise: change of the angle, with its sign [rad]
    """

    start: float
    stop: float
    rise: float


class JointCourse(NamedTuple):
    """The angle of one joint, or of the house, over time.

    begin:   angle at the beginning [rad]
    moves:   strokes that are added to it
    sampled: change of a recorded or written motion since the start [rad] over time [s], added as well; None: no such
             motion
    """

    begin: float
    moves: tuple[Move, ...] = ()
    sampled: CubicSpline | None = None

    @property
    def end(self) -> float:
        """Return the angle [rad] after all strokes."""
        last = 0.0 if self.sampled is None else float(self.sampled(self.sampled.x[-1]))
        return self.begin + last + sum(move.rise for move in self.moves)

    def at(self, t: Array) -> Array:
        """Return angle, rate and acceleration (3, T) [rad, rad/s, rad/s^2] at ascending times t (T,) [s].

        Each stroke is rise (10 u^3 - 15 u^4 + 6 u^5), with u = (t - start)/(stop - start) within 0..1. It is evaluated
        only where it moves, so that memory and time stay in proportion for hours of strokes.
        """
        course, completed = np.zeros((3, len(t))), np.zeros(len(t) + 1)
        for move in self.moves:
            first, after = np.searchsorted(t, (move.start, move.stop))
            course[:, first:after] += _stroke(move, t[first:after])
            completed[after] += move.rise
        course[0] += self.begin + np.cumsum(completed[:-1])
        if self.sampled is not None:
            course += np.stack([self.sampled(t, order) for order in range(3)])
        return course


def _stroke(move: Move, t: Array) -> Array:
    """Return angle [rad], rate [rad/s] and acceleration [rad/s^2] that a stroke adds, as rows (3, T).

    t: (T,) times between its start and its stop [s]
    """
    length = move.stop - move.start
    u = (t - move.start) / length
    angle = u**3 * (10 - 15 * u + 6 * u**2)
    rate = 30 * u**2 * (1 - u) ** 2 * (move.rise / length)
    return np.stack([angle * move.rise, rate, 60 * u * (1 - u) * (1 - 2 * u) * (move.rise / length**2)])


class Scene(NamedTuple):
    """A part of a run.

    duration: [s]
    joints: courses of the N joints; of the angles of `drive` until `scenario.of_joints` converts them
    slew: course of the house
    phases: (start from that of the scene [s], phase) in order of time
    dig: the digging operation; None: an empty bucket
    """

    duration: float
    joints: tuple[JointCourse, ...]
    slew: JointCourse
    phases: tuple[tuple[float, Phase], ...]
    dig: Dig | None = None


class Kinematics(NamedTuple):
    """The motion of a scene at T instants.

    theta: (T, N) joint angles [rad]
    thetad: (T, N) joint rates [rad/s]
    thetadd: (T, N) joint accelerations [rad/s^2]
    turn: (T,) angle of the house [rad]
    slew: (T,) rate of the house [rad/s]
    phase: (T,) number of the phase
    """

    theta: Array
    thetad: Array
    thetadd: Array
    turn: Array
    slew: Array
    phase: Array


def follow(scene: Scene, t: Array) -> Kinematics:
    """Return the motion of a scene at times t (T,) [s] from its start: angles [rad] and their derivatives."""
    theta, thetad, thetadd = np.stack([course.at(t) for course in scene.joints], axis=-1)
    turn, slew = scene.slew.at(t)[:2]
    starts = np.array([start for start, _ in scene.phases])
    names = np.array([float(phase) for _, phase in scene.phases])
    phase = names[np.maximum(np.searchsorted(starts, t, side="right") - 1, 0)]
    return Kinematics(theta=theta, thetad=thetad, thetadd=thetadd, turn=turn, slew=slew, phase=phase)
