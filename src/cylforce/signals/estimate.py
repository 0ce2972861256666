"""Samples and estimates: the values measured at a tick, the values estimated from them, and the reason where a value is
withheld."""

from array import array
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from math import isfinite, nan

import numpy as np
from numpy.typing import NDArray

from cylforce.signals.contact import NO_EVENT, ContactEvent
from cylforce.signals.value_class import value_class

Array = NDArray[np.float64]


class Status(IntEnum):
    """Trust in a published value.

    OK:       the value and its standard error can be trusted
    DEGRADED: valid with the standard error given, which is large or not confirmed; see the reason
    HOLD:     the last value, because its sensors are late
    INVALID:  no value
    """

    OK = 0
    DEGRADED = 1
    HOLD = 2
    INVALID = 3


class Reason(IntEnum):
    """Reason why a value is withheld or degraded; published as one byte. service/README.md has the cure for each."""

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


@value_class
class Sample:
    """The signals at a tick, in the order of the machine's signals.

    t_us:    time of the tick [us]
    plain:   (S,) SI values, as Python's own array, which the kernel reads; a value counts only if its reason is NONE
    reasons: (S,) why each signal is not usable; NONE: usable
    late:    why at least one value is repeated from before; NONE: all are fresh
    stepped: numbers of the signals that jumped and stayed there
    """

    t_us: int
    plain: "array[float]"
    reasons: tuple[Reason, ...]
    late: Reason
    stepped: tuple[int, ...] = ()

    @property
    def values(self) -> Array:
        """The SI values (S,) as a NumPy array; it shares the memory of `plain`."""
        return np.frombuffer(self.plain)


@value_class
class Quantity:
    """A value with its standard error.

    value:          SI units; NaN when INVALID
    standard_error: in the unit of the value; NaN when INVALID
    status:         trust in the value
    reason:         why the status is not OK; NO_CONTACT also of a force that is OK
    """

    value: float
    standard_error: float
    status: Status
    reason: Reason


def invalid(reason: Reason) -> Quantity:
    """Return a quantity without a value: NaN, INVALID for this reason."""
    return Quantity(nan, nan, Status.INVALID, reason)


def less(quantity: Quantity, by: float) -> Quantity:
    """Return the quantity with its value reduced `by` an exactly known number in its unit, such as a tare [kg].

    Standard error, status and reason stay.
    """
    if not by:
        return quantity
    return Quantity(quantity.value - by, quantity.standard_error, quantity.status, quantity.reason)


def degraded(quantity: Quantity, reason: Reason) -> Quantity:
    """Return the quantity, DEGRADED for this reason if it was OK."""
    if quantity.status is not Status.OK:
        return quantity
    return Quantity(quantity.value, quantity.standard_error, Status.DEGRADED, reason)


def within(quantity: Quantity, limits: tuple[float, float], largest_error: float) -> Quantity:
    """Return the quantity, INVALID (OUT_OF_DECLARED_RANGE) if its value or its standard error is out of range.

    A standard error of 0 is INVALID, too. A quantity that is INVALID already keeps its reason.

    limits:        smallest and largest value, in the unit of the quantity
    largest_error: standard error from which on the quantity is INVALID, in the same unit
    """
    if quantity.status is Status.INVALID:
        return quantity
    value, error = quantity.value, quantity.standard_error
    fine = isfinite(value) and limits[0] <= value <= limits[1] and 0.0 < error < largest_error
    return quantity if fine else invalid(Reason.OUT_OF_DECLARED_RANGE)


@value_class
class Force:
    """Force of the outside world on the tool, in the vertical plane of the arm.

    x, z:       components [N], truly horizontal forward and truly vertical up
    magnitude:  [N]
    direction:  [rad] of the force, from x towards z
    covariance: of the components, (xx, xz, zz) [N^2]
    """

    x: Quantity
    z: Quantity
    magnitude: Quantity
    direction: Quantity
    covariance: tuple[float, float, float]

    @property
    def quantities(self) -> tuple[Quantity, Quantity, Quantity, Quantity]:
        """The four published quantities: x, z, magnitude, direction."""
        return self.x, self.z, self.magnitude, self.direction

    def changed(self, change: Callable[[Quantity], Quantity]) -> "Force":
        """Return the force with `change` applied to x, z, magnitude and direction; the covariance stays."""
        return Force(
            x=change(self.x),
            z=change(self.z),
            magnitude=change(self.magnitude),
            direction=change(self.direction),
            covariance=self.covariance,
        )


def invalid_force(reason: Reason) -> Force:
    """Return a force without values: all quantities INVALID for this reason, the covariance NaN."""
    nothing = invalid(reason)
    return Force(nothing, nothing, nothing, nothing, (nan, nan, nan))


@dataclass(frozen=True, slots=True)
class Booking:
    """A weight that was accurate enough to be booked. While the bucket returns, the same booking becomes more precise.

    number:           count of bookings; the same for the same booking made more precise
    t_us:             time of booking [us]
    mass:             all that was in the bucket during the lift, before the operator's zero and tare [kg]
    standard_error:   of the mass [kg]
    carry_back:       material that stayed in the bucket [kg]
    carry_back_error: its standard error [kg]
    dumped:           material that left the bucket, mass less carry_back [kg]
    dumped_error:     its standard error [kg]
    by_hand:          whether the operator entered it instead of a weighing
    """

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
    """Return whether a booking has another number than the one before, so that it is not that one made more precise."""
    return booking is not None and (before is None or booking.number != before.number)


@value_class
class Load:
    """Load in the bucket.

    mass:               [kg]
    centre_x, centre_z: centre of mass [m] in the frame of the last link, whose origin is its inner pin
    """

    mass: Quantity
    centre_x: Quantity
    centre_z: Quantity

    @property
    def quantities(self) -> tuple[Quantity, Quantity, Quantity]:
        """Mass, x and z of the centre."""
        return self.mass, self.centre_x, self.centre_z

    def changed(self, change: Callable[[Quantity], Quantity]) -> "Load":
        """Return the load with each quantity changed by `change`."""
        return Load(change(self.mass), change(self.centre_x), change(self.centre_z))


def invalid_load(reason: Reason) -> Load:
    """Return a load without values: mass and centre INVALID for this reason."""
    nothing = invalid(reason)
    return Load(nothing, nothing, nothing)


@value_class
class Estimate:
    """Estimates of a tick, as published.

    t_us:    time of the tick [us]
    load:    load in the bucket, from whose mass neither zero nor tare is subtracted
    gross:   mass of the load less the operator's zero [kg]
    net:     gross less the tare [kg]
    force:   resultant of all that acts on the tool
    booking: the last one; None: none yet
    soil:    the force of the soil alone
    events:  the last events at the teeth, newest last
    """

    t_us: int
    load: Load
    gross: Quantity
    net: Quantity
    force: Force
    booking: Booking | None
    soil: Force
    events: tuple[ContactEvent, ...] = ()

    @property
    def last_event(self) -> ContactEvent:
        """The last event at the teeth; NO_EVENT before the first one."""
        return self.events[-1] if self.events else NO_EVENT

    @property
    def event_age_s(self) -> float:
        """Time since the last event [s]; NaN before the first one."""
        return 1e-6 * (self.t_us - self.events[-1].t_us) if self.events else nan


def no_estimate(t_us: int, reason: Reason, booking: Booking | None, events: tuple[ContactEvent, ...] = ()) -> Estimate:
    """Return an estimate without any value, all of them INVALID for a reason; the last booking and events stay.

    t_us:    time of the tick [us]
    reason:  why there is no value
    booking: the last one; None: none yet
    events:  the last events at the teeth
    """
    nothing, no_force = invalid(reason), invalid_force(reason)
    return Estimate(
        t_us,
        load=invalid_load(reason),
        gross=nothing,
        net=nothing,
        force=no_force,
        booking=booking,
        soil=no_force,
        events=events,
    )


def held_estimate(last: Estimate, t_us: int, reason: Reason) -> Estimate:
    """Return the last estimate for a later tick, each of its values with the status HOLD and the reason.

    last:   estimate of an earlier tick; its INVALID values stay INVALID
    t_us:   time of this tick [us]
    reason: why the values are held
    """

    def held(quantity: Quantity) -> Quantity:
        """Return the quantity with the status HOLD and the reason; an INVALID one unchanged."""
        if quantity.status is Status.INVALID:
            return quantity
        return Quantity(quantity.value, quantity.standard_error, Status.HOLD, reason)

    return Estimate(
        t_us=t_us,
        load=last.load.changed(held),
        gross=held(last.gross),
        net=held(last.net),
        force=last.force.changed(held),
        booking=last.booking,
        soil=last.soil.changed(held),
        events=last.events,
    )
