"""Samples and estimates: the values measured at a tick, the values estimated from them, and the reason where a value is
withheld."""

from array import array
from collections.abc import Callable
from enum import IntEnum
from math import isfinite, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.signals.contact import ContactEvent
from cylforce.signals.quick import new

Array = NDArray[np.float64]


class Status(IntEnum):
    """How far a published value can be trusted: OK: fully; DEGRADED: valid with the standard error given, but see the
    reason; HOLD: the last value, because its sensors are late; INVALID: no value."""

    OK = 0
    DEGRADED = 1
    HOLD = 2
    INVALID = 3


class Reason(IntEnum):
    """Why a value is withheld or degraded; published as one byte. The cure for each stands in service/README.md."""

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
    NOT_THIS_MACHINE = 24
    NO_CONTACT = 25
    OTHER_TOOL = 26
    NOT_CURLED = 27
    SENSORS_DISAGREE = 28
    TWO_PRODUCERS = 30
    OWN_IDENTIFIER = 31
    NOT_CONFIRMED = 32


class Sample(NamedTuple):
    """The signals at a tick: SI values (S,) in the order of the machine's signals, `kept` as plain numbers; per signal
    the reason why it is not usable (NONE: usable); `late`: the reason why at least one value is not fresh but repeated
    from before (NONE: all are fresh); numbers of signals that `leapt` and stayed there."""

    t_us: int
    kept: "array[float]"
    reasons: tuple[Reason, ...]
    late: Reason
    leapt: tuple[int, ...] = ()

    @property
    def values(self) -> Array:
        """The values (S,)."""
        return np.frombuffer(self.kept)


class Quantity(NamedTuple):
    """A value in SI units with its standard error; both NaN when `status` is INVALID."""

    value: float
    standard_error: float
    status: Status
    reason: Reason


def invalid(reason: Reason) -> Quantity:
    """A quantity without a value, with the reason."""
    return new(Quantity, (nan, nan, Status.INVALID, reason))


def less(q: Quantity, by: float) -> Quantity:
    """The quantity with its value less `by`."""
    return new(Quantity, (q.value - by, q.standard_error, q.status, q.reason)) if by else q


def degraded(q: Quantity, reason: Reason) -> Quantity:
    """The quantity, DEGRADED for this reason if it was OK."""
    return q._replace(status=Status.DEGRADED, reason=reason) if q.status is Status.OK else q


def within(q: Quantity, limits: tuple[float, float], largest_error: float) -> Quantity:
    """The quantity itself when it is finite, within `limits`, and its standard error is between 0 and `largest_error`;
    else INVALID."""
    if q.status is Status.INVALID:
        return q
    fine = isfinite(q.value) and limits[0] <= q.value <= limits[1] and 0.0 < q.standard_error < largest_error
    return q if fine else invalid(Reason.OUT_OF_DECLARED_RANGE)


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
        """The four published quantities: x, z, magnitude, direction."""
        return self.x, self.z, self.magnitude, self.direction


def invalid_force(reason: Reason) -> Force:
    """A force without a value, with the reason."""
    nothing = invalid(reason)
    return Force(nothing, nothing, nothing, nothing, (nan, nan, nan))


class Booking(NamedTuple):
    """A weight that was accurate enough to be booked: number of the lift, time of booking [us]; gross `mass`, what
    remained in the bucket after it (`carry_back`), what left it (`dumped`), each with its standard error, all [kg].
    While the bucket returns, the same booking becomes more precise. `by_hand`: the operator gave it, nothing was
    weighed."""

    number: int
    t_us: int
    mass: float
    standard_error: float
    carry_back: float
    carry_back_error: float
    dumped: float
    dumped_error: float
    by_hand: bool = False


def is_new(booking: Booking | None, before: Booking | None) -> bool:
    """Whether a booking is another one than before, not the same made more precise."""
    return booking is not None and (before is None or booking.number != before.number)


class Load(NamedTuple):
    """A hanging load: `mass` [kg] and its `centre` (x, z) [m] in the last link's frame, each with its standard
    error."""

    mass: Quantity
    centre_x: Quantity
    centre_z: Quantity


def invalid_load(reason: Reason) -> Load:
    """A load without a value, with the reason."""
    nothing = invalid(reason)
    return new(Load, (nothing, nothing, nothing))


class Estimate(NamedTuple):
    """All estimates of a tick, as published: `load` before zero and tare, `gross` = load less zero [kg], `net` = gross
    less tare [kg], `force`: the resultant of all that acts on the tool, the last booking; `soil`: the force of the soil
    alone; the last events at the teeth, newest last."""

    t_us: int
    load: Load
    gross: Quantity
    net: Quantity
    force: Force
    booking: Booking | None
    soil: Force
    events: tuple[ContactEvent, ...] = ()


def no_estimate(t_us: int, reason: Reason, booking: Booking | None, events: tuple[ContactEvent, ...] = ()) -> Estimate:
    """No value at all, and why; the last booking and the last events stay."""
    nothing, no_force = invalid(reason), invalid_force(reason)
    return Estimate(t_us, invalid_load(reason), nothing, nothing, no_force, booking, no_force, events)


def each_component(force: Force, change: Callable[[Quantity], Quantity]) -> Force:
    """The force with each published component changed by `change`."""
    x, z, magnitude, direction = (change(q) for q in force.quantities)
    return Force(x, z, magnitude, direction, force.covariance)


def held_estimate(last: Estimate, t_us: int, reason: Reason) -> Estimate:
    """The last estimate with the status HOLD and the reason."""

    def repeated(q: Quantity) -> Quantity:
        return q if q.status is Status.INVALID else q._replace(status=Status.HOLD, reason=reason)

    load, gross, net = Load(*(repeated(q) for q in last.load)), repeated(last.gross), repeated(last.net)
    force, soil = each_component(last.force, repeated), each_component(last.soil, repeated)
    return Estimate(t_us, load, gross, net, force, last.booking, soil, last.events)
