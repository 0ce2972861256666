"""The soil's force apart from the load's, contact and its events, against a truth from outside the estimator: an arm
whose pressures follow from hand statics."""

from math import hypot, radians

import numpy as np
import pytest

from cylforce.service.core import Core
from cylforce.service.publication import published
from cylforce.signals.contact import KEPT, EventKind
from cylforce.signals.estimate import Reason, Status
from held_arm import PATIENT, THETA, estimates, readings, tares
from statics import G

LOAD = 800.0
LIFTED, PUSHED = 4.0, 6.0  # s: a motion ends, a force begins


@pytest.fixture(scope="module")
def core():
    return Core(PATIENT, tares())


def posture(t):
    """Joint angles of an arm that moves slowly, ever more slowly, until LIFTED, then stands. Its pressures come from
    statics alone: a sudden stop, whose torque of inertia they lack, would be a blow that no machine shows."""
    part = min(t / LIFTED, 1.0)
    phase = LIFTED * part * (2.0 - part)
    return THETA + np.radians([2.0, 3.0, 4.0]) * np.sin(np.array([0.7, 0.9, 1.1]) * phase)


def swinging(t, **given):
    """Readings of that arm."""
    return readings(theta=posture(t), **given)


def course(core, seconds, *, mass=0.0, force=(0.0, 0.0)):
    """An arm held still, with a load; from PUSHED on with a force."""
    held = (mass, 0.7, 0.1)
    return estimates(core, lambda t: readings(held=held, force=force if t >= PUSHED else (0.0, 0.0)), seconds)


def test_in_the_air_the_force_is_none_and_says_so(core):
    """Zero within three standard errors, OK with NO_CONTACT; the direction alone is not there."""
    for estimate in course(core, 4.0)[200:]:
        for force in (estimate.force, estimate.soil):
            assert abs(force.x.value) < 3.0 * force.x.standard_error
            assert abs(force.z.value) < 3.0 * force.z.standard_error
            assert {(q.status, q.reason) for q in force.quantities[:3]} == {(Status.OK, Reason.NO_CONTACT)}
            assert (force.direction.status, force.direction.reason) == (Status.INVALID, Reason.NO_CONTACT)
        assert published(estimate)["force_quality"] == 4 * Reason.NO_CONTACT


def test_a_hanging_load_is_in_the_resultant_and_not_in_the_soil(core):
    last = course(core, 6.0, mass=LOAD)[-1]
    assert last.force.z.value == pytest.approx(-LOAD * G, rel=0.02)
    assert hypot(last.soil.x.value, last.soil.z.value) < 200.0
    assert last.soil.x.reason is Reason.NO_CONTACT
    assert last.force.x.reason is Reason.NONE
    assert last.soil.z.standard_error > last.force.z.standard_error


@pytest.mark.parametrize("force", [(20e3, 0.0), (-20e3, 0.0), (12e3, 16e3), (0.0, 20e3)], ids=str)
def test_soil_and_load_add_up_to_the_resultant(core, force):
    """Half a second after the force began: x is the soil's alone, z the soil's less the load's weight."""
    last = course(core, PUSHED + 0.5, mass=LOAD, force=force)[-1]
    assert [last.soil.x.value, last.soil.z.value] == pytest.approx(force, abs=300.0)
    assert [last.force.x.value, last.force.z.value] == pytest.approx([force[0], force[1] - LOAD * G], abs=300.0)
    assert {q.reason for q in last.soil.quantities[:3]} == {Reason.NONE}


def test_contact_is_an_event_and_ends_with_one(core):
    """A force of 15 kN from second 6 to 7: noticed within 60 ms, at the place of the teeth, once."""
    found = estimates(core, lambda t: swinging(t, force=(15e3, 5e3) if PUSHED <= t < 7.0 else (0.0, 0.0)), 8.0)
    events = found[-1].events
    assert [e.kind for e in events] == [EventKind.CONTACT_BEGINS, EventKind.CONTACT_ENDS]
    times = [(e.t_us - 1_000_000) * 1e-6 for e in events]
    assert PUSHED <= times[0] < PUSHED + 0.06
    assert 7.0 <= times[1] < 7.3
    assert all(0.9 < e.confidence <= 1.0 for e in events)
    assert [e.number for e in events] == [1, 2]
    row = published(found[-1])
    assert (row["event_count"], row["event_kind"]) == (2.0, float(EventKind.CONTACT_ENDS))
    assert row["event_age"] == pytest.approx((found[-1].t_us - events[-1].t_us) * 1e-6)


def test_the_place_of_an_event_is_that_of_the_teeth(core):
    from statics import TOOL, place

    found = estimates(core, lambda t: swinging(t, force=(15e3, 5e3) if t >= PUSHED else (0.0, 0.0)), 6.5)
    event = found[-1].events[0]
    assert [event.x, event.z] == pytest.approx(place(posture(LIFTED), 3, TOOL, radians(5.0)), abs=0.02)


def test_the_list_of_events_is_bounded(core):
    found = estimates(core, lambda t: swinging(t, force=(20e3, 9e3) if t > 4.0 and t % 0.6 < 0.3 else (0.0, 0.0)), 28.0)
    assert found[-1].events[-1].number > KEPT
    assert len(found[-1].events) == KEPT
