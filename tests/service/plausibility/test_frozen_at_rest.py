"""A pressure that is frozen while its own cylinder rests and another one moves."""

import numpy as np
import pytest

from cylforce.estimation.kernel.making import numbers
from cylforce.service.core import Core
from cylforce.service.plausibility.blocks import SAMPLES, Block, no_blocks
from cylforce.service.plausibility.detectors.constant_error import KEPT, UNSURE, VOTES, VoteConstants
from cylforce.service.plausibility.pressure_groups import GROUP, GROUPS, GroupConstants, PressureGroups
from cylforce.service.plausibility.suspicion import Level
from cylforce.settings.machine_file import load
from cylforce.signals.kinds import SIDES
from faulting.edits import BAR
from scenarios import EXCAVATOR, identified

MACHINE = load(EXCAVATOR).service.machine
LEVELS = np.array([120.0, 8.0, 60.0, 25.0, 15.0, 40.0]) * BAR
STICK_HEAD, KNOWN = 2, 40  # pressure; groups before
BOOM_MOVES, ALL_REST, STICK_MOVES = [0.1, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.1, 0.0]


def all_signals(row):
    """All signals, of which the pressures are `row`."""
    pressures = iter(row)
    return numbers(next(pressures) if s.kind in SIDES else 0.0 for s in MACHINE.signals)


def heard(speed, noise, groups=4, state=None, seed=1):
    """The statistics after so many groups in which the stick's head pressure has that share of its noise."""
    after, rng = PressureGroups.start(GroupConstants(MACHINE)), np.random.default_rng(seed)
    if state is not None:
        after.restore(state.snapshot())
    for _ in range(groups * GROUP):
        row = LEVELS + 0.1 * BAR * rng.normal(0.0, 1.0, 6) * np.where(np.arange(6) == STICK_HEAD, noise, 1.0)
        after.update(all_signals(row), numbers(speed))
    return after


@pytest.mark.parametrize(("noise", "within"), [(0.2, 1), (0.5, 4)])
def test_noise_that_is_gone_at_rest_is_missed_while_another_cylinder_moves(noise, within):
    before = heard(BOOM_MOVES, 1.0, KNOWN)
    assert not before.gone.any()
    after = heard(BOOM_MOVES, noise, within, state=before, seed=2)
    assert np.flatnonzero(after.gone).tolist() == [STICK_HEAD]
    assert after.rest.since.tolist() != before.rest.since.tolist()


def test_nothing_is_missed_while_nothing_moves():
    """An engine that stops takes its pump's noise away."""
    before = heard(BOOM_MOVES, 1.0, KNOWN)
    assert not heard(ALL_REST, 0.2, 8, state=before, seed=2).gone.any()


def test_the_noise_of_motion_is_no_measure_of_that_at_rest():
    """A pump is heard through an open valve: what comes to rest is quieter."""
    before = heard(STICK_MOVES, 1.0, KNOWN)
    assert not heard(BOOM_MOVES, 0.2, 8, state=before, seed=2).gone.any()


def test_what_is_gone_at_rest_is_back_when_the_pressure_changes_with_its_cylinder():
    """Four seconds of motion, both ways."""
    state = heard(BOOM_MOVES, 0.2, 2, state=heard(BOOM_MOVES, 1.0, KNOWN), seed=2)
    assert state.gone[STICK_HEAD]
    rng = np.random.default_rng(3)
    for k in range((GROUPS + 2) * GROUP):
        way = 1.0 if (k // (4 * GROUP)) % 2 else -1.0
        row = LEVELS + 10.0 * BAR * way + rng.normal(0.0, 0.1 * BAR, 6)
        state.update(all_signals(row), numbers([0.0, 0.1 * way, 0.0]))
    assert not state.gone.any()


def voting():
    loaded = load(EXCAVATOR)
    core = Core(loaded.service, identified(loaded))
    return VoteConstants(core.monitor)


def test_one_second_that_only_an_error_explains_leaves_nothing_sure():
    """Its whole vote is a quarter of what a rejection takes, a little less than what is rare in order."""
    votes = voting()
    most = votes.limits[Level.REJECTED] / VOTES
    size = votes.blocks.size
    for square, unsure in ((2.0 * most, True), (0.5 * most, False)):
        of_signals = (np.zeros(size), np.ones(size), np.zeros(size))
        of_signals[0][0], of_signals[2][0] = np.sqrt(square), -400.0  # kg per bar: no error that may stay
        one = Block(*(np.array([x]) for x in (square, 0.0, 10.0, 1.0 * SAMPLES)), *of_signals)
        found = votes.likeliest(no_blocks(size).followed_by(one, KEPT))
        assert found.evidence == pytest.approx(min(square, most), abs=0.3)
        assert found.unsure is unsure
        assert found.evidence < UNSURE
