"""The published force is late by a known delay: its standard errors contain how much it has changed since."""

from array import array
from math import atan2, cos, hypot, pi, sin

import numpy as np
import pytest

from cylforce.service.contact.events import ContactConstants, ContactDetector, clearness
from cylforce.service.contact.lateness import Lateness, force_delay_s, no_forces
from cylforce.service.contact.noise import SolvedForce
from cylforce.service.core import Core
from cylforce.service.force import ForceSensor
from cylforce.signals.contact import EventKind
from cylforce.signals.estimate import Reason, Status
from held_arm import PATIENT, estimates, readings, tares

BEGINS = 2.0  # s: the force begins to change
STEP = 0.01  # s
DELAY = force_delay_s(PATIENT.filters, 0.02)
ON_THE_BUS = 1.5 * STEP  # s from the measurement of a sample to the bus: until it is used, and the wait of the message


@pytest.fixture(scope="module")
def core():
    return Core(PATIENT, tares())


def pushed(core, force, seconds):
    """Estimates of an arm held still with a force (x, z) at time t after BEGINS; first time that is on the bus."""
    return estimates(core, lambda t: readings(force=force(t - BEGINS)), seconds)


def rows(found, first, last):
    """(time after BEGINS [s], estimate) of the time between."""
    times = np.arange(len(found)) * STEP - BEGINS
    return [(t, e) for t, e in zip(times, found, strict=True) if first <= t <= last]


@pytest.mark.parametrize(("what", "most"), [("force", 1.1), ("soil", 1.5)])
def test_a_rising_force_is_as_uncertain_as_it_rises_within_its_delay(core, what, most):
    """50 kN/s forwards and 70 kN/s upwards: 1.5 and 2.1 kN, beside the 100 N of the same arm under a constant force. Of
    the soil's force it is unknown besides how much the bucket fills."""
    found = pushed(core, lambda t: (50e3 * max(t, 0.0), 70e3 * max(t, 0.0)), BEGINS + 0.5)
    for t, estimate in rows(found, 0.15, 0.5):
        force = getattr(estimate, what)
        for quantity, rate in ((force.x, 50e3), (force.z, 70e3), (force.magnitude, hypot(50e3, 70e3))):
            assert 0.9 * rate * DELAY < quantity.standard_error < most * rate * DELAY
            assert abs(quantity.value - rate * (t + ON_THE_BUS)) < 1.96 * quantity.standard_error


def test_a_force_that_turns_has_a_direction_as_uncertain_as_it_turns_within_its_delay(core):
    """20 kN that turn by 2 rad/s: 3.5 degrees."""

    def turning(t):
        size, angle = 20e3 * min(max(t / 0.3, 0.0), 1.0), 2.0 * max(t - 0.3, 0.0)
        return size * cos(angle), size * sin(angle)

    for t, estimate in rows(pushed(core, turning, BEGINS + 1.0), 0.5, 1.0):
        direction, (x, z) = estimate.force.direction, turning(t + ON_THE_BUS)
        assert direction.standard_error == pytest.approx(2.0 * DELAY, rel=0.15)
        off = (direction.value - atan2(z, x) + pi) % (2.0 * pi) - pi
        assert abs(off) < 1.96 * direction.standard_error


def test_a_force_that_no_longer_changes_has_the_error_that_it_has_at_rest(core):
    found = pushed(core, lambda t: (20e3 * min(max(t / 0.1, 0.0), 1.0), 0.0), BEGINS + 1.0)
    changing, at_rest = (rows(found, at, 1.0)[0][1].force.x.standard_error for at in (0.1, 0.9))
    assert changing > 5e3
    assert at_rest < 1e3


def test_a_force_that_is_late_by_much_is_uncertain_but_not_taken_for_a_pose_that_does_not_show_it():
    """40 % of the rated force within the delay: more than the error at which a component has no value, but the force
    before it was known to 1 %."""
    rated, tares_ = 100e3, tares()
    late, own = 0.4 * rated, 0.01 * rated
    error = hypot(late, own)
    shown = (50e3, 0.0, 50e3, 0.0, error, own, error, 0.1, error**2, 0.0, own**2, 0.0, error, 50e3)
    sensor = ForceSensor(tares_, rated)
    found, of_a_pose = sensor.force(shown, True, (late, 0.0)), sensor.force(shown, True)
    for force in (found.x, found.magnitude):
        assert (force.status, force.reason) == (Status.DEGRADED, Reason.UNCERTAIN)
        assert force.standard_error == error
    assert (of_a_pose.x.status, of_a_pose.x.reason) == (Status.INVALID, Reason.SINGULAR)


def test_contact_is_noticed_although_the_force_rises(core):
    """50 kN/s: without its delay, the force is clear once it exceeds BEGINS. With that of its filter alone, 10 ms, it
    is clear after some 8 of these; with all waits it would be after 8 times 30 ms."""
    found = pushed(core, lambda t: (50e3 * max(t, 0.0), 0.0), BEGINS + 0.5)
    noticed = next(t for t, e in rows(found, -1.0, 0.5) if e.events)
    first = next(e for e in found if e.events)
    assert first.events[-1].kind is EventKind.CONTACT_BEGINS
    assert noticed < 8.0 * DELAY / 2.0
    assert first.force.x.value < 8.0 * first.force.x.standard_error


def test_a_force_that_still_changes_quickly_is_less_clear():
    """6 kN with 0.5 kN of standard error are 12 of them; with 1 kN of change along it within its delay, 5.4. A change
    across it does not matter."""
    seen = SolvedForce(6e3, -2e3, 0.5e3**2, 0.0, 0.5e3**2, 2e3, 144.0, array("d"))
    assert clearness(seen, (0.0, 0.0)) == pytest.approx(144.0)
    assert clearness(seen, (1e3, 0.0)) == pytest.approx(36.0 / 1.25)
    assert clearness(seen, (0.0, 1e3)) == pytest.approx(144.0)


def test_a_force_that_still_changes_quickly_is_no_contact_yet():
    seen = SolvedForce(6e3, -2e3, 0.5e3**2, 0.0, 0.5e3**2, 2e3, 144.0, array("d"))
    for late, in_contact in (((0.0, 0.0), True), ((1e3, 0.0), False)):
        contact = ContactDetector.start(ContactConstants(100e3, STEP))
        contact.update(0, seen, late, 0j, 0j)
        assert contact.in_contact is in_contact


def test_before_the_first_force_none_is_late():
    """Half a step more than two steps of delay: the change over two steps, by a quarter more."""
    late, recent, found = Lateness(0.025, STEP), no_forces(), []
    for x, z in ((5.0, 1.0), (5.0, 1.0), (9.0, 1.0), (9.0, -3.0), (9.0, -3.0)):
        found += late.error(recent, x, z)
        recent.keep(x, z, late.steps)
    assert found == pytest.approx([0.0, 0.0, 0.0, 0.0, 5.0, 0.0, 5.0, -5.0, 0.0, -5.0])
