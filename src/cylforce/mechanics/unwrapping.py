"""Add to readings of angle sensors the whole turns that the ranges of the joints require."""

from collections.abc import MutableSequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind
from cylforce.signals.turns import is_circle, nearest


class JointSensors(NamedTuple):
    """Sensors from which one joint's angle is read.

    middle: middle of the joint's range [rad]
    encoder: number of the signal of its encoder; None: none
    inclined: number of the signal of its link's inclinometer; None: none
    length: number of the signal of its cylinder's length; None: none, or not needed, because the joint has another
        sensor or no link farther out has an inclinometer
    lengths: that cylinder's lengths in ascending order (P,) [m]
    angles: joint angle at each of these lengths (P,) [rad]
    """

    middle: float
    encoder: int | None
    inclined: int | None
    length: int | None
    lengths: Array
    angles: Array


@dataclass(frozen=True)
class Unwrapping:
    """Add whole turns to the readings of a machine's angle sensors.

    A joint moves by less than a turn. Therefore one number of turns k puts its angle theta + 2 pi k within half a turn
    of the middle of its range. For an inclinometer, theta is the reading less the inclination of the link before. The
    chassis stands upright: its middle is 0. Each sample is unwrapped by itself, so that the result is right after a
    start and after a gap. The slew angle has no range; `Channels` unwraps it from sample to sample.

    machine: the machine whose joints limit the angles
    """

    machine: Machine

    @cached_property
    def _number(self) -> dict[tuple[Kind, int], int]:
        """Return the number of each signal, by kind and index."""
        return {(s.kind, s.index): k for k, s in enumerate(self.machine.signals)}

    @cached_property
    def _pitch(self) -> int | None:
        """Return the number of the signal of the chassis' pitch; None: not measured."""
        return self._number.get((Kind.PITCH, 0))

    @cached_property
    def _house(self) -> tuple[int, ...]:
        """Return the numbers of the signals of the chassis' tilt."""
        return tuple(k for kind in (Kind.PITCH, Kind.ROLL) if (k := self._number.get((kind, 0))) is not None)

    @cached_property
    def _joints(self) -> tuple[JointSensors, ...]:
        """Return the angle sensors of every joint."""
        last = max((s.index for s in self.machine.signals if s.kind is Kind.LINK_INCLINATION), default=-1)
        return tuple(self._sensors(j, needed=j < last) for j in range(self.machine.size))

    def _sensors(self, j: int, *, needed: bool) -> JointSensors:
        """Return the sensors of joint j: its encoder and its link's inclinometer.

        A joint without both may have its angle from a cylinder's measured length, with a table of the angle by that
        length. The cylinder acts on this joint only. That length is returned only if `needed`.

        needed: whether a link farther out has an inclinometer, for which the angle of this joint must be known
        """
        link = self.machine.links[j]
        encoder, inclined = (self._number.get((kind, j)) for kind in (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION))
        sensors = JointSensors(
            middle=(link.angle_low + link.angle_high) / 2.0,
            encoder=encoder,
            inclined=inclined,
            length=None,
            lengths=np.zeros(0),
            angles=np.zeros(0),
        )
        for c, span in enumerate(self.machine.spans):
            length, table = self._number.get((Kind.CYLINDER_LENGTH, c)), self.machine.tables[c]
            if needed and encoder is None and inclined is None and span == (j,) and length is not None and table:
                return sensors._replace(length=length, lengths=table[0], angles=table[1])
        return sensors

    def of(self, values: Array) -> Array:
        """Return a copy of the values (..., S) [SI] of all signals with whole turns added to joint and tilt angles."""
        unwrapped = values.copy()
        columns = list(np.moveaxis(unwrapped, -1, 0))
        self.apply(columns)
        return np.stack(columns, axis=-1) if columns else unwrapped

    def apply(self, columns: MutableSequence[Any]) -> None:
        """Add whole turns to pitch, roll, joint angles and inclinations among the signals, in place.

        columns: values of the S signals [SI]: S numbers of one sample, or S arrays (...,)
        """
        for k in self._house:
            columns[k] = nearest(columns[k], 0.0)
        inner = 0.0 if self._pitch is None else columns[self._pitch]  # inclination of the link before
        for joint in self._joints:
            theta, inclined = joint.middle, joint.inclined  # angle of the joint, if no sensor measures it: the middle
            if joint.encoder is not None:
                theta = columns[joint.encoder] = nearest(columns[joint.encoder], joint.middle)
            if inclined is not None:
                columns[inclined] = nearest(columns[inclined], inner + joint.middle)
                theta = columns[inclined] - inner if joint.encoder is None else theta
            if joint.length is not None:
                theta = np.interp(columns[joint.length], joint.lengths, joint.angles)
            inner = inner + theta


def inclinations(machine: Machine, link: int) -> tuple[float, float]:
    """Return the least and greatest inclination [rad] of a link on level ground that the ranges of the joints allow."""
    chain = machine.links[: link + 1]
    return sum(member.angle_low for member in chain), sum(member.angle_high for member in chain)


class EndPassed(NamedTuple):
    """An angle sensor of a whole circle whose range of readings ends within the joint's range.

    signal: number of the signal
    low: least angle that the joints allow [rad]; for an inclinometer on level ground
    high: greatest angle that the joints allow [rad]; for an inclinometer on level ground
    """

    signal: int
    low: float
    high: float


def ends_passed(machine: Machine) -> list[EndPassed]:
    """Return the angle sensors whose readings continue at the other end of the circle while the machine works."""
    passed = []
    for k, signal in enumerate(machine.signals):
        if signal.kind is Kind.JOINT_ANGLE:
            link = machine.links[signal.index]
            low, high = link.angle_low, link.angle_high
        elif signal.kind is Kind.LINK_INCLINATION:
            low, high = inclinations(machine, signal.index)
        else:
            continue
        if is_circle(signal.low, signal.high) and (low < signal.low or high > signal.high):
            passed.append(EndPassed(k, low, high))
    return passed
