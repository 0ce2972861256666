"""A load of which nothing is known is taken off; what it weighs is no noise. Stretches free of contact are found."""

import numpy as np
import pytest

from cylforce.diagnosis.columns.rows import BLOCK
from cylforce.diagnosis.columns.statistics import SMOOTH, Shared, White, laid, shared, statistics
from cylforce.diagnosis.columns.whitening import Floor
from cylforce.diagnosis.inference.discrepancy import Scatter, Sums, moments, sums
from cylforce.diagnosis.inference.hypotheses import Inference
from cylforce.diagnosis.inference.in_order import InOrder
from cylforce.diagnosis.inference.sizes import Column, Terms
from cylforce.diagnosis.inference.working import Loads
from cylforce.diagnosis.recordings.lifts import Whitened, stretches

BLOCKS = 20
USUAL = Scatter(np.array([0.1]), np.array([1.0]))
SEED = 5


@pytest.mark.parametrize("times", [0.0, 10.0, 1000.0])
def test_however_heavy_a_load_is_the_noise_is_that_of_the_sensors(times):
    """In every block another load, up to a thousand times the noise."""
    rng = np.random.default_rng(SEED)
    rows = BLOCKS * BLOCK
    own, load, noise = rng.standard_normal((3, rows))
    hanging = np.repeat(times * rng.standard_normal(BLOCKS), BLOCK)
    left = own + load * hanging + noise
    white = White(np.stack([own, load, left], axis=-1)[:, None, :].astype(np.float32), np.ones((rows, 1), bool))
    spread, unit = np.ones(1), np.ones(1)
    recording = sums(spread, [statistics(white, [0], Shared.nothing(1, 2))])
    hangs = moments([white], [0], spread, [1], max(times, 1.0) * unit)
    scene = Terms(spread, spread, (), 0)
    case = Inference(scene, recording, USUAL, np.zeros(1), np.eye(1), np.zeros(1), moments=hangs)
    found = case.hypothesis((), USUAL)
    assert found.noise.v[0] == pytest.approx(1.0, abs=0.05), f"seed {SEED}"
    assert found.noise.rho[0] < 0.3


SETTLE = 12  # rows
LIFTS = ((100, 260, 900.0), (340, 420, 10.0), (500, 680, 400.0), (760, 840, -8.0))  # first and last row, load


def work(rng, lifts=LIFTS, count=900):
    """Torques of two joints in units of their noise: a load in every lift, between them a hundred times the noise."""
    t = np.arange(count)
    loads = np.stack([1.0 + 0.5 * np.sin(t / 31.0), 0.6 + 0.4 * np.cos(t / 23.0)], axis=1)[..., None]
    left = 100.0 * np.stack([np.sin(t / 7.0), np.cos(t / 9.0)], axis=1)
    for first, last, carried in lifts:
        left[first:last] = loads[first:last, :, 0] * carried
    good = np.ones(left.shape, dtype=np.bool_)
    return Whitened(left + rng.standard_normal(left.shape), loads, good, 0.3 * np.sin(t / 40.0))


def test_lifts_and_returns_are_found_without_the_rows_in_which_filters_settle():
    seen = work(np.random.default_rng(SEED))
    found = stretches(seen, np.array([1000.0]), np.array([15.0]), SETTLE)
    assert [each.loaded for each in found] == [True, False, True, False], f"seed {SEED}"
    for each, (first, last, carried) in zip(found, LIFTS, strict=True):
        assert first + SETTLE - 4 <= each.first <= first + SETTLE + 4
        assert last - SETTLE - 4 <= each.last <= last - SETTLE + 4
        assert each.carried == pytest.approx([carried], abs=1.0)


PARTS = ((100, 260, 900.0), (266, 400, 840.0), (500, 660, 500.0))  # 60 fall out of the first within 0.3 s


EMPTIED = 1.5  # rad, from where the bucket is as the load is lifted


@pytest.mark.parametrize(
    ("until", "tilted", "begins", "on"),
    [
        (266, 0.0, 400, True),
        (266, 0.3, 400, True),
        (266, -1.0, 400, True),
        (266, EMPTIED, 261, False),
        (266, EMPTIED, 200, False),
        (340, 0.0, 400, False),
    ],
    ids=["falls out", "tilted a little", "turned inwards", "dumped in parts", "slides late", "put down"],
)
def test_a_load_is_carried_on_unless_it_is_dumped_or_the_ground_takes_it(until, tilted, begins, on):
    """Emptied at last between the rows 400 and 500; before, the bucket is tilted from some row on."""
    seen = work(np.random.default_rng(SEED), (PARTS[0], (until, *PARTS[1][1:]), PARTS[2]))
    tilt = np.where(np.arange(900) >= (begins if tilted == EMPTIED else 261), tilted, 0.0)
    tilt[400:480] = EMPTIED
    found = stretches(seen._replace(tilt=tilt), np.array([1000.0]), np.array([15.0]), SETTLE)
    assert [each.on for each in found if each.loaded] == [False, on, False], f"seed {SEED}"


def test_a_tool_that_never_turns_is_not_seen_to_be_emptied():
    seen = work(np.random.default_rng(SEED), (PARTS[0], (266, 400, 840.0), PARTS[2]))
    found = stretches(seen._replace(tilt=np.zeros(900)), np.array([1000.0]), np.array([15.0]), SETTLE)
    assert not any(each.on for each in found)


def test_what_happens_while_nothing_is_usable_is_not_known():
    seen = work(np.random.default_rng(SEED), (PARTS[0], (266, 400, 840.0), PARTS[2]))
    good = seen.good.copy()
    good[255:320] = False
    tilt = np.where(np.arange(900) % 500 < 400, 0.0, EMPTIED)
    found = stretches(seen._replace(tilt=tilt, good=good), np.array([1000.0]), np.array([15.0]), SETTLE)
    assert not any(each.on for each in found)


def hanging(rng, *loads):
    """A load in stretches of ten blocks, all carried on from the first, as multiples of the noise; coefficients of what
    is left without it."""
    rows = BLOCKS * BLOCK // 2
    own, load, noise = rng.standard_normal((3, rows * len(loads)))
    left = load * np.repeat(loads, rows) + noise
    white = White(np.stack([own, load, left], axis=-1)[:, None, :].astype(np.float32), np.ones((own.size, 1), bool))
    each = moments([white], [0], np.ones(1), [1], WEIGHT * np.ones(1))
    stretch = np.repeat(np.arange(len(loads)), BLOCKS // 2)
    on, none = np.arange(len(loads)) > 0, np.zeros((len(stretch), 1, 1 + SMOOTH, 1))
    return Loads(each.across, each.within, each.waves, each.smooth, stretch, on, none, np.ones(1)), np.array([0.0, 1.0])


WEIGHT = 100.0  # of the noise: the usual load


@pytest.mark.parametrize(
    ("loads", "differs", "fell"),
    [
        ((100.0, 100.0), [], []),
        ((100.0, 99.0), [1], []),  # crumbs: less than sticks in an empty bucket
        ((100.0, 101.0), [1], []),  # taken up
        ((100.0, 60.0), [1], [1]),
        ((100.0, 80.0, 100.0), [1, 2], []),  # it was held up, and came back
        ((100.0, 80.0, 81.0), [1, 2], [1]),
        ((100.0, 80.0, 60.0), [1, 2], [1, 2]),
    ],
)
def test_a_part_fell_out_if_less_hangs_there_from_then_on(loads, differs, fell):
    hangs, left = hanging(np.random.default_rng(SEED), *loads)
    found = hangs.differing(left, USUAL)
    assert [np.flatnonzero(each).tolist() for each in (found.differs, found.fell)] == [differs, fell], f"seed {SEED}"
    less, errors = WEIGHT * found.less[1:, 0], WEIGHT * found.errors[1:, 0]
    assert np.all(np.abs(less + np.diff(loads)) < 4.0 * errors)
    assert errors == pytest.approx(np.sqrt(2.0 / (BLOCKS * BLOCK / 2)), rel=0.2)
    assert np.ptp(hangs.expected(left, USUAL)[0]) == 0.0  # the same load is one load


@pytest.mark.parametrize("lifts", [(), ((0, 900, 0.0),)])
def test_what_never_or_always_touches_the_ground(lifts):
    found = stretches(work(np.random.default_rng(SEED), lifts), np.array([1000.0]), np.array([15.0]), SETTLE)
    rows = sum(each.last - each.first for each in found)
    assert rows >= 900 - 6 * SETTLE if lifts else rows == 0  # after twenty seconds another one begins
    assert not any(each.loaded for each in found)


def test_a_recording_with_nothing_usable_has_no_stretch():
    seen = work(np.random.default_rng(SEED))
    lost = seen._replace(good=np.zeros_like(seen.good))
    found = stretches(lost, np.array([1000.0]), np.array([15.0]), SETTLE)
    assert sum(each.last - each.first for each in found if each.loaded) == 0


def test_one_load_in_all_blocks_of_a_stretch_is_known_better_than_one_in_each():
    """The information that is lost to it is that of one size, however many blocks it hangs in."""
    rng = np.random.default_rng(SEED)
    own, load, noise = rng.standard_normal((3, BLOCKS * BLOCK))
    white = White(np.stack([own, load, noise], axis=-1)[:, None, :].astype(np.float32), np.ones((own.size, 1), bool))
    each = moments([white], [0], np.ones(1), [1], 100.0 * np.ones(1))
    one, none = np.zeros(BLOCKS, dtype=np.int_), np.zeros((BLOCKS, 1, 1 + SMOOTH, 1))
    begins = np.zeros(1, dtype=np.bool_)
    whole = Loads(each.across, each.within, each.waves, each.smooth, one, begins, none, np.ones(1))
    sizes, covariance = whole.expected(np.array([0.0, 1.0]), USUAL)
    apart = each.expected(np.array([0.0, 1.0]), USUAL)[1]
    assert np.ptp(sizes) == 0.0
    assert covariance[0, 0, 0] == pytest.approx(np.mean(apart) / BLOCKS, rel=0.1)
    assert whole.told(USUAL)[1] < each.told(USUAL)[1]


def test_rows_in_another_order_keep_what_they_hold():
    rng = np.random.default_rng(SEED)
    white = White(
        rng.standard_normal((5, 1, 2)).astype(np.float32), np.array([[True], [True], [False], [True], [True]])
    )
    found = laid(white, np.array([3, 4, -1, 2, 0]))
    assert found.rows[:2].tolist() == white.rows[3:].tolist()
    assert not np.any(found.rows[2])
    assert found.good[:, 0].tolist() == [True, True, False, False, True]


@pytest.mark.parametrize("slow", [False, True])
def test_noise_in_both_is_told_along_the_polynomials(slow):
    """White noise has as much along each polynomial as in each row; what is constant in a block has all of it along
    the first, and a discrepancy takes it away."""
    rng = np.random.default_rng(SEED)
    count = BLOCKS * BLOCK
    noise = np.repeat(rng.standard_normal(BLOCKS), BLOCK) if slow else rng.standard_normal(count)
    added = np.stack([2.0 * noise, noise], axis=-1)[:, None, :]
    floor = Floor(np.ones(1), np.zeros((1, 3)), np.ones(1))
    found = shared(added, floor, [0])
    products = found.products.sum(axis=0)[0, :, 0]
    rows = float(found.rows.sum())
    assert products[0] == pytest.approx(2.0 * rows, rel=0.1 if not slow else 0.5)
    assert products[1] / products[0] == pytest.approx(1.0 if slow else 1.0 / BLOCK, rel=0.15 if slow else 1.0)
    recording = Sums(
        np.zeros((1, 2, 2)), np.zeros((1, 6, 2, 2)), np.full(1, rows), np.full(1, float(BLOCKS)), found.products
    )
    common = recording.common(Scatter(np.full(1, 100.0), np.ones(1)))[0]
    assert common[0] / products[0] == pytest.approx(0.0 if slow else 1.0, abs=0.15)


@pytest.mark.parametrize("size", [-2.4, 2.4])
def test_an_error_that_the_references_show_with_an_impossible_sign_is_no_evidence(size):
    """The field lacks what the references show. If that cannot be, it was something else, no error that has gone."""
    rng = np.random.default_rng(SEED)
    rows, spread = BLOCKS * BLOCK, np.ones(1)
    column, noise, more = rng.standard_normal((3, rows))

    def recording(left):
        white = White(np.stack([column, left], axis=-1)[:, None, :].astype(np.float32), np.ones((rows, 1), bool))
        return sums(spread, [statistics(white, [0], Shared.nothing(1, 2))])

    def evidence(sign):
        form = Column("compliance", "bucket", (0,), 0.5, 50.0, sign, 1, reads=True)
        machine = InOrder(Terms(10.0 * spread, spread, (form,), 0), (recording(size * column + noise),), {}, 1)
        case = machine.asked(recording(more))
        return case.likeliest((0,), case.usual).log - case.likeliest((), case.usual).log

    opposite = -np.sign(size)
    assert evidence(0) > 50.0, f"seed {SEED}"
    assert evidence(opposite) < 0.0
