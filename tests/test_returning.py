"""A leap is doubted until seconds in the air say that it was none: made-up blocks of one second."""

from math import exp

import numpy as np
import pytest

from cylforce.estimation.model import Model
from cylforce.programs.common.readings import make_core
from cylforce.service.plausibility.blocks import BAR, Block, Gatherer
from cylforce.service.plausibility.leaping import Leaps
from cylforce.service.plausibility.offsets import KEPT, VOTES
from cylforce.service.plausibility.returning import ENOUGH, WRONGLY, Returning
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorDoubt, SensorFault
from cylforce.settings.machine_file import load
from scenarios import EXCAVATOR

MACHINE = load(EXCAVATOR)
HEAD, ROD = 2, 3  # signals: the stick's pressures
STICK = 1
STEP = 10.0  # bar


@pytest.fixture(scope="module")
def returning():
    core = make_core(MACHINE, None)
    return Returning(Gatherer(Model(MACHINE.service.machine, MACHINE.service.filters, core.tares.friction), core.tares))


def block(returning, best=0.0, left=0.0):
    """A second that is explained best by an error of the stick's pressures of `best` bar on the head side, and leaves
    `left` for each independent sample then."""
    size = returning.gatherer.size
    linear, square = np.zeros(size), np.full(size, 1e-3)
    square[STICK], linear[STICK] = 4.0, 4.0 * best
    numbers = (np.array([x]) for x in (left * 15.0 + 4.0 * best**2, 100.0, 5.0, 15.0))
    return Block(*numbers, linear, square, np.zeros(size))


def doubted(cause, signal=HEAD, size=STEP * BAR):
    return Leaps(steps=10_000, doubt=SensorDoubt(Level.DOUBTED, cause, (signal,), size))


def after(returning, state, *blocks):
    for each in blocks:
        state = returning.judged(state, each)
    return state


def test_what_is_taken_back_wrongly_is_as_seldom_as_it_is_said_to_be():
    """Wald's bound: likelihoods of which one is WRONGLY times the other."""
    assert exp(-ENOUGH / 2.0) == pytest.approx(WRONGLY) == pytest.approx(0.01)


@pytest.mark.parametrize("cause", [SensorFault.STEPPED, SensorFault.SWAPPED])
def test_several_seconds_that_a_load_explains_take_a_leap_back(returning, cause):
    few = after(returning, doubted(cause), *[block(returning)] * (VOTES - 1))
    assert few.doubt.cause is cause
    enough = returning.judged(few, block(returning))
    assert (enough.doubt, enough.votes) == (NOTHING_SUSPECTED, 0.0)


def test_a_second_that_no_load_explains_begins_the_count_anew_after_an_exchange(returning):
    good, bad = block(returning), block(returning, left=10.0)
    state = after(returning, doubted(SensorFault.SWAPPED), *[good] * (VOTES - 1), bad)
    assert state.votes == 0.0
    state = after(returning, state, *[good] * (VOTES - 1))
    assert state.doubt.level is Level.DOUBTED
    assert returning.judged(state, good).doubt == NOTHING_SUSPECTED


@pytest.mark.parametrize("signal", [HEAD, ROD])
def test_seconds_that_the_step_explains_better_keep_the_doubt(returning, signal):
    """The rod side's area is smaller, and acts the other way."""
    cylinder = MACHINE.service.machine.cylinders[STICK]
    of_head = STEP if signal == HEAD else -STEP * cylinder.area_rod / cylinder.area_head
    wrong = block(returning, best=of_head)
    state = after(returning, doubted(SensorFault.STEPPED, signal), *[wrong] * 20)
    assert state.doubt.level is Level.DOUBTED
    assert state.votes == -ENOUGH  # no more is kept against it
    back = after(returning, state, *[block(returning)] * (2 * VOTES - 1))
    assert back.doubt.level is Level.DOUBTED
    assert after(returning, back, *[block(returning)] * 2).doubt == NOTHING_SUSPECTED  # one, but for rounding


def test_a_second_in_contact_says_nothing_of_a_step(returning):
    state = doubted(SensorFault.STEPPED)
    assert returning.judged(state, block(returning, left=10.0)).votes == 0.0


def test_a_second_that_began_before_the_leap_says_nothing(returning):
    for since, counts in ((10_000 - returning._settled, False), (10_000 - returning._settled - 1, True)):
        state = doubted(SensorFault.SWAPPED)._replace(since=since)
        assert (returning.judged(state, block(returning)).votes > 0.0) is counts


def test_nothing_is_judged_without_a_doubt(returning):
    state = Leaps(steps=10_000)
    assert returning.judged(state, block(returning)) is state


def test_a_step_that_is_not_confirmed_ends_by_itself(returning):
    """Of seconds that contradict each other; some must be in the air, and together they must not have confirmed it."""
    against, confirming, contact = block(returning), block(returning, best=STEP), block(returning, left=50.0)
    early = after(returning, doubted(SensorFault.STEPPED), *[against, confirming] * VOTES)
    almost = after(returning, early, *[contact] * (KEPT - 2 * VOTES - 1))
    assert almost.doubt.level is Level.DOUBTED
    assert returning.judged(almost, contact).doubt == NOTHING_SUSPECTED
    in_the_ground = after(returning, doubted(SensorFault.STEPPED), *[contact] * (2 * KEPT))
    assert in_the_ground.doubt.level is Level.DOUBTED
    confirmed = after(returning, doubted(SensorFault.STEPPED), *[confirming] * (2 * KEPT))
    assert confirmed.doubt.level is Level.DOUBTED
