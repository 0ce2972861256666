"""A leap is doubted until seconds in the air say that it was none: made-up blocks of one second."""

from math import exp

import numpy as np
import pytest

from cylforce.programs.common.readings import make_core
from cylforce.service.plausibility.blocks import BAR, Block
from cylforce.service.plausibility.detectors.constant_error import KEPT, VOTES
from cylforce.service.plausibility.detectors.pressure_step import ENOUGH, WRONGLY, PressureStep, StepConstants
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorFault, SensorSuspicion
from cylforce.settings.machine_file import load
from scenarios import EXCAVATOR

MACHINE = load(EXCAVATOR)
HEAD, ROD = 2, 3  # signals: the stick's pressures
STICK = 1
STEP = 10.0  # bar


@pytest.fixture(scope="module")
def machine():
    return make_core(MACHINE, None).monitor


def block(machine, best=0.0, left=0.0):
    """A second that is explained best by an error of the stick's pressures of `best` bar on the head side, and leaves
    `left` for each independent sample then."""
    size = machine.blocks.size
    linear, square = np.zeros(size), np.full(size, 1e-3)
    square[STICK], linear[STICK] = 4.0, 4.0 * best
    numbers = (np.array([x]) for x in (left * 15.0 + 4.0 * best**2, 100.0, 5.0, 15.0))
    return Block(*numbers, linear, square, np.zeros(size))


def doubted(machine, cause, signal=HEAD, size=STEP * BAR):
    leap = PressureStep.start(machine)
    leap.steps, leap.report = 10_000, SensorSuspicion(Level.SUSPECTED, cause, (signal,), size)
    return leap


def after(leap, *blocks):
    """The detector itself, after these seconds."""
    for each in blocks:
        leap.vote(each)
    return leap


def test_what_is_taken_back_wrongly_is_as_seldom_as_it_is_said_to_be():
    """Wald's bound: likelihoods of which one is WRONGLY times the other."""
    assert exp(-ENOUGH / 2.0) == pytest.approx(WRONGLY) == pytest.approx(0.01)


@pytest.mark.parametrize("cause", [SensorFault.STEPPED, SensorFault.SWAPPED])
def test_several_seconds_that_a_load_explains_take_a_leap_back(machine, cause):
    leap = after(doubted(machine, cause), *[block(machine)] * (VOTES - 1))
    assert leap.report.cause is cause
    leap.vote(block(machine))
    assert (leap.report, leap.votes) == (NOTHING_SUSPECTED, 0.0)


def test_a_second_that_no_load_explains_begins_the_count_anew_after_an_exchange(machine):
    good, bad = block(machine), block(machine, left=10.0)
    leap = after(doubted(machine, SensorFault.SWAPPED), *[good] * (VOTES - 1), bad)
    assert leap.votes == 0.0
    after(leap, *[good] * (VOTES - 1))
    assert leap.report.level is Level.SUSPECTED
    leap.vote(good)
    assert leap.report == NOTHING_SUSPECTED


@pytest.mark.parametrize("signal", [HEAD, ROD])
def test_seconds_that_the_step_explains_better_keep_the_doubt(machine, signal):
    """The rod side's area is smaller, and acts the other way."""
    cylinder = MACHINE.service.machine.cylinders[STICK]
    of_head = STEP if signal == HEAD else -STEP * cylinder.area_rod / cylinder.area_head
    wrong = block(machine, best=of_head)
    leap = after(doubted(machine, SensorFault.STEPPED, signal), *[wrong] * 20)
    assert leap.report.level is Level.SUSPECTED
    assert leap.votes == -ENOUGH  # no more is kept against it
    after(leap, *[block(machine)] * (2 * VOTES - 1))
    assert leap.report.level is Level.SUSPECTED
    assert after(leap, *[block(machine)] * 2).report == NOTHING_SUSPECTED  # one, but for rounding


def test_a_second_in_contact_says_nothing_of_a_step(machine):
    assert after(doubted(machine, SensorFault.STEPPED), block(machine, left=10.0)).votes == 0.0


def test_a_second_that_began_before_the_leap_says_nothing(machine):
    settled = machine.constants(StepConstants).settled
    for since, counts in ((10_000 - settled, False), (10_000 - settled - 1, True)):
        leap = doubted(machine, SensorFault.SWAPPED)
        leap.since = since
        assert (after(leap, block(machine)).votes > 0.0) is counts


def test_nothing_is_judged_without_a_doubt(machine):
    leap = PressureStep.start(machine)
    leap.steps = 10_000
    assert after(leap, block(machine)).seconds == 0


def test_a_step_that_is_not_confirmed_ends_by_itself(machine):
    """Of seconds that contradict each other; some must be in the air, and together they must not have confirmed it."""
    against, confirming, contact = block(machine), block(machine, best=STEP), block(machine, left=50.0)
    leap = after(doubted(machine, SensorFault.STEPPED), *[against, confirming] * VOTES)
    after(leap, *[contact] * (KEPT - 2 * VOTES - 1))
    assert leap.report.level is Level.SUSPECTED
    assert after(leap, contact).report == NOTHING_SUSPECTED
    in_the_ground = after(doubted(machine, SensorFault.STEPPED), *[contact] * (2 * KEPT))
    assert in_the_ground.report.level is Level.SUSPECTED
    confirmed = after(doubted(machine, SensorFault.STEPPED), *[confirming] * (2 * KEPT))
    assert confirmed.report.level is Level.SUSPECTED
