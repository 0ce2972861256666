"""Readings of angle sensors with the whole turns that the machine's joints allow."""

from collections.abc import MutableSequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind
from cylforce.signals.quick import once
from cylforce.signals.turns import is_circle, nearest


class JointSensors(NamedTuple):
    """Sensors from which one joint's angle is read.

    middle: middle of the joint's range [rad]
    encoder: number of the signal of its encoder; None: none
    inclined: number of the signal of its link's inclinometer; None: none
    length: number of the signal of its cylinder's length; None: none, or not needed
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

    A joint moves by less than a turn, so one number of turns k puts its angle theta + 2 pi k within half a turn of the
    middle of its range. For an inclinometer theta is the reading less the inclination of the link before. The chassis
    stands upright: its middle is 0. Each sample is taken by itself, so that the result does not depend on the samples
    before: it is right after a start and after a gap. The slew angle has no range; `Channels` follows it.
    """

    machine: Machine

    @once
    def _place(self) -> dict[tuple[Kind, int], int]:
        return {(s.kind, s.index): k for k, s in enumerate(self.machine.signals)}

    @once
    def _pitch(self) -> int | None:
        return self._place.get((Kind.PITCH, 0))

    @once
    def _house(self) -> tuple[int, ...]:
        """Return the numbers of the signals of the chassis' tilt."""
        return tuple(k for kind in (Kind.PITCH, Kind.ROLL) if (k := self._place.get((kind, 0))) is not None)

    @once
    def _joints(self) -> tuple[JointSensors, ...]:
        last = max((s.index for s in self.machine.signals if s.kind is Kind.LINK_INCLINATION), default=-1)
        return tuple(self._sensors(j, needed=j < last) for j in range(self.machine.size))

    def _sensors(self, j: int, *, needed: bool) -> JointSensors:
        """Return the sensors of joint j; `needed`: a later joint is measured by an inclinometer."""
        link, at = self.machine.links[j], self._place.get
        encoder, inclined = at((Kind.JOINT_ANGLE, j)), at((Kind.LINK_INCLINATION, j))
        found = JointSensors((link.angle_low + link.angle_high) / 2.0, encoder, inclined, None, *np.zeros((2, 0)))
        for c, span in enumerate(self.machine.spans):
            length, table = at((Kind.CYLINDER_LENGTH, c)), self.machine.tables[c]
            if needed and encoder is None and inclined is None and span == (j,) and length is not None and table:
                return found._replace(length=length, lengths=table[0], angles=table[1])
        return found

    def of(self, values: Array) -> Array:
        """Return samples (..., S) [SI] with whole turns added to their angles."""
        found = values.copy()
        columns = list(np.moveaxis(found, -1, 0))
        self.apply(columns)
        return np.stack(columns, axis=-1) if columns else found

    def apply(self, columns: MutableSequence[Any]) -> None:
        """Add whole turns to the angles among the signals: S numbers of one sample, or S arrays (...,)."""
        for k in self._house:
            columns[k] = nearest(columns[k], 0.0)
        inner = 0.0 if self._pitch is None else columns[self._pitch]  # inclination of the link before
        for middle, encoder, inclined, length, lengths, angles in self._joints:
            theta = middle
            if encoder is not None:
                theta = columns[encoder] = nearest(columns[encoder], middle)
            if inclined is not None:
                columns[inclined] = nearest(columns[inclined], inner + middle)
                theta = columns[inclined] - inner if encoder is None else theta
            if length is not None:
                theta = np.interp(columns[length], lengths, angles)
            inner = inner + theta


def inclinations(machine: Machine, link: int) -> tuple[float, float]:
    """Return the least and greatest inclination [rad] of a link on level ground that the ranges of the joints allow."""
    inner = machine.links[: link + 1]
    return sum(each.angle_low for each in inner), sum(each.angle_high for each in inner)


class EndPassed(NamedTuple):
    """An angle sensor of a whole circle that passes its end within the joint's range.

    signal: number of the signal
    low, high: what the joints allow [rad], for an inclinometer on level ground
    """

    signal: int
    low: float
    high: float


def ends_passed(machine: Machine) -> list[EndPassed]:
    """Return the angle sensors whose readings begin anew at the other end of the circle while the machine works."""
    found = []
    for k, signal in enumerate(machine.signals):
        if signal.kind is Kind.JOINT_ANGLE:
            link = machine.links[signal.index]
            low, high = link.angle_low, link.angle_high
        elif signal.kind is Kind.LINK_INCLINATION:
            low, high = inclinations(machine, signal.index)
        else:
            continue
        if is_circle(signal.low, signal.high) and (low < signal.low or high > signal.high):
            found.append(EndPassed(k, low, high))
    return found
