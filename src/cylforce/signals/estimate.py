"""Samples and estimates: what was measured at a tick, what is concluded from it, and why not when it is not."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Status(IntEnum):
    """How far a published value can be trusted."""

    OK = 0
    DEGRADED = 1
    HOLD = 2
    INVALID = 3


class Reason(IntEnum):
    """Why a value is not (fully) trustworthy; published as one byte."""

    NONE = 0
    STARTING = 1
    SIGNAL_MISSING = 2
    SIGNAL_STALE = 3
    OUT_OF_RANGE = 4
    NOT_A_NUMBER = 5
    FROZEN = 6
    IMPLAUSIBLE_JUMP = 7
    SHORT_FRAME = 8
    LONG_FRAME = 9
    TIME_JUMP = 10
    OVERRUN = 11
    DEAD_POINT = 12
    END_STOP = 13
    SINGULAR = 14
    AT_REST = 15
    IN_CONTACT = 16
    NOT_A_LOAD = 17
    UNCERTAIN = 18
    OUT_OF_DECLARED_RANGE = 19
    TILT = 20
    SLEWING = 21
    NOT_OPERATIONAL = 22
    NOT_IDENTIFIED = 23


class Sample(NamedTuple):
    """What is known at a tick: SI values `(S,)` in the order of the machine's signals, the reason for which each
    cannot be believed, and the reason for which the last values are held (NONE: all are fresh)."""

    t_us: int
    values: Array
    reasons: tuple[Reason, ...]
    held: Reason


class Quantity(NamedTuple):
    """A value in SI units with its standard error; both NaN when `status` is INVALID."""

    value: float
    standard_error: float
    status: Status
    reason: Reason


def invalid(reason: Reason) -> Quantity:
    """No value, and why."""
    return Quantity(float("nan"), float("nan"), Status.INVALID, reason)


class Force(NamedTuple):
    """Force of the outside world on the tool, in the vertical plane of the arm (x forward, z up): its components [N],
    magnitude [N], direction [rad] from x towards z, and the components' `covariance` (xx, xz, zz) [N^2]."""

    x: Quantity
    z: Quantity
    magnitude: Quantity
    direction: Quantity
    covariance: tuple[float, float, float]

    @property
    def quantities(self) -> tuple[Quantity, Quantity, Quantity, Quantity]:
        """What is published."""
        return self.x, self.z, self.magnitude, self.direction


def invalid_force(reason: Reason) -> Force:
    """No force, and why."""
    nan = float("nan")
    return Force(invalid(reason), invalid(reason), invalid(reason), invalid(reason), (nan, nan, nan))


class Booking(NamedTuple):
    """A weight that was good enough to be booked: number of the lift, time, kg, its standard error."""

    number: int
    t_us: int
    mass: float
    standard_error: float


class Load(NamedTuple):
    """A hanging load: `mass` [kg] and its `centre` (x, z) [m] in the last link's frame, each with its standard
    error."""

    mass: Quantity
    centre_x: Quantity
    centre_z: Quantity


def invalid_load(reason: Reason) -> Load:
    """No load, and why."""
    return Load(invalid(reason), invalid(reason), invalid(reason))


class Estimate(NamedTuple):
    """What is concluded at a tick; published as it is: `load` as measured, `gross` zeroed, `net` zeroed and tared
    [kg]."""

    t_us: int
    load: Load
    gross: Quantity
    net: Quantity
    force: Force
    booking: Booking | None
