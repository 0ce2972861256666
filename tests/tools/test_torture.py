"""The study of faults in the middle of work: what is said with a fault is compared with the same ticks without it."""

import numpy as np
import pytest

from cylforce.files.tables import Table
from cylforce.service.core import Core
from cylforce.settings.machine_file import load
from faulting.order import EVERY_S, in_order
from faulting.runs import followed, wrong
from faulting.works import Case, events
from scenarios import EXCAVATOR, identified, moved

SECONDS = 14.0


@pytest.fixture(scope="module")
def case():
    """The simulated excavator, empty, in motion."""
    loaded = load(EXCAVATOR)
    values, rate = moved(loaded, seconds=SECONDS), loaded.service.filters.rate_hz
    names = tuple(s.name for s in loaded.service.machine.signals)
    return Case(
        "moves", loaded, Core(loaded.service, identified(loaded)), Table(np.arange(len(values)) / rate, values, names)
    )


@pytest.fixture(scope="module")
def order(case):
    """What is said without a fault, with the states on the way."""
    return in_order(case)


def test_pieces_of_work_are_said_as_the_whole_of_it(case, order):
    whole = followed(case.core, events(case, case.table.values, slice(0, None)))
    for piece, same in zip(order.course[:4], whole[:4], strict=True):
        np.testing.assert_array_equal(piece, same)
    assert np.ptp(np.diff(whole.t_s)) < 0.1 / case.rate_hz  # no tick is left out


def test_work_from_a_state_on_is_as_it_was(case, order):
    begin = 1.5 * EVERY_S
    state, k = order.before(begin)
    rest = followed(case.core, events(case, case.table.values, slice(round(k * EVERY_S * case.rate_hz), None)), state)
    again, before = rest.since(begin), order.course.since(begin)
    found = wrong(again, before)
    assert (found.share, found.weight, found.force) == (0.0, 0.0, 0.0)
    np.testing.assert_array_equal(again.values, before.values)


def test_courses_of_different_ticks_are_not_compared(order):
    with pytest.raises(ValueError, match="ticks"):
        wrong(order.course.first(100), order.course.since(0.05).first(100))
