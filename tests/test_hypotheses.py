"""The probability model: its likelihood is the textbook's, its search finds what was put in, and no more."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from cylforce.diagnosis.answer.belief import decided
from cylforce.diagnosis.columns.statistics import SMOOTH, Statistics
from cylforce.diagnosis.inference.beam import _with_each, screened, searched
from cylforce.diagnosis.inference.discrepancy import DECAY, LEVELS, Moments, Scatter, Sums, likeliest, sums
from cylforce.diagnosis.inference.hypotheses import Inference
from cylforce.diagnosis.inference.in_order import InOrder
from cylforce.diagnosis.inference.moments import digging, settled, sizes_of
from cylforce.diagnosis.inference.posterior import (
    NOTHING,
    UNKNOWN,
    Asked,
    Happened,
    believed,
)
from cylforce.diagnosis.inference.sizes import BEYOND, Column, Terms, log_size
from cylforce.diagnosis.numbers import HOLDS, IN_ORDER, UNSEEN, UNSURE
from layers.everyday import learnt

ROWS, BLOCKS, JOINTS, COUNT = 60, 40, 2, 4  # rows of a block, blocks, joints, columns
PARTS = (Column("one", "a", (2,), 0.2, 8.0, 0, 1), Column("two", "b", (3,), 0.2, 8.0, 0, 1))
SCENE = Terms(np.array([1.0, 1.0, 0.2, 0.2]), np.array([1.0, 1.0, 4.0, 4.0]), PARTS, 2)


def basis():
    return np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, ROWS), SMOOTH - 1))[0]


def recording(seed, sizes=(0.0, 0.0), rho=1.0, v=1.0):
    """Rows (BLOCKS, JOINTS, ROWS, COUNT+1) of a machine whose first two parameters are 0.5 and -0.3."""
    rng, q = np.random.default_rng(seed), basis()
    columns = rng.standard_normal((BLOCKS, JOINTS, ROWS, COUNT)) * 0.3
    smooth = rng.standard_normal((BLOCKS, JOINTS, SMOOTH)) * np.sqrt(DECAY) * rho
    left = columns @ np.array([0.5, -0.3, *sizes]) + smooth @ q.T
    left += v * rng.standard_normal(left.shape)
    return np.concatenate([columns, left[..., None]], axis=-1)


LEVERS = np.array([1.0, -0.5])  # of a force at the teeth, at either joint
WAVE = np.stack([lever * np.linspace(1.0, 2.0, ROWS) for lever in LEVERS])  # its column in any block (JOINTS, ROWS)
USUAL = 5.0


def told(rows):
    """Statistics of rows."""
    return Statistics(
        whole=np.einsum("brti,brtj->rij", rows, rows),
        smooth=np.einsum("tk,brti->brki", basis(), rows),
        rows=np.full((BLOCKS, JOINTS), float(ROWS)),
        crossed=np.zeros((0, JOINTS, 1 + SMOOTH, COUNT + 1)),
    )


def forces(rows):
    """At single moments there may be one force."""
    waves, unit = np.broadcast_to(WAVE[None, :, :, None], (BLOCKS, JOINTS, ROWS, 1)), np.append(SCENE.spread, 1.0)
    return Moments(
        across=np.einsum("brti,brtj->brij", waves, rows) * USUAL * unit,
        within=np.einsum("brti,brtj->brij", waves, waves) * USUAL**2,
        waves=np.einsum("tk,brti->brki", basis(), waves) * USUAL,
        smooth=np.einsum("tk,brti->brki", basis(), rows) * unit,
    )


@pytest.fixture(scope="module")
def machine():
    return InOrder(SCENE, (sums(SCENE.spread, [told(recording(1))]), sums(SCENE.spread, [told(recording(2))])), {})


def answer(machine, rows):
    case = machine.asked(sums(SCENE.spread, [told(rows)]))
    gap = case.rest(np.append(-case.mean, 1.0))
    return believed(Asked(PARTS, tuple(searched(case, range(len(PARTS)))), (), case.usual, gap))


def test_the_likelihood_is_that_of_the_whole_covariance():
    """Against scipy's density of all rows at once, parameters integrated out."""
    rows, noise = recording(3)[:2], Scatter(np.array([0.7, 2.0]), np.array([1.1, 0.8]))
    two = told(np.concatenate([rows, np.zeros((BLOCKS - 2, *rows.shape[1:]))]))
    two = two._replace(rows=np.where(np.arange(BLOCKS)[:, None] < 2, float(ROWS), 0.0) * np.ones(JOINTS))
    plain = SCENE._replace(spread=np.ones(COUNT))
    prior = np.diag([1.0, 2.0, 0.5, 0.1])
    case = Inference(plain, sums(plain.spread, [two]), noise, np.array([0.2, 0.0, 0.0, 0.1]), prior, np.zeros(COUNT))
    q = basis()
    design = np.concatenate([rows[b, r, :, :-1] for b in range(2) for r in range(JOINTS)])
    left = np.concatenate([rows[b, r, :, -1] for b in range(2) for r in range(JOINTS)])
    parts = [
        noise.v[r] ** 2 * np.eye(ROWS) + noise.rho[r] ** 2 * (q * DECAY) @ q.T for _ in range(2) for r in range(JOINTS)
    ]
    covariance = design @ prior @ design.T
    for k, part in enumerate(parts):
        covariance[k * ROWS : (k + 1) * ROWS, k * ROWS : (k + 1) * ROWS] += part
    log = multivariate_normal(design @ case.mean, covariance).logpdf(left)
    constant = 0.5 * len(left) * np.log(2.0 * np.pi)
    assert case.state(noise).log == pytest.approx(log + constant, rel=1e-9)


def test_level_and_scale_are_found():
    found = sums(SCENE.spread, [told(recording(4, rho=6.0, v=1.3))])
    exact = np.array([-0.5, 0.3, 0.0, 0.0, 1.0])
    noise, _ = likeliest(found, *found.plain(exact[None]), None)
    assert noise.rho[0] == pytest.approx([6.0, 6.0], rel=0.25)
    assert noise.v[0] == pytest.approx([1.3, 1.3], rel=0.05)


@pytest.mark.parametrize(("size", "error", "sign"), [(1.0, 0.05, 0), (0.3, 0.3, 0), (0.0, 3.0, 0), (2.0, 1.0, 1)])
def test_the_prior_of_a_size_is_averaged_over_its_uncertainty(size, error, sign):
    column = Column("one", "a", (2,), 0.2, 8.0, sign, 1)
    whole = np.log(BEYOND * 8.0 / 0.2) * (1.0 if sign else 2.0)

    def both(x):
        return (norm.pdf(x, size, error) + (0.0 if sign else norm.pdf(-x, size, error))) / (x * whole)

    expected = quad(both, 0.2, BEYOND * 8.0, limit=200, points=[max(size, 0.21)])[0]
    assert np.exp(log_size(column, np.array([size]), np.array([[error**2]]))) == pytest.approx(expected, rel=0.15)


def test_what_was_put_in_is_found_and_nothing_else(machine):
    assert answer(machine, recording(5)).first == NOTHING
    assert answer(machine, recording(6, sizes=(1.5, 0.0))).first == ("one", "a")
    assert answer(machine, recording(7, sizes=(0.0, -1.5))).first == ("two", "b")
    assert answer(machine, recording(8, rho=60.0)).first == UNKNOWN


def test_a_force_at_moments_is_found_in_its_blocks(machine):
    rows = recording(9)
    rows[:8, ..., -1] += np.random.default_rng(9).normal(0.0, 6.0, (8, 1, 1)) * WAVE
    case = machine.asked(sums(SCENE.spread, [told(rows)]))
    found, usual = settled(case, forces(rows), np.append(-case.mean, 1.0))
    where = usual > 0.0
    assert np.mean(where[:8]) > 0.7
    assert not np.any(where[8:])
    assert found.log + forces(rows).prior(where) > case.hypothesis((), case.usual).log + 20.0


def test_how_large_something_is_that_happens_is_not_known_beforehand(machine):
    """A touch of a twentieth of what is usual is found in its blocks, as one of four times as much is, beside it."""
    rows, size = recording(9, rho=0.1, v=0.1), np.repeat([0.3, 3.0, 20.0], 4)
    rows[: len(size), ..., -1] += (np.random.default_rng(9).choice([-1.0, 1.0], len(size)) * size)[:, None, None] * WAVE
    case, own = machine.asked(sums(SCENE.spread, [told(rows)])), forces(rows)
    found, usual = settled(case, own, np.append(-case.mean, 1.0))
    assert np.array_equal(usual > 0.0, np.arange(BLOCKS) < len(size))
    assert np.all(np.abs(np.log(usual[: len(size)] * USUAL / size)) < np.log(4.0))
    sizes, errors = sizes_of(replace(case, moments=own.only(usual)), found, (usual * USUAL)[:, None])
    np.testing.assert_allclose(np.abs(sizes[: len(size), 0]), size, atol=0.15)
    assert np.all(errors[: len(size)] < 0.1)
    fixed, same = settled(case, own, np.append(-case.mean, 1.0), None, (1.0,))
    assert set(same.tolist()) == {0.0, 1.0}
    assert fixed.log <= found.log


@pytest.mark.parametrize("spread", [0.0, 0.5])
def test_what_was_taken_out_at_its_size_is_as_probable_as_before(machine, spread):
    """A linear effect: nothing changes where its size is taken out of the recording, also noise in both, whether it is
    known well or not: what it is doubted stays."""
    rows = recording(6, sizes=(1.5, 0.0))
    noise = white_noise(np.full((JOINTS, COUNT + 1), 3.0))
    noise = np.concatenate([noise * (1.0 + spread), noise * (1.0 - spread)]) / 2.0
    before = told(rows)._replace(crossed=noise)
    case = machine.asked(sums(SCENE.spread, [before]))
    plain = case.hypothesis((0,), case.usual)
    rows[..., -1] -= 1.5 * rows[..., 2]
    crossed = np.sum(before.crossed[..., 2], axis=0)
    lost = 2.0 * 1.5 * crossed / BLOCKS  # of y - X s; the square of what is in X is small
    lost[:, 0] /= ROWS
    again = sums(SCENE.spread, [told(rows)._replace(crossed=before.crossed)]).with_noise(lost)
    again = replace(case, sums=again, taken={0: np.array([1.5 / SCENE.spread[2]])})
    assert (plain.doubt > 0.2) == (spread > 0.0)
    assert again.hypothesis((0,), case.usual, plain.doubt).log == pytest.approx(plain.log, abs=0.2)


def test_everyday_differences_are_learnt(machine):
    rng = np.random.default_rng(0)
    sizes = rng.normal(0.0, 0.1, 12)
    seen = [(machine, sums(SCENE.spread, [told(recording(10 + k, (0.0, size)))])) for k, size in enumerate(sizes)]
    found = learnt(seen)
    assert found["two"] == pytest.approx(np.sqrt(np.mean(sizes**2)) / 0.2, rel=0.4)  # of the least plausible size, 0.2
    assert found["one"] < 0.5 * found["two"]


def white_noise(crossed, rows=BLOCKS * ROWS, blocks=BLOCKS):
    """One sample (1, R, 1+SMOOTH, K+1) of white noise that has products (R, K+1)."""
    along = np.repeat(crossed[:, None] * blocks / rows, SMOOTH, axis=1)
    return np.concatenate([crossed[:, None], along], axis=1)[None]


def test_sensor_noise_in_both_is_taken_off():
    """Errors in variables: without it, least squares tend to the solution that cancels the noise."""
    rows, blocks = 100.0, 2.0
    zeros = np.zeros((1, 2, 2)), np.zeros((1, SMOOTH, 2, 2))

    def common(crossed, rho=1e-9):
        found = Sums(*zeros, np.full(1, rows), np.full(1, blocks), crossed)
        return found.common(Scatter(np.full(1, rho), np.full(1, 2.0)))

    assert common(white_noise(np.array([[30.0, 0.0]]), rows, blocks))[0] == pytest.approx([30.0 / 2.0**2])
    loud = white_noise(np.array([[30.0, 100.0 * 5.0**2]]), rows, blocks)  # more noise than there is
    assert common(loud)[0] == pytest.approx([30.0 / 5.0**2])
    smooth = white_noise(np.array([[30.0, 0.0]]), rows, blocks)
    smooth[0, 0, 1:, 0] = 0.0
    smooth[0, 0, 1, 0] = 30.0  # all of it a constant of each block, which the discrepancy takes
    assert common(smooth, rho=1e6)[0] == pytest.approx([0.0], abs=1e-6)
    both = np.concatenate([white_noise(np.array([[each, 0.0]]), rows, blocks) for each in (10.0, 20.0)])
    found, samples = common(both)
    assert found == pytest.approx([30.0 / 2.0**2])
    assert samples.T @ samples == pytest.approx(2.0 * 5.0**2 / 2.0**4)


def unsure_of(rows):
    """The recording, and the same with noise in column and residual that is not known well."""
    products = np.zeros((2, JOINTS, 1 + SMOOTH, COUNT + 1))
    products[0, :, 0, 2], products[1, :, 0, 2] = 5.0, -5.0
    return [sums(SCENE.spread, [told(rows)._replace(crossed=each)]) for each in (0.0 * products, products)]


def test_a_size_whose_noise_is_not_known_well_has_less_evidence(machine):
    """Of a score s = I size + noise of variance I + V the gain is s^2 / 2 (I + V), not s^2 / 2 I; its size is as much
    less sure."""
    sure, unsure = (machine.asked(each) for each in unsure_of(recording(6, sizes=(1.5, 0.0))))
    state = unsure.state(unsure.usual)
    own = list(SCENE.forms[0].columns)
    told_of, vague = float(state.information(own)[0, 0]), float(np.sum(state.vague[:, own] ** 2))
    assert vague > 0.1 * told_of
    known, doubted = (case.under((0,), case.state(case.usual))[1] for case in (sure, unsure))
    gain = known.gain - 0.5 * np.log(2.0 * np.pi / told_of)
    less = doubted.gain - doubted.doubt - 0.5 * np.log(2.0 * np.pi * doubted.covariance[0, 0])
    assert less == pytest.approx(gain * told_of / (told_of + vague), rel=1e-2)
    assert doubted.covariance[0, 0] == pytest.approx((told_of + vague) / told_of**2, rel=1e-2)


def test_noise_that_is_not_known_well_hides_a_large_effect_less_than_a_small_one(machine):
    """The larger an effect, the larger the noise that no effect would need, and the less of its evidence is lost."""

    def kept(size):
        cases = [machine.asked(each) for each in unsure_of(recording(6, sizes=(size, 0.0)))]
        sure, unsure = (c.hypothesis((0,), c.usual).log - c.hypothesis((), c.usual).log for c in cases)
        return unsure / sure

    assert 0.0 < kept(1.5) < kept(4.0) < kept(8.0) < 1.0


def test_a_second_effect_is_doubted_as_much_as_if_it_were_alone(machine):
    """Beside a large effect the noise of a recording without any would hide all doubt."""
    alone, both = (machine.asked(unsure_of(recording(6, sizes=sizes))[1]) for sizes in ((1.5, 0.0), (1.5, 8.0)))
    first = both.hypothesis((1,), both.usual)
    more, lone = both.with_more(first, 0).doubt - first.doubt, alone.hypothesis((0,), alone.usual).doubt
    assert lone > 5.0
    assert more == pytest.approx(lone, rel=0.3)
    assert both.hypothesis((0, 1), both.usual).doubt - first.doubt < 0.5 * lone
    (pair,) = (h for h in searched(both, (0, 1)) if h.which == (0, 1))
    assert pair.doubt - first.doubt == pytest.approx(more, rel=0.1)  # by the likelier of both, not by the lenient one


def test_a_neighbour_of_a_true_effect_pays_none_of_its_doubt_back(machine):
    """Two columns that are nearly the same: with the second one the first is doubted no less."""
    rows = recording(6, sizes=(8.0, 0.0))
    rows[..., 3] = 0.9 * rows[..., 2] + 0.43 * rows[..., 3]
    case = machine.asked(unsure_of(rows)[1])
    one = case.hypothesis((0,), case.usual)
    assert one.doubt > 5.0
    assert case.with_more(one, 1).doubt >= one.doubt
    assert case.with_more(one, 1).log < one.log + 5.0


def test_forms_are_screened_all_at_once_as_one_by_one(machine):
    case = machine.asked(unsure_of(recording(6, sizes=(1.5, 0.8)))[1])
    none = case.hypothesis((), case.usual)
    state, each = case.state(none.noise), {}
    for p in (0, 1):
        left = case.under((p,), state)[2]
        _, log = likeliest(case.sums, *case.sums.plain(left[None]), case.usual)
        moved = left[:-1] + case.mean
        moved[case.own((p,))] += case.under((p,), state)[1].more
        each[p] = log[0] - 0.5 * moved @ case.precision(none.noise)[0] @ moved
    assert screened(case, none, (1, 0)) == sorted(each, key=lambda p: -each[p])
    assert screened(case, case.hypothesis((0,), case.usual), (1, 0)) == [1]
    for which in ((), (0,)):
        left, shift = _with_each(case, which, [1], state)
        assert left[0] == pytest.approx(case.under((*which, 1), state)[2])
        assert shift[0] == pytest.approx(
            state.fitted - state.gain(case.own((*which, 1))) @ case.under((*which, 1), state)[1].more
        )


def in_order(*rows):
    return InOrder(SCENE, tuple(sums(SCENE.spread, [told(each)]) for each in rows), {})


def test_a_discrepancy_too_small_to_be_told_may_be_as_large_as_the_references_allow():
    """Any level far below the noise is as likely as none: its logarithm would make every other field unusual."""
    none, clear = in_order(recording(1, rho=0.0)).noise, in_order(recording(1, rho=3.0)).noise
    assert np.all((none.rho > 2.0 * LEVELS[0]) & (none.rho < 1.0))
    assert clear.rho == pytest.approx(np.full(JOINTS, 3.0), rel=0.3)


def test_a_joint_that_no_reference_moves_is_as_sure_as_without_references():
    rows = recording(1)
    rows[:, 1] = 0.0
    still = told(rows)
    still.rows[:, 1] = 0.0
    noise = InOrder(SCENE, (sums(SCENE.spread, [still]),), {}).noise
    assert (noise.rho[1], noise.v[1], noise.unsure[1]) == (UNSEEN, 1.0, UNSURE)
    assert noise.unsure[0] == 1.0


def test_what_nothing_explains_is_no_noise_and_makes_evidence_count_less(machine):
    """Beside a residual that is all noise every row counts; beside one that holds for HOLDS rows, one of as many."""
    case = machine.asked(sums(SCENE.spread, [told(recording(6, sizes=(1.5, 0.0)))]))
    none, one = (case.hypothesis(which, case.usual) for which in ((), (0,)))

    def odds(rest):
        found = (none._replace(rest=5.0), one._replace(log=none.log + 40.0, rest=rest))
        asked = Asked(PARTS, found, (), case.usual, 5.0)
        return asked.counts, np.log(asked.weights[1] / asked.weights[0]) - asked.prior_of(one) + np.log(IN_ORDER)

    assert odds(0.9) == odds(1.3) == pytest.approx((1.0, 40.0))  # 1.3: as references leave of each other
    assert odds(1e3) == pytest.approx((1.0 / HOLDS, 40.0 / HOLDS), rel=1e-3)
    assert 1.0 / HOLDS < odds(2.0)[0] < odds(1.5)[0] < 1.0


def test_the_main_of_several_effects_is_told_by_those_that_were_asked(machine):
    """Of three effects only the true one was asked alone: without it the others explain nothing that is known."""
    case = machine.asked(sums(SCENE.spread, [told(recording(6, sizes=(1.5, 0.0)))]))
    parts = (*PARTS, Column("a third", "c", (2,), 0.2, 8.0, 0, 1))
    none, one = (case.hypothesis(which, case.usual) for which in ((), (1,)))
    found = (none, one._replace(log=none.log + 500.0), one._replace(which=(0, 1, 2), log=none.log + 520.0))
    asked = Asked(parts, found, (), case.usual, 5.0)
    assert asked.main(found[2]) == ("two", "b")
    assert asked.without(found[2], ("one", "a")) == found[1].log


def test_a_law_that_is_only_approximate_leaves_a_share_of_a_large_gap(machine):
    """Out of the tail of what is usual, but a twentieth of the gap: its law's; half of the gap: unknown."""
    case = machine.asked(sums(SCENE.spread, [told(recording(6, sizes=(1.5, 0.0)))]))
    none, one = (case.hypothesis(which, case.usual) for which in ((), (0,)))
    loud = one.noise._replace(v=6.0 * np.ones(JOINTS), rho=100.0 * np.ones(JOINTS))

    def unknown(rest):
        found = (none._replace(rest=100.0), one._replace(log=none.log + 500.0, rest=rest, noise=loud))
        return believed(Asked(PARTS, found, (), case.usual, 100.0)).of[UNKNOWN]

    assert unknown(5.0) < 0.05
    assert unknown(60.0) > 0.9


@pytest.mark.parametrize("key", [UNKNOWN, ("soil_contact", "bucket")])
def test_what_happens_at_moments_and_explains_hardly_anything_is_everyday(machine, key):
    """Three standard errors at an instant are evidence, but no gap; contact, only where references show what is
    everyday, and not where it alone is asked."""
    case = machine.asked(sums(SCENE.spread, [told(recording(9))]))
    none = case.hypothesis((), case.usual)
    happened = Happened(key, none.log + 30.0, 0.05, 0.99 * none.rest)
    asked = Asked(PARTS, (none,), (happened,), case.usual, 1.0, references=2)
    assert believed(asked).first == NOTHING
    large = replace(asked, gap=3.0, hypotheses=(none._replace(rest=1.8),), happened=(happened._replace(rest=1.0),))
    assert believed(large).first == key
    for other in (replace(asked, references=0), replace(asked, only=True)):
        assert believed(other).first == (NOTHING if key == UNKNOWN else key)


def test_work_of_a_machine_without_references_tells_nothing(machine):
    """It was unknown, with certainty, in order too: what was believed beforehand is all there is."""
    case = machine.asked(sums(SCENE.spread, [told(recording(9))]))
    none = case.hypothesis((), case.usual)._replace(rest=9.0)
    work = Happened(("soil_contact", "bucket"), none.log + 1e3, 0.6, 1.5)
    asked = Asked(PARTS, (none,), (work,), case.usual, 9.0)
    found = believed(asked)
    assert found.of[NOTHING] == pytest.approx(0.5)
    assert found.of[UNKNOWN] == pytest.approx(0.1)
    assert sum(found.of.values()) == pytest.approx(1.0)
    assert believed(replace(asked, references=1)).of[UNKNOWN] > 0.9


def test_what_lasts_comes_before_what_happens(machine):
    """Contact is no fault of the machine: beside it, a fault is as probable as ever."""
    contact, rows = ("soil_contact", "bucket"), {5: False, 6: True}
    for seed, lasts in rows.items():
        case = machine.asked(sums(SCENE.spread, [told(recording(seed, sizes=(1.5 * lasts, 0.0)))]))
        asked = Asked(PARTS, tuple(searched(case, range(len(PARTS)))), (), case.usual, 2.0, 2, incident=contact)
        assert asked.lasts is lasts
        assert not replace(asked, happened=(Happened(contact, asked.none.log + 1e3, 0.1, 1.0),)).lasts
        plain = believed(asked)
        beside = plain.instead(contact)
        assert (beside.of[contact], beside.of[NOTHING]) == (plain.of[NOTHING], 0.0)
        assert sum(beside.of.values()) == pytest.approx(1.0)
        whole = SimpleNamespace()
        found = SimpleNamespace(
            asked=asked,
            working=False,
            question=SimpleNamespace(problem=SimpleNamespace(clean=())),
            otherwise=lambda w=whole: w,
        )
        assert decided(found) is (found if lasts else whole)


def test_another_motion_than_the_references_is_less_sure(machine):
    """A column that is three times as large has three times the error of its size in the torques."""
    rows = recording(3)
    wide = rows * np.array([3.0, 3.0, 3.0, 3.0, 1.0])
    narrow, other = (machine.asked(sums(SCENE.spread, [told(each)])) for each in (rows, wide))
    assert other.uncertain() == pytest.approx(3.0 * narrow.uncertain())
    size = np.sqrt(
        np.einsum(
            "brti,ij,brtj->r", rows[..., :-1], machine.covariance * np.outer(SCENE.spread, SCENE.spread), rows[..., :-1]
        )
        / rows[:, 0, :, 0].size
    )
    assert narrow.uncertain() == pytest.approx(float(np.max(size)))
    assert narrow.uncertain(range(COUNT)) == 0.0  # what only the field itself tells, no reference can
    assert 0.0 < narrow.uncertain((3,)) < narrow.uncertain()


@pytest.mark.parametrize(("key", "busy", "log", "works"), [
    (("soil_contact", "bucket"), 0.6, 50.0, True),
    (("soil_contact", "bucket"), 0.3, 50.0, False),  # at moments
    (("soil_contact", "bucket"), 0.6, -50.0, False),  # something that lasts is likelier
    (UNKNOWN, 0.6, 50.0, False),  # a torque at one joint is no work
])  # fmt: skip
def test_a_machine_that_touches_the_ground_in_most_blocks_works(key, busy, log, works):
    """Without references its floor is one of contacts, which hides the work that loads and contact tell together."""
    happened, others = (Happened(key, log, busy, 1.5),), (SimpleNamespace(log=0.0),)
    for slight in (False, True):  # what is everyday is no work
        told = SimpleNamespace(happened=happened, hypotheses=others, slight=lambda _, slight=slight: slight)
        assert digging(told) is (works and not slight)
    assert not digging(SimpleNamespace(happened=(), hypotheses=others))
