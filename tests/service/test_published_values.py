"""The table of published values: what is declared once is sent, described and read."""

from math import nan

from cylforce.service.publication import PUBLISHED, Encoders, publication, published
from cylforce.service.published_values import FORCES, QUALITY, SOIL, TABLE
from cylforce.signals.codec import decode
from cylforce.signals.contact import ContactEvent, EventKind
from cylforce.signals.estimate import Booking, Estimate, Force, Load, Quantity, Reason, Status
from cylforce.signals.layout import CODES

PDOS = publication(64, 0.05, 1500.0, 300e3)


def quantity(value, error=0.0, status=Status.OK, reason=Reason.NONE):
    return Quantity(value, error, status, reason)


def estimate():
    """An estimate in which every published number differs from every other one of its unit."""
    weight, bad = quantity(100.0, 3.0), quantity(nan, nan, Status.INVALID, Reason.NO_CONTACT)
    force = Force(quantity(1000.0, 20.0), quantity(-2000.0, 30.0), quantity(2230.0), bad, (1.0, 0.0, 1.0))
    soil = Force(quantity(3000.0, 40.0), quantity(4000.0, 50.0), quantity(5000.0), quantity(0.5), (1.0, 0.0, 1.0))
    booking = Booking(65535 + 7, 0, 90.0, 1.0, 2.0, 1.0, 88.0, 1.0)
    event = ContactEvent(65535 + 3, 1_000_000, EventKind.STIFF_OBJECT, 4.5, -1.25, 0.75)
    return Estimate(3_500_000, Load(weight, weight, weight), weight, quantity(60.0), force, booking, soil, (event,))


def test_no_name_and_no_object_is_declared_twice():
    values = [value for values in TABLE for value in values]
    assert len(PUBLISHED) == len({(value.index, value.sub) for value in values}) == len(values)


def test_every_pdo_fits_in_a_frame():
    assert [sum(CODES[value.code] for value in values) for values in TABLE] == [8] * len(TABLE)


def test_every_force_has_a_quality_of_its_own():
    assert set(QUALITY) == {*FORCES, *SOIL}
    assert set(QUALITY.values()) < set(PUBLISHED)


def test_what_is_encoded_is_what_is_published():
    """Each value by itself, from the estimate to the bytes and back."""
    given, encoders, received = estimate(), Encoders(PDOS), {}
    for pdo in PDOS:
        received |= decode(pdo, encoders.data(given, pdo.number))
    wanted = published(given)
    assert list(received) == list(wanted) == list(PUBLISHED)
    for name, value in wanted.items():
        step = PUBLISHED[name].resolution.size
        same = received[name] != received[name] if value != value else abs(received[name] - value) <= 0.5001 * step
        assert same, (name, received[name], value)


def test_counts_begin_anew_and_errors_are_never_zero():
    found = published(estimate())
    assert (found["booked_count"], found["event_count"], found["event_age"]) == (7.0, 3.0, 2.5)
    assert published(estimate())["force_quality"] == 0.0  # without contact the direction does not count
    smallest = {name: PUBLISHED[name].resolution.size for name in found if name.endswith("_standard_error")}
    exact = Force(*[quantity(1.0)] * 4, (1.0, 0.0, 1.0))
    nothing = quantity(0.0)
    sent = published(Estimate(0, Load(nothing, nothing, nothing), nothing, nothing, exact, None, exact))
    assert {name: sent[name] for name in smallest} == smallest
