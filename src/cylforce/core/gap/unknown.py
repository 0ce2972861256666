"""What is no effect of the library, but what one must be better than before it is believed: torques at one joint of
which nothing is known but that they last some seconds, or go with its angle, or with what other sensors say."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legval

from cylforce.core.gap.library import Group
from cylforce.machine.candidate import SHAPES, TORQUES, About, Course, Place
from cylforce.machine.machine import Machine
from cylforce.machine.reading import joint_angles
from cylforce.words.estimate import Array
from cylforce.words.signals import Kind

NAME = "unknown"
BENDS = 5  # of a torque over a joint's range
OTHERS = 4  # pressures of other cylinders
LEVER = 0.02  # m, below which a cylinder has none


@dataclass(frozen=True, slots=True)
class UnknownTorque:
    """A torque at one joint, for some seconds at a time."""

    @property
    def about(self) -> About:
        """What it says of itself."""
        return About(
            NAME,
            "N m",
            100.0,
            1e6,
            Place.LINK,
            "for some seconds at a time, at one joint",
            "the same moves again: does it come back with posture, speed, load or time?",
            axes=SHAPES,
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns whose sizes change."""
        return TORQUES

    @property
    def course(self) -> Course:
        """How they change."""
        return Course.WINDOWS


@dataclass(frozen=True, slots=True)
class PostureTorque:
    """A torque at one joint that goes with its angle: one of Legendre's polynomials over its range."""

    bend: int = 0

    @property
    def about(self) -> About:
        """What it says of itself."""
        return About(
            NAME,
            "N m",
            100.0,
            2e4,
            Place.LINK,
            "at the same angles again and again",
            "the joint alone, slowly, thrice through its range: does it come back?",
            axes=BENDS,
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """The pressure on the joint's cylinder that makes the torque."""
        link, angle = machine.links[where], joint_angles(machine, values)[:, where]
        share = 2.0 * (angle - link.angle_low) / (link.angle_high - link.angle_low) - 1.0
        return _pushed(machine, values, where, size * legval(share, np.eye(BENDS)[self.bend]), turned=True)


@dataclass(frozen=True, slots=True)
class OthersPressure:
    """A force in one joint's cylinder that goes with what the sensor of another one says."""

    other: int = 0

    @property
    def about(self) -> About:
        """What it says of itself."""
        return About(
            NAME,
            "of pressure",
            0.005,
            0.05,
            Place.LINK,
            "where another cylinder is under load",
            "the other joint against its stop, this one at rest",
            axes=OTHERS,
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """The cylinder's force with a share of another pressure on its head side."""
        kinds = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE)
        own = [c for c, span in enumerate(machine.spans) if where in span]
        area = machine.cylinders[own[0]].area_head if own else 0.0
        others = [k for k, s in enumerate(machine.signals) if s.kind in kinds and s.index not in own]
        if self.other >= len(others) or not own:
            return values
        return _pushed(machine, values, where, size * area * values[:, others[self.other]])


def _pushed(machine: Machine, values: Array, where: int, push: Array, turned: bool = False) -> Array:
    """Values (T, S) with a force (T,) [N] or, `turned`, a torque (T,) [N m] more on a joint's first cylinder."""
    own = [c for c, span in enumerate(machine.spans) if where in span]
    signal = {(s.kind, s.index): k for k, s in enumerate(machine.signals)}
    found = values.copy()
    for c in own[:1]:
        if turned:
            lever = machine.cylinders[c].linkage.stretch(machine.pose(joint_angles(machine, values))).gradient[:, where]
            push = push / np.where(np.abs(lever) > LEVER, lever, LEVER)
        if (Kind.FORCE_PIN, c) in signal:
            found[:, signal[Kind.FORCE_PIN, c]] += push
        elif (Kind.HEAD_PRESSURE, c) in signal:
            found[:, signal[Kind.HEAD_PRESSURE, c]] += push / machine.cylinders[c].area_head
    return found


UNKNOWN: tuple[Group, ...] = (
    (UnknownTorque(),),
    tuple(PostureTorque(bend) for bend in range(BENDS)),
    tuple(OthersPressure(other) for other in range(OTHERS)),
)
