"""A node that is silent in the middle of the work: a booking is of the bucket that was dumped, or there is none."""

import pytest

from cylforce.service.booking import MissedReason
from cylforce.service.core import Core
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.events import Tick
from scenarios import EXCAVATOR, cycles, fed, identified, seconds


@pytest.fixture(scope="module")
def work():
    """The service, two cycles' events with their masses, and the state before each half second: (event, state)."""
    loaded = load(EXCAVATOR)
    core = Core(loaded.service, identified(loaded))
    events, masses = cycles(loaded, count=2)
    state, states, booked = WeighingService.start(core), {}, []
    for k, event in enumerate(events):
        if isinstance(event, Tick) and round(100 * seconds(event)) % 50 == 0:
            states[round(seconds(event), 1)] = k, state.copied()
        fed(state, event)
        if (booking := state.bookings.booking) and booking.number > len(booked):
            booked.append(seconds(event))
    return core, events, masses, states, booked


@pytest.mark.parametrize(
    ("before_first", "before_second"), [(3.5, 1.5), (3.5, 3.0), (2.5, 4.5), (2.5, 6.0), (0.5, 3.0)]
)
def test_no_load_is_booked_in_place_of_another(work, before_first, before_second):
    """Silent from before the first bucket's booking until shortly before the second's."""
    core, events, masses, states, (first, second) = work
    begin = round(2 * (first - before_first)) / 2
    at, state = states[begin][0], states[begin][1].copied()
    silent = {pdo.can_id for pdo in core.service.nodes[0].pdos}
    bookings = []
    for event in events[at:]:
        if isinstance(event, Tick) or event.can_id not in silent or seconds(event) >= second - before_second:
            fed(state, event)
        if (booking := state.bookings.booking) and booking.number > len(bookings):
            bookings.append(booking)
    assert all(abs(b.mass - masses[1]) < 4.0 * b.standard_error for b in bookings)
    assert state.bookings.missed.reason is MissedReason.INTERRUPTED
    assert state.bookings.missed.mass == pytest.approx(masses[0], rel=0.02)


def test_a_short_silence_costs_no_booking(work):
    """One second while the bucket is dumped."""
    core, events, masses, states, (first, _) = work
    at, state = states[round(2 * (first - 2.5)) / 2]
    state = state.copied()
    silent = {pdo.can_id for pdo in core.service.nodes[0].pdos}
    weighed = []
    for event in events[at:]:
        lost = not isinstance(event, Tick) and event.can_id in silent and seconds(event) < first - 1.5
        if not lost:
            fed(state, event)
        if (booking := state.bookings.booking) and booking.number > len(weighed):
            weighed.append(booking.mass)
    assert weighed == pytest.approx(masses, rel=0.02)
