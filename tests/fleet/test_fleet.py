"""What a fleet's recordings tell, from statistics made by hand: spreads, changes, courses."""

import numpy as np
import pytest

from cylforce.fleet.causes import ChangeCause
from cylforce.fleet.changes import Shape, changes
from cylforce.fleet.courses import course
from cylforce.fleet.gaussians import GroupedGaussians, with_added_variance
from cylforce.fleet.history import History
from cylforce.fleet.usual import Levels, Usual, learn_usual, prior_usual
from cylforce.readings.constants import CREDIBLE

SIZE = 3
DAYS, WITHIN, BETWEEN = np.array([1.0, 0.6, 2.0]), np.array([0.5, 0.5, 0.5]), np.array([10.0, 5.0, 20.0])
MEAN = np.array([100.0, -50.0, 0.0])
CULPRITS = [
    *(ChangeCause(name, "", "1", np.eye(SIZE)[:, [k]], np.array([[3.0], [10.0]]), 1.0) for k, name in enumerate("abc")),
    ChangeCause("unknown", "", "", np.eye(SIZE), np.array([5.0, 25.0])[:, None] * DAYS, 0.0),
]


def fleet_of(machines, days, rng, parts=2):
    """Minutes of recordings of machines in order, each known to 0.4 in correlated directions."""
    information, pull, group, machine = [], [], [], []
    for i in range(machines):
        own = MEAN + BETWEEN * rng.standard_normal(SIZE)
        for _ in range(days):
            today = own + DAYS * rng.standard_normal(SIZE)
            for _ in range(parts):
                now = today + WITHIN * rng.standard_normal(SIZE)
                root = rng.standard_normal((SIZE + 4, SIZE)) / 0.4
                told = root.T @ root
                information.append(told)
                pull.append(told @ now + root.T @ rng.standard_normal(SIZE + 4))
                group.append(len(machine))
            machine.append(i)
    return Levels(GroupedGaussians(np.array(information), np.array(pull), np.array(group)), np.array(machine))


def history_of(rng, course_of_size, n=10):
    """A machine's recordings, in quantity 1 changed by `course_of_size` (n,)."""
    own = MEAN + BETWEEN * rng.standard_normal(SIZE)
    values = own + DAYS * rng.standard_normal((n, SIZE))
    values[:, 1] += course_of_size
    root = rng.standard_normal((n, SIZE + 4, SIZE)) / 0.4
    information = np.einsum("nik,nil->nkl", root, root)
    noise = np.einsum("nik,ni->nk", root, rng.standard_normal((n, SIZE + 4)))
    pull = np.einsum("nkl,nl->nk", information, values) + noise
    return History(7.0 * np.arange(n), *with_added_variance(information, pull, DAYS**2), MEAN, BETWEEN)


def test_the_spreads_of_a_simulated_fleet_are_found():
    found, _ = learn_usual(fleet_of(40, 8, np.random.default_rng(1)), prior_usual(MEAN, 3.0 * BETWEEN, 2.0 * DAYS))
    assert found.machines == 40
    assert found.recordings == 320
    assert found.days == pytest.approx(DAYS, rel=0.2)
    assert found.within == pytest.approx(WITHIN, rel=0.3)
    assert found.between == pytest.approx(BETWEEN, rel=0.35)
    assert np.all(np.abs(found.mean - MEAN) < 3.0 * BETWEEN / np.sqrt(40.0))


def test_what_no_recording_tells_stays_as_stated():
    levels = fleet_of(12, 4, np.random.default_rng(2))
    blind = levels.parts.information.copy()
    blind[:, 2, :] = blind[:, :, 2] = 0.0
    pull = levels.parts.pull.copy()
    pull[:, 2] = 0.0
    before = prior_usual(MEAN, 3.0 * BETWEEN, DAYS)
    found, _ = learn_usual(levels._replace(parts=levels.parts._replace(information=blind, pull=pull)), before)
    assert found.days[2] == pytest.approx(before.days[2], rel=0.05)
    assert found.between[2] == pytest.approx(before.between[2], rel=0.3)


def test_three_machines_do_not_narrow_the_spread_between_machines():
    before = prior_usual(MEAN, 3.0 * BETWEEN, DAYS)
    found, _ = learn_usual(fleet_of(3, 4, np.random.default_rng(3)), before)
    assert np.array_equal(found.between, before.between)


@pytest.mark.parametrize("first", [1, 4, 7])
def test_a_step_is_found_with_its_day_its_cause_and_its_size(first):
    size = np.where(np.arange(10) >= first, 4.0, 0.0)
    (found,) = changes(history_of(np.random.default_rng(first), size), CULPRITS)
    assert (found.shape, found.name, found.first) == (Shape.STEP, "b", first)
    assert found.size == pytest.approx(4.0, abs=3.0 * found.error)
    assert found.probability > 0.99
    assert found.when > 0.9


def test_a_slope_is_found():
    size = 10.0 * np.clip((np.arange(10) - 3) / 6.0, 0.0, 1.0)
    found = changes(history_of(np.random.default_rng(5), size), CULPRITS)[0]
    assert (found.shape, found.name) == (Shape.SLOPE, "b")
    assert abs(found.first - 4) <= 1
    assert found.size == pytest.approx(10.0, abs=4.0 * found.error)


def test_a_change_grows_only_if_that_is_as_sure_as_the_change():
    """Three usual differences of a day look like a slope as often as not: they are told as a step, near its day."""
    found = [
        each
        for seed in range(40)
        for each in changes(history_of(np.random.default_rng(seed), np.where(np.arange(10) >= 6, 3.0, 0.0)), CULPRITS)
        if each.shape is not Shape.DAY
    ]
    assert all((each.shape is Shape.SLOPE) == (each.growing >= CREDIBLE) for each in found)
    assert sum(each.growing > 0.5 and each.shape is Shape.STEP for each in found) > 0
    assert sum(abs(each.first - 6) <= 1 for each in found) >= 0.9 * len(found)


def test_a_single_day_is_no_lasting_change():
    size = np.where(np.arange(10) == 4, 6.0, 0.0)
    (found,) = changes(history_of(np.random.default_rng(6), size), CULPRITS)
    assert (found.shape, found.first) == (Shape.DAY, 4)


def test_machines_in_order_are_hardly_ever_reported():
    rng = np.random.default_rng(7)
    found = [changes(history_of(rng, np.zeros(10)), CULPRITS) for _ in range(200)]
    assert sum(any(each.shape is not Shape.DAY for each in one) for one in found) <= 4


def test_two_changes_of_one_machine_are_both_found():
    rng = np.random.default_rng(8)
    size = np.where(np.arange(12) >= 3, 5.0, 0.0)
    history = history_of(rng, size, 12)
    later = np.where(np.arange(12) >= 8, 15.0, 0.0)
    moved = history.pull + np.einsum("nk,n->nk", history.information[:, :, 0], later)
    found = changes(History(history.t, history.information, moved, MEAN, BETWEEN), CULPRITS)
    assert {(each.name, each.first) for each in found} == {("b", 3), ("a", 8)}


def test_two_recordings_are_enough_and_one_tells_no_change():
    rng = np.random.default_rng(9)
    assert changes(history_of(rng, np.zeros(1), 1), CULPRITS) == []
    found = changes(history_of(rng, np.array([0.0, 30.0]), 2), CULPRITS)
    assert found
    assert found[0].first in (0, 1)


def test_the_distance_of_recordings_in_order_is_about_one():
    rng, usual = np.random.default_rng(10), Usual(MEAN, BETWEEN, DAYS, WITHIN)
    past, kind = [], []
    for _ in range(30):
        own = MEAN + BETWEEN * rng.standard_normal(SIZE)
        values = own + DAYS * rng.standard_normal((6, SIZE))
        information = np.broadcast_to(25.0 * np.eye(SIZE), (6, SIZE, SIZE))
        pull = 25.0 * (values + 0.2 * rng.standard_normal((6, SIZE)))
        days = GroupedGaussians(information, pull, np.zeros(6, dtype=np.intp))
        found = course(days, usual, np.zeros(6, dtype=np.intp), np.eye(SIZE))
        assert np.isnan(found.from_past[0])
        assert np.all(found.error <= found.own_error + 1e-12)
        past.extend(found.from_past[1:])
        kind.extend(found.from_type)
    assert np.sqrt(np.mean(np.square(past))) == pytest.approx(1.0, abs=0.15)
    assert np.sqrt(np.mean(np.square(kind))) == pytest.approx(1.0, abs=0.2)


def test_loosened_knowledge_is_that_of_a_sum():
    rng = np.random.default_rng(11)
    root = rng.standard_normal((4, 6, SIZE))
    information = np.einsum("nik,nil->nkl", root, root)
    mean = rng.standard_normal((4, SIZE))
    pull = np.einsum("nkl,nl->nk", information, mean)
    wide, wide_pull = with_added_variance(information, pull, DAYS**2)
    assert np.linalg.inv(wide) == pytest.approx(np.linalg.inv(information) + np.diag(DAYS**2))
    assert np.linalg.solve(wide, wide_pull[..., None])[..., 0] == pytest.approx(mean)
