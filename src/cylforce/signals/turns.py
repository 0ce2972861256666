"""Angles as sensors send them.

A sensor of a whole circle continues at the other end of its range. Its reading therefore represents every angle that
differs from it by whole turns."""

from collections.abc import Sequence
from math import floor, pi
from typing import overload

import numpy as np

from cylforce.signals.estimate import Array

TURN = 2.0 * pi  # rad
# rad: data sheets round the last value before a whole turn (359.99, 359.9) down to whole degrees at most (convention);
# a potentiometer, which does not wrap, has a dead angle of 2 degrees or more
CIRCLE = 359.0 * pi / 180.0
ROUNDING = 1e-9  # turns by which rounding may move a value; a digit of 32 bits is 2e-10 of a turn


def is_circle(low: float, high: float) -> bool:
    """Return whether a sensor that reads from `low` to `high` [rad] reads every direction: CIRCLE or more."""
    return high - low >= CIRCLE


@overload
def nearest(angle: float, middle: float) -> float: ...
@overload
def nearest(angle: Array, middle: Array | float) -> Array: ...
def nearest(angle: Array | float, middle: Array | float) -> Array | float:
    """Return angle + 2 pi k [rad], k whole, from `middle` - pi up to, but without, `middle` + pi [rad].

    Two floats give a float, otherwise both are broadcast to an array. An angle stays as it is where either is NaN.
    """
    if isinstance(angle, float) and isinstance(middle, float):  # np.floor of a number takes ten times as long
        difference = angle - middle
        return angle - TURN * floor(difference / TURN + 0.5) if difference >= pi or difference < -pi else angle
    turns = np.floor((angle - middle) / TURN + 0.5)
    return np.asarray(angle - TURN * np.where(np.isnan(turns), 0.0, turns))


def in_range(angle: Array | float, low: Array | float, high: Array | float) -> Array:
    """Return angle + 2 pi k [rad], k whole, from `low` to `high` [rad]; the angle as it is where no k leads there.

    An angle in range is not changed. Where several such k exist, the one that leads nearest to `low` is taken. A result
    may lie below `low` by ROUNDING turns. The three arguments are broadcast to one array.
    """
    other = angle - TURN * np.floor((angle - low) / TURN + ROUNDING)
    outside = (angle < low) | (angle > high)
    return np.where(outside & (other <= high), other, angle)


def continuous(angles: Array, before: Array) -> Array:
    """Return angles (T, K) [rad] with whole turns added so that no angle of a column jumps by more than half a turn.

    The jump is that from the last known angle of the column, across NaN, which stays NaN.

    before: (K,) last angle of each column before the first row; NaN: none
    """
    found = angles.copy()
    for column, first in zip(found.T, before, strict=True):
        known = np.isfinite(column)
        start = [first] if np.isfinite(first) else []
        column[known] = np.unwrap(np.concatenate([start, column[known]]))[len(start) :]
    return found


class Follower:
    """Makes columns of angles continuous over the pieces of a recording.

    columns: numbers of the columns, K
    before:  (K,) last known angle of each [rad], NaN: none yet
    """

    def __init__(self, columns: Sequence[int]) -> None:
        """Begin before the first piece of a recording; `columns`: numbers of the columns that are angles."""
        self.columns = list(columns)
        self.before = np.full(len(self.columns), np.nan)

    def follow(self, values: Array) -> Array:
        """Return the next piece (T, S) of the recording with whole turns added to the angles [rad].

        No angle then differs from the last known one of its column by more than half a turn. NaN stays NaN. The last
        known angles are kept in `before` for the next piece.

        values: (T, S) samples, of which the columns that are angles may lack whole turns
        """
        if not self.columns:
            return values
        found = values.copy()
        found[:, self.columns] = angles = continuous(values[:, self.columns], self.before)
        for k, column in enumerate(angles.T):
            known = column[np.isfinite(column)]
            self.before[k] = known[-1] if known.size else self.before[k]
        return found
