"""Unknown torques at one joint, with which the library's effects are compared.

They last some seconds, or vary with the joint's angle, or with the pressures of other cylinders; otherwise they are
arbitrary. A cause is named only if it is more probable than these. The first family has half of the prior probability
of a cause that the library lacks, the other two share the other half, over all joints (`decide.py`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import legval

from cylforce.effects.fault import SHAPES, TORQUES, About, Place, TimeCourse
from cylforce.effects.library import Group
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.reading import joint_angles
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import SIDES, Kind

NAME = "unknown"
BENDS = 5  # number of Legendre polynomials (degree 0 to 4) that make a torque over a joint's range
OTHERS = 4  # largest number of pressures of other cylinders
LEVER = 0.02  # m, a shorter lever counts as this one, so that nothing is divided by zero


@dataclass(frozen=True, slots=True)
class UnknownTorque:
    """A torque at one joint, for some seconds at a time, with any course in these seconds: an incident."""

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name=NAME,
            unit="N m",
            low=100.0,
            high=1e6,
            place=Place.LINK,
            shows="for some seconds at a time, at one joint",
            confirm="the same moves again: does it come back with posture, speed, load or time?",
            axes=SHAPES,
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns whose sizes change."""
        return TORQUES

    @property
    def course(self) -> TimeCourse:
        """Course of the sizes over time."""
        return TimeCourse.WINDOWS


@dataclass(frozen=True, slots=True)
class PostureTorque:
    """A torque at one joint that goes with its angle: one of Legendre's polynomials over its range."""

    bend: int = 0  # degree of the polynomial

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name=NAME,
            unit="N m",
            low=100.0,
            high=2e4,
            place=Place.LINK,
            shows="at the same angles again and again",
            confirm="the joint alone, slowly, thrice through its range: does it come back?",
            axes=BENDS,
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with the torque added to what the sensors of the joint's cylinder read.

        The torque is `size` times Legendre's polynomial of degree `bend` in the joint's angle, -1 at the low end of its
        range and 1 at the high end. Divided by the lever it is a force, which changes the force pin or the head-side
        pressure of the first cylinder that acts on the joint. The same object where none acts on it.

        values: (T, S) signals without the error [SI]
        where:  number of the joint
        size:   factor on the polynomial [N m]
        """
        link, angle = machine.links[where], joint_angles(machine, values)[:, where]
        share = 2.0 * (angle - link.angle_low) / (link.angle_high - link.angle_low) - 1.0
        own = _cylinder(machine, where)
        if own is None:
            return values
        lever = machine.cylinders[own].linkage.stretch(machine.pose(joint_angles(machine, values))).gradient[:, where]
        torque = size * legval(share, np.eye(BENDS)[self.bend])
        return _pushed(machine, values, own, torque / np.where(np.abs(lever) > LEVER, lever, LEVER))


@dataclass(frozen=True, slots=True)
class OthersPressure:
    """Force in one joint's cylinder in proportion to the reading of another cylinder's sensor."""

    other: int = 0  # number of the sensor among the pressures of cylinders that do not turn this joint

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name=NAME,
            unit="of pressure",
            low=0.005,
            high=0.05,
            place=Place.LINK,
            shows="where another cylinder is under load",
            confirm="the other joint against its stop, this one at rest",
            axes=OTHERS,
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with `size` times another pressure added to the joint's cylinder, on its head side.

        Where a force pin measures that cylinder, its reading changes by that pressure times the head area. The same
        object where no cylinder acts on the joint, or there are not so many other pressures.

        values: (T, S) signals without the error [SI]
        where:  number of the joint
        size:   share of the other pressure [1]
        """
        spans, own = machine.spans, _cylinder(machine, where)
        others = [k for k, s in enumerate(machine.signals) if s.kind in SIDES and where not in spans[s.index]]
        if own is None or self.other >= len(others):
            return values
        return _pushed(machine, values, own, size * machine.cylinders[own].area_head * values[:, others[self.other]])


def _cylinder(machine: Machine, where: int) -> int | None:
    """Return the number of the first cylinder that turns joint `where`, None without one."""
    return next((c for c, span in enumerate(machine.spans) if where in span), None)


def _pushed(machine: Machine, values: Array, cylinder: int, push: Array) -> Array:
    """Return the signals (T, S) [SI] with an additional force in what the sensors of a cylinder read.

    The force is added to its force pin, else, over the head area, to its head-side pressure. Without both it is a copy
    without a change.

    cylinder: its number
    push:     (T,) additional force [N]
    """
    signal, found = {(s.kind, s.index): k for k, s in enumerate(machine.signals)}, values.copy()
    if (Kind.FORCE_PIN, cylinder) in signal:
        found[:, signal[Kind.FORCE_PIN, cylinder]] += push
    elif (Kind.HEAD_PRESSURE, cylinder) in signal:
        found[:, signal[Kind.HEAD_PRESSURE, cylinder]] += push / machine.cylinders[cylinder].area_head
    return found


UNKNOWN_TORQUES: tuple[Group, ...] = (
    (UnknownTorque(),),
    tuple(PostureTorque(bend) for bend in range(BENDS)),
    tuple(OthersPressure(other) for other in range(OTHERS)),
)
