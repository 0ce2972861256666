"""An identified file of another machine of the same type is noticed while the empty machine moves; that of the right
machine never is. (All pairs, digging, warm oil, machines of another simulator: tools/studies/recognition.py.)"""

from functools import cache

import numpy as np
import pytest

from cylforce.estimation.model import Model
from cylforce.service.core import Core
from cylforce.service.memory import Memory
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Reason, Status
from cylforce.simulation.scenario import cycles, moves
from scenarios import EXCAVATOR, identified, played, through
from spoilt import samples
from studies.recognition import recognised

LOADED = load(EXCAVATOR)
OWN, OTHER = 1, 4
MACHINE, FILTERS = LOADED.service.machine, LOADED.service.filters


@cache
def tares(seed):
    """Of the simulated machine `seed`, whose masses are within 10 % of the data sheet and whose friction is its own."""
    return identified(LOADED, seed, 100.0)


def course(file, kg=0.0):
    return recognised(Model(MACHINE, FILTERS, tares(file).friction), tares(file), samples(LOADED, OWN, kg, 80.0))


def test_the_file_of_another_machine_is_noticed():
    assert course(OTHER).another.any()


@pytest.mark.parametrize("kg", [0.0, 800.0])
def test_the_right_machine_is_not_doubted(kg):
    found = course(OWN, kg)
    assert not found.another.any()
    assert 0.0 < found.largest < 1.0


def test_what_is_doubted_is_never_published_as_ok():
    """The service on a bus, from the first judgement on."""
    events = played(LOADED, [moves(MACHINE, np.random.default_rng((OWN, 7)), 60.0)], seed=OWN)
    state, estimates, _ = through(Core(LOADED.service, tares(OTHER)), events)
    doubted = [e for e in estimates if e.force.magnitude.reason is Reason.NOT_THIS_MACHINE]
    assert state.recognizer.another
    assert len(doubted) > 500
    for estimate in doubted:
        quantities = (*estimate.load.quantities, estimate.gross, estimate.net, *estimate.force.quantities)
        assert Status.OK not in {q.status for q in quantities}
    state, estimates, _ = through(Core(LOADED.service, tares(OWN)), events)
    assert not any(q.reason is Reason.NOT_THIS_MACHINE for e in estimates for q in (e.gross, e.force.magnitude))


def test_parameters_from_elsewhere_are_never_ok():
    """Not with their own machine either: nobody but an engineer knows which it is."""
    events = played(LOADED, cycles(MACHINE, np.random.default_rng((OWN, 8)), 2, swing=False), seed=OWN)
    core = Core(LOADED.service, tares(OWN))
    state, estimates, _ = through(core, events, WeighingService.start(core, Memory(unconfirmed=True)))
    values = [q for e in estimates for q in (e.gross, e.net, *e.force.quantities)]
    assert Status.OK not in {q.status for q in values}
    assert sum(q.reason is Reason.NOT_CONFIRMED for q in values) > len(values) // 3
    assert state.memory.unconfirmed
    assert state.memory.booking is not None
