"""The likelihood is the textbook's, with parameters, discrepancy, nuisances and sensor noise integrated out."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm

from cylforce.diagnosis.constants import CARRY_BACK, CORRELATED_ROWS, INCIDENT, PAYLOAD, POLYNOMIALS, SAME_MACHINE
from cylforce.diagnosis.likelihood import (
    DECAY,
    LEVELS,
    Conditions,
    Form,
    Likelihood,
    MachineKnowledge,
    Nuisance,
    Payload,
    ResidualNoise,
    TemperatureChange,
    effective_share,
    free_stretches,
    largest_discrepancy,
    likeliest_noise,
    log_prior_of_blocks,
)
from cylforce.diagnosis.statistics import Gram, SharedNoise
from cylforce.effects.fault import BEYOND
from cylforce.readings.constants import BLOCK_ROWS
from diagnosis.synthetic import (
    BASIS,
    BLOCKS,
    COLUMNS,
    HIGH,
    JOINTS,
    LOW,
    PARAMETERS,
    UNIT,
    USUAL,
    blocks,
    gram,
    likelihood,
    rows,
)

SEED = 5
NOISE = ResidualNoise(np.array([0.7, 2.0]), np.array([1.1, 0.8]))


def noise_covariance(noise, joint):
    """Return the covariance (BLOCK_ROWS, BLOCK_ROWS) of a block's discrepancy and white noise."""
    smooth = noise.discrepancy[joint] ** 2 * (BASIS * DECAY) @ BASIS.T
    return noise.white[joint] ** 2 * np.eye(BLOCK_ROWS) + smooth


def brute_force(found, mean, covariance, noise, nuisance=()):
    """Return the log density of rows (B, BLOCK_ROWS, R, K+1) without its constant, from one covariance of all rows.

    nuisance: columns (BLOCK_ROWS, R) with a size of their own, standard normal, in every block
    """
    order = [(b, r) for b in range(len(found)) for r in range(found.shape[2])]
    design = np.concatenate([found[b, :, r, :-1] for b, r in order]).astype(np.float64)
    residual = np.concatenate([found[b, :, r, -1] for b, r in order]).astype(np.float64)
    whole = design @ covariance @ design.T
    for k, (_, r) in enumerate(order):
        own = slice(k * BLOCK_ROWS, (k + 1) * BLOCK_ROWS)
        whole[own, own] += noise_covariance(noise, r)
    for column in nuisance:
        for b in range(len(found)):
            spread = np.concatenate([column[:, r] * (c == b) for c, r in order])
            whole += np.outer(spread, spread)
    constant = 0.5 * len(residual) * np.log(2.0 * np.pi)
    return multivariate_normal(design @ mean, whole).logpdf(residual) + constant


FIVE = np.diag([1.0, 2.0, 0.5, 0.1, 0.3])
MEAN = np.array([0.2, 0.0, 0.0, 0.1, -0.1])


def five_columns(seed, count=2):
    """Return a few blocks with five columns, and what is known of their parameters."""
    rng = np.random.default_rng(seed)
    found = np.concatenate([rng.standard_normal((count, BLOCK_ROWS, JOINTS, 1)), rows(seed)[:count]], axis=-1)
    return found.astype(np.float32), MachineKnowledge(MEAN, FIVE, np.zeros(5), NOISE)


def of_five(found, machine, nuisance=None):
    """Return the likelihood of such blocks, in units of one."""
    count = found.shape[-1] - 1
    own = Gram.of(blocks(found), range(count), np.ones(count), SharedNoise.none(JOINTS, count + 1))
    return Likelihood(own, np.ones(count), (), machine, nuisance=nuisance)


def test_the_evidence_is_that_of_the_whole_covariance():
    found, machine = five_columns(3)
    log = of_five(found, machine).state(NOISE).log
    assert log == pytest.approx(brute_force(found, MEAN, FIVE, NOISE), abs=0.02)


def test_run_to_run_variation_widens_what_is_known_of_the_parameters():
    found, machine = five_columns(3)
    variation = np.array([0.0, 0.4, 0.0, 0.0, 0.2])
    case = of_five(found, replace(machine, variation=variation))
    for times in (1.0, 0.5):
        log = case.state(replace(NOISE, conditions=Conditions(times))).log
        wide = FIVE + np.diag((times * variation) ** 2)
        assert log == pytest.approx(brute_force(found, MEAN, wide, NOISE), abs=0.02)


def test_another_temperature_widens_what_is_known_of_friction_and_of_the_zeros_of_pressure_sensors():
    found, machine = five_columns(3)
    zeros, friction = np.diag([0.0, 0.0, 0.3, 0.0, 0.0]) ** 2, np.outer(*[[0.5, 0.4, 0.0, 0.0, 0.0]] * 2)
    case = of_five(found, replace(machine, temperature=TemperatureChange(zeros, friction)))
    for part in (0.0, 0.3, 1.0):
        log = case.state(replace(NOISE, conditions=Conditions(temperature=part))).log
        assert log == pytest.approx(brute_force(found, MEAN, FIVE + zeros + part**2 * friction, NOISE), abs=0.02)
    assert case.state(NOISE).log == pytest.approx(brute_force(found, MEAN, FIVE, NOISE), abs=0.02)


TIP = np.stack([np.linspace(1.0, 2.0, BLOCK_ROWS), -0.5 * np.linspace(1.0, 2.0, BLOCK_ROWS)], axis=-1)


def beside(found, typical=1.0):
    """Return the nuisance of a force at the teeth, with a size of its own in every block."""
    count = found.shape[-1] - 1
    wave = np.broadcast_to(TIP[None, :, :, None], (*found.shape[:3], 1))
    whole = blocks(np.concatenate([found[..., :-1], wave, found[..., -1:]], axis=-1))
    return Nuisance.of([whole], range(count), np.ones(count), [count], np.array([typical]))


def test_the_evidence_beside_a_nuisance_of_blocks_is_that_of_the_whole_covariance():
    found, machine = five_columns(3)
    log = of_five(found, machine, beside(found, 5.0)).state(NOISE).log
    assert log == pytest.approx(brute_force(found, MEAN, FIVE, NOISE, [5.0 * TIP]), abs=0.05)


def test_a_nuisance_that_is_absent_changes_nothing():
    found, machine = five_columns(3)
    absent = beside(found).sized(np.zeros(len(found)))
    plain, none = (of_five(found, machine, n).state(NOISE) for n in (None, absent))
    assert none.log == pytest.approx(plain.log, abs=1e-6)
    np.testing.assert_allclose(none.fitted, plain.fitted)


def test_blocks_without_the_nuisance_need_not_be_kept():
    found, machine = five_columns(3)
    whole, sizes = beside(found), np.where(np.arange(len(found)) % 3 == 0, 2.0, 0.0)
    one, other = (of_five(found, machine, n) for n in (whole.sized(sizes), whole.present(sizes)))
    assert len(other.nuisance.across) == np.count_nonzero(sizes)
    assert other.state(NOISE).log == pytest.approx(one.state(NOISE).log, abs=1e-6)
    residual = np.append(-MEAN, 1.0)
    for a, b in zip(*(case.nuisance.energies(residual, NOISE) for case in (one, other)), strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("size", [1.5, 0.6])
def test_the_evidence_of_an_effect_is_integrated_over_its_magnitude(size):
    """Log-uniform over the plausible magnitudes, of either sign."""
    found = rows(6, (size, 0.0))[:4]
    case = likelihood(found)
    effects, near = [], np.concatenate([np.linspace(LOW, 3.0, 1500), -np.linspace(LOW, 3.0, 1500)])
    prior = case.machine.covariance * np.outer(UNIT, UNIT) + 1e-12 * np.diag(UNIT**2)
    for each in near:
        less = found.astype(np.float64).copy()
        less[..., -1] -= each * less[..., 2]
        effects.append(less)
    none = brute_force(effects[0], np.append(PARAMETERS, [0.0, 0.0]), prior, USUAL)
    state = case.state(USUAL)
    # Along the magnitude the log density is a parabola: three points of it are enough.
    points = [brute_force(effects[k], np.append(PARAMETERS, [0.0, 0.0]), prior, USUAL) for k in (0, 700, 1400)]
    parabola = np.polyfit(near[[0, 700, 1400]], points, 2)
    assert points[0] == none
    density = -np.log(np.abs(near)) - np.log(2.0 * np.log(BEYOND * HIGH / LOW))
    step = (3.0 - LOW) / 1499
    expected = logsumexp(np.polyval(parabola, near) + density) + np.log(step)
    assert case.under((0,), state)[0] == pytest.approx(expected, abs=0.15)


def test_a_magnitude_and_its_error_are_those_of_least_squares():
    case = likelihood(rows(6, (1.5, 0.0)))
    h = case.hypothesis((0,), USUAL)
    size, error = h.sizes[0] * UNIT[2], h.errors[0] * UNIT[2]
    assert abs(size - 1.5) < 4.0 * error
    assert error == pytest.approx(1.0 / np.sqrt(JOINTS * BLOCKS * BLOCK_ROWS * 0.3**2), rel=0.15)


# Prior of a magnitude


@pytest.mark.parametrize(("axes", "sign"), [(1, 0), (1, 1), (1, -1), (2, 0), (3, 0)])
def test_the_prior_of_a_magnitude_integrates_to_one(axes, sign):
    """Along the radius, times the surface of the sphere on which the direction is free."""
    form = Form("one", "a", tuple(range(axes)), LOW, HIGH, sign, axes)

    def density(radius):
        sizes = np.zeros(axes)
        sizes[0] = (sign or 1) * radius
        return np.exp(form.log_prior(sizes, 1e-12 * np.eye(axes)))

    sphere = {1: 1.0 if sign else 2.0, 2: 2.0 * np.pi, 3: 4.0 * np.pi}[axes]
    whole = quad(lambda x: sphere * x ** (axes - 1) * density(x), LOW * 1.0001, BEYOND * HIGH * 0.9999, limit=100)[0]
    assert whole == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(("size", "error", "sign"), [(1.0, 0.05, 0), (0.3, 0.3, 0), (0.0, 3.0, 0), (2.0, 1.0, 1)])
def test_the_prior_of_a_magnitude_is_averaged_over_its_uncertainty(size, error, sign):
    form = Form("one", "a", (2,), LOW, HIGH, sign)
    whole = np.log(BEYOND * HIGH / LOW) * (1.0 if sign else 2.0)

    def both(x):
        return (norm.pdf(x, size, error) + (0.0 if sign else norm.pdf(-x, size, error))) / (x * whole)

    expected = quad(both, LOW, BEYOND * HIGH, limit=200, points=[max(size, LOW + 0.01)])[0]
    assert np.exp(form.log_prior(np.array([size]), np.array([[error**2]]))) == pytest.approx(expected, rel=0.15)


def test_a_magnitude_beyond_the_largest_or_of_the_wrong_sign_is_hardly_probable():
    form = Form("one", "a", (0,), LOW, HIGH, 1)
    right, wrong, large = (form.log_prior(np.array([x]), np.array([[0.01]])) for x in (2.0, -2.0, 20.0))
    assert wrong < right - 100.0
    assert large < right - 100.0


def test_implausible_magnitudes_that_depend_on_each_other_are_no_more_probable_than_the_nearest_plausible_ones():
    """Two effects with nearly the same column: only their sum is certain, and it is too large for both together."""
    found = rows(SEED, (100.0, 0.0))
    found[..., 3] = found[..., 2] + 0.01 * np.random.default_rng(SEED).standard_normal(found.shape[:-1])
    found[..., -1] += 50.0 * (found[..., 3] - found[..., 2])
    case = likelihood(found)
    log, fitted, _ = case.under((0, 1), case.state(USUAL))
    assert np.all(np.abs(fitted.sizes * UNIT[2:]) > BEYOND * HIGH)
    nearest = found.copy()
    nearest[..., -1] -= BEYOND * HIGH * (found[..., 2] + found[..., 3])
    assert log < likelihood(nearest).state(USUAL).log + 10.0


def test_a_weak_effect_is_approximated_with_the_noise_of_the_hypothesis_without_it():
    case = likelihood(rows(SEED, (0.3, 0.0)))
    base = case.hypothesis((), USUAL)
    near, exact = case.nearby(base, 0), case.with_one_more(base, 0)
    assert near.forms == exact.forms
    assert near.log == pytest.approx(exact.log, abs=1.0)
    np.testing.assert_allclose(near.sizes, exact.sizes, atol=0.1)


def test_without_other_oil_only_the_zeros_of_sensors_change_with_the_temperature():
    zeros, friction = np.diag([0.0, 1.0]), np.diag([2.0, 0.0])
    sensors = MachineKnowledge(np.zeros(2), np.eye(2), np.zeros(2), NOISE, TemperatureChange(zeros, None))
    both = replace(sensors, temperature=TemperatureChange(zeros, friction))
    (only,) = sensors.temperatures
    assert not only.other_oil
    np.testing.assert_allclose(sensors.under(only), np.diag([1.0, 2.0]))
    assert len(both.temperatures) > 1
    np.testing.assert_allclose(both.under(Conditions(temperature=1.0)), np.diag([3.0, 2.0]))


def test_a_magnitude_is_bounded_by_the_largest_plausible_one_in_proportion():
    form, largest = Form("one", "a", (0, 1, 2), LOW, HIGH, 0, 2), BEYOND * HIGH
    np.testing.assert_allclose(form.bounded(np.array([1.0, 2.0, 9.0])), [1.0, 2.0, 9.0])
    found = form.bounded(np.array([-30.0, 40.0, 5.0]))
    np.testing.assert_allclose(found / largest, np.array([-0.6, 0.8, 0.1]), rtol=1e-6)
    assert np.linalg.norm(found[:2]) < largest


def test_evidence_counts_in_full_beside_white_noise_and_one_row_of_many_beside_model_error():
    healthy = float(np.sqrt(1.0 + SAME_MACHINE))
    assert [effective_share(rest) for rest in (0.5, 1.0, healthy)] == pytest.approx([1.0, 1.0, 1.0])
    assert effective_share(1e6) == pytest.approx(1.0 / CORRELATED_ROWS)
    shares = [effective_share(rest) for rest in np.geomspace(healthy, 1e3, 30)]
    assert np.all(np.diff(shares) < 0.0)


# Noise of the residual


def test_level_of_the_discrepancy_and_scale_of_the_noise_are_found():
    found = gram(rows(4, level=6.0, scale=1.3))
    exact = np.array([*(-np.array(PARAMETERS)), 0.0, 0.0, 1.0])
    noise, _ = likeliest_noise(found, *found.certain_energies(exact[None]), None)
    assert noise.discrepancy[0] == pytest.approx([6.0, 6.0], rel=0.25)
    assert noise.white[0] == pytest.approx([1.3, 1.3], rel=0.05)


def test_a_discrepancy_too_small_to_be_seen_may_be_as_large_as_the_rows_allow():
    """Any level far below the noise is as likely as none."""
    exact = np.array([*(-np.array(PARAMETERS)), 0.0, 0.0, 1.0])
    for level, low, high in ((0.0, 2.0 * LEVELS[0], 1.0), (3.0, 2.0, 4.5)):
        found = gram(rows(1, level=level))
        white, smooth = (each[0] for each in found.certain_energies(exact[None]))
        assert np.all(
            (largest_discrepancy(found, white, smooth) > low) & (largest_discrepancy(found, white, smooth) < high)
        )


def test_a_residual_like_the_healthy_one_is_usual_and_a_tenfold_one_is_not():
    case = likelihood(rows(9))
    assert case.healthy.noise.probability_usual(USUAL) > 0.9
    loud = ResidualNoise(np.full(JOINTS, 30.0), np.full(JOINTS, 4.0))
    assert loud.probability_usual(USUAL) < 0.05
    wide = replace(USUAL, width=np.full(JOINTS, 3.0))
    assert loud.log_prior(wide) > loud.log_prior(USUAL)


# Sensor noise in columns and residual


def shared_noise(per_row, column=0):
    """Return one block of white noise whose product with the residual's is `per_row` (R,) in a column."""
    products = np.zeros((1, len(per_row), 1 + POLYNOMIALS, COLUMNS + 1))
    products[0, :, 0, column] = np.array(per_row) * BLOCK_ROWS
    products[0, :, 1:, column] = np.array(per_row)[:, None]
    return SharedNoise(products, np.full((1, len(per_row)), float(BLOCK_ROWS)))


def test_sensor_noise_in_both_is_taken_off_the_score():
    """Errors in variables: without it, least squares tend to the solution that cancels the noise."""
    found = gram(rows(9), shared_noise([0.02, 0.0]))
    quiet = ResidualNoise(np.full(JOINTS, 1e-9), np.full(JOINTS, 2.0))
    off = quiet.shared(found)[0]
    expected = quiet.white[0] ** -2.0 * found.shared[0, 0, 0, 0]
    assert off == pytest.approx([expected, 0.0, 0.0, 0.0])
    smooth = ResidualNoise(np.full(JOINTS, 1e6), np.full(JOINTS, 2.0))
    # The discrepancy takes what lies along the polynomials: of white noise as much along each as in one row.
    assert smooth.shared(found)[0][0] == pytest.approx(expected * (1.0 - POLYNOMIALS / BLOCK_ROWS), rel=1e-6)


def unsure(found, products=5.0):
    """Return the likelihoods of rows without sensor noise, and with noise in column and residual that is as uncertain
    as large."""
    pair = np.zeros((2, JOINTS, 1 + POLYNOMIALS, COLUMNS + 1))
    pair[0, :, 0, 2], pair[1, :, 0, 2] = products, -products
    counts = np.full((2, JOINTS), BLOCK_ROWS * BLOCKS / 2.0)
    return likelihood(found), likelihood(found, SharedNoise(pair, counts))


def test_a_magnitude_whose_sensor_noise_is_uncertain_has_less_evidence_and_a_larger_error():
    """Of a score s = I size + noise of variance I + V the gain is s^2 / 2 (I + V), not s^2 / 2 I."""
    sure, doubted = unsure(rows(6, (1.5, 0.0)))
    state = doubted.state(USUAL)
    information, extra = float(state.information([2])[0, 0]), float(np.sum(state.unsure[:, 2] ** 2))
    assert extra > 0.1 * information
    known, uncertain = (case.under((0,), case.state(USUAL))[1] for case in (sure, doubted))
    gain = known.gain - 0.5 * np.log(2.0 * np.pi / information)
    less = uncertain.gain - uncertain.doubt - 0.5 * np.log(2.0 * np.pi * uncertain.covariance[0, 0])
    assert less == pytest.approx(gain * information / (information + extra), rel=1e-2)
    assert uncertain.covariance[0, 0] == pytest.approx((information + extra) / information**2, rel=1e-2)


def test_uncertain_sensor_noise_hides_a_large_effect_less_than_a_small_one():
    def kept(size):
        sure, doubted = (
            c.hypothesis((0,), USUAL).log - c.hypothesis((), USUAL).log for c in unsure(rows(6, (size, 0.0)))
        )
        return doubted / sure

    assert 0.0 < kept(1.5) < kept(4.0) < kept(8.0) < 1.0


def test_a_second_effect_is_doubted_as_much_as_if_it_were_alone():
    """Beside a large effect, the noise of a recording without any would hide all doubt."""
    alone, both = (unsure(rows(6, sizes))[1] for sizes in ((1.5, 0.0), (1.5, 8.0)))
    first = both.hypothesis((1,), USUAL)
    more, single = both.with_one_more(first, 0).doubt - first.doubt, alone.hypothesis((0,), USUAL).doubt
    assert single > 5.0
    assert more == pytest.approx(single, rel=0.3)


def test_a_neighbour_of_a_true_effect_takes_none_of_its_doubt_back():
    """Two columns that are nearly the same: with the second one the first is doubted no less."""
    found = rows(6, (8.0, 0.0))
    found[..., 3] = 0.9 * found[..., 2] + 0.43 * found[..., 3]
    case = unsure(found)[1]
    one = case.hypothesis((0,), USUAL)
    assert one.doubt > 5.0
    assert case.with_one_more(one, 1).doubt >= one.doubt
    assert case.with_one_more(one, 1).log < one.log + 5.0


def test_an_effect_taken_out_of_the_rows_at_its_magnitude_is_as_probable_as_before():
    found = rows(6, (1.5, 0.0))
    plain = likelihood(found).hypothesis((0,), USUAL)
    found[..., -1] -= np.float32(1.5) * found[..., 2]
    again = replace(likelihood(found), corrected={0: np.array([1.5 / UNIT[2]])})
    corrected = again.hypothesis((0,), USUAL)
    assert corrected.log == pytest.approx(plain.log, abs=0.1)
    assert corrected.sizes == pytest.approx(plain.sizes, rel=1e-3)


def test_evidence_from_elsewhere_is_added():
    case = likelihood(rows(6, (1.5, 0.0)))
    more = replace(case, support=lambda form, sizes: 7.0 if form == 0 and 1.3 < sizes[0] < 1.7 else 0.0)
    assert more.hypothesis((0,), USUAL).log - case.hypothesis((0,), USUAL).log == pytest.approx(7.0, abs=0.01)
    assert more.hypothesis((1,), USUAL).log == case.hypothesis((1,), USUAL).log


# Nuisances of blocks


WAVE = np.stack([lever * np.linspace(1.0, 2.0, BLOCK_ROWS) for lever in (1.0, -0.5)], axis=-1)
TYPICAL_FORCE = 5.0


def with_forces(seed, sizes, noise=1.0):
    """Return rows with a force at the teeth of some size in the first blocks, and the nuisance of such forces."""
    found = rows(seed, level=noise, scale=noise).astype(np.float64)
    for b, size in enumerate(sizes):
        found[b, ..., -1] += size * WAVE
    wave = np.broadcast_to(WAVE[None, :, :, None], (*found.shape[:3], 1))
    whole = blocks(np.concatenate([found[..., :-1], wave, found[..., -1:]], axis=-1))
    return found, Nuisance.of([whole], range(COLUMNS), UNIT, [COLUMNS], np.array([TYPICAL_FORCE]))


def reported(case):
    return np.append(-case.machine.mean, 1.0)


def test_a_force_in_some_blocks_is_found_in_these_blocks_whatever_its_size():
    """From a twentieth of what is typical to four times as much."""
    sizes = np.repeat([0.3, 3.0, 20.0], 4) * np.random.default_rng(9).choice([-1.0, 1.0], 12)
    found, force = with_forces(9, sizes, noise=0.1)
    case = likelihood(found)
    quiet = ResidualNoise(np.full(JOINTS, 0.1), np.full(JOINTS, 0.3))
    each = force.likeliest_sizes(reported(case), quiet, (3.0, 1.0, 0.3, 0.1, 0.03, 0.01))
    assert np.array_equal(each > 0.0, np.arange(BLOCKS) < len(sizes))
    ratio = each[: len(sizes)] * TYPICAL_FORCE / np.abs(sizes)
    assert np.all((ratio > 0.25) & (ratio < 4.0))
    expected, covariance = force.sized(each).expected(reported(case), quiet)
    forces = expected[: len(sizes), 0] * each[: len(sizes)] * TYPICAL_FORCE
    np.testing.assert_allclose(forces, sizes, atol=0.15)
    assert np.all(np.sqrt(covariance[: len(sizes), 0, 0]) * each[: len(sizes)] * TYPICAL_FORCE < 0.15)


def test_a_nuisance_reduces_the_energies_by_what_it_explains():
    found, force = with_forces(9, np.full(BLOCKS, 6.0))
    case = likelihood(found)
    white, smooth = case.gram.energies(reported(case), np.zeros((COLUMNS, COLUMNS)))
    less_white, less_smooth = force.energies(reported(case), USUAL)
    whole, rest = np.sum(white) + np.sum(smooth), np.sum(white + less_white) + np.sum(smooth + less_smooth)
    clean = likelihood(rows(9))
    expected = clean.gram.energies(reported(clean), np.zeros((COLUMNS, COLUMNS)))
    assert whole > 5.0 * rest
    assert rest == pytest.approx(np.sum(expected[0]) + np.sum(expected[1]), rel=0.1)


def test_an_incident_in_a_block_has_the_stated_prior_probability():
    present = np.array([True, False, False])
    log = log_prior_of_blocks(present, (1.0,))
    assert log == pytest.approx(np.log(INCIDENT) + 2.0 * np.log(1.0 - INCIDENT))
    assert log_prior_of_blocks(present, (1.0, 0.1)) == pytest.approx(log - np.log(2.0))


@pytest.mark.parametrize("times", [0.0, 10.0, 1000.0])
def test_however_heavy_an_unknown_load_is_the_noise_is_that_of_the_sensors(times):
    """In every block another load, up to a thousand times the noise."""
    rng, count = np.random.default_rng(SEED), 20
    own, load, noise = rng.standard_normal((3, count, BLOCK_ROWS))
    residual = own + load * (times * rng.standard_normal(count))[:, None] + noise
    whole = blocks(np.stack([own, load, residual], axis=-1)[:, :, None, :])
    loads = Nuisance.of([whole], [0], np.ones(1), [1], np.array([max(times, 1.0)]))
    usual = ResidualNoise(np.array([0.1]), np.array([1.0]))
    recording = Gram.of(whole, [0], np.ones(1), SharedNoise.none(1, 2))
    case = Likelihood(
        recording, np.ones(1), (), MachineKnowledge(np.zeros(1), np.eye(1), np.zeros(1), usual), nuisance=loads
    )
    found = case.hypothesis((), usual)
    assert found.noise.white[0] == pytest.approx(1.0, abs=0.05), f"seed {SEED}"
    assert found.noise.discrepancy[0] < 0.3


# Payloads


QUIET = ResidualNoise(np.array([0.1]), np.array([1.0]))
TYPICAL_LOAD = 25.0  # in units of the noise
STRETCH_BLOCKS = 10


def payloads(rng, *loads, carried_on=True):
    """Return stretches of ten blocks with one load each, in units of the noise, and coefficients of the residual."""
    count = STRETCH_BLOCKS * len(loads)
    own, load, noise = rng.standard_normal((3, count, BLOCK_ROWS))
    residual = load * np.repeat(loads, STRETCH_BLOCKS)[:, None] + noise
    whole = blocks(np.stack([own, load, residual], axis=-1)[:, :, None, :])
    each = Nuisance.of([whole], [0], np.ones(1), [1], np.array([PAYLOAD * TYPICAL_LOAD]))
    return (
        Payload(
            each.across,
            each.within,
            each.waves,
            each.smooth,
            np.repeat(np.arange(len(loads)), STRETCH_BLOCKS),
            carried_on & (np.arange(len(loads)) > 0),
            np.zeros((count, 1, 1 + POLYNOMIALS, 1)),
            np.ones(1),
        ),
        np.array([0.0, 1.0]),
        each,
    )


@pytest.mark.parametrize(
    ("loads", "differs", "fell"),
    [
        ((100.0, 100.0), [], []),
        ((100.0, 99.0), [1], []),  # less than sticks in an empty bucket
        ((100.0, 101.0), [1], []),  # taken up
        ((100.0, 60.0), [1], [1]),
        ((100.0, 80.0, 100.0), [1, 2], []),  # it was held up, and came back
        ((100.0, 80.0, 81.0), [1, 2], [1]),
        ((100.0, 80.0, 60.0), [1, 2], [1, 2]),
    ],
)
def test_a_part_fell_out_if_the_load_is_smaller_from_then_on(loads, differs, fell):
    assert 1.0 < CARRY_BACK * TYPICAL_LOAD < 20.0
    payload, residual, _ = payloads(np.random.default_rng(SEED), *loads)
    found = payload.losses(residual, QUIET)
    assert [np.flatnonzero(each).tolist() for each in (found.differs, found.fell)] == [differs, fell], f"seed {SEED}"
    unit = PAYLOAD * TYPICAL_LOAD
    less, errors = unit * found.less[1:, 0], unit * found.errors[1:, 0]
    assert np.all(np.abs(less + np.diff(loads)) < 4.0 * errors)
    assert errors == pytest.approx(np.sqrt(2.0 / (STRETCH_BLOCKS * BLOCK_ROWS)), rel=0.2)


def test_loads_of_stretches_that_are_not_carried_on_are_never_lost():
    payload, residual, _ = payloads(np.random.default_rng(SEED), 100.0, 60.0, carried_on=False)
    found = payload.losses(residual, QUIET)
    assert not np.any(found.differs | found.fell)


def test_one_load_in_all_blocks_of_a_stretch_is_known_better_than_one_in_each():
    """The information that is lost to it is that of one size, however many blocks it is in."""
    payload, residual, each = payloads(np.random.default_rng(SEED), 30.0, 30.0)
    sizes, covariance = payload.expected(residual, QUIET)
    apart = each.expected(residual, QUIET)[1]
    assert np.ptp(sizes) == 0.0
    assert covariance[0, 0, 0] == pytest.approx(np.mean(apart) / (2 * STRETCH_BLOCKS), rel=0.1)
    assert payload.marginal(QUIET)[1] < each.marginal(QUIET)[1]


# Stretches free of contact, by dynamic programming along time


SETTLE = 12  # rows
LIFTS = ((100, 260, 900.0), (340, 420, 10.0), (500, 680, 400.0), (760, 840, -8.0))  # first and last row, load
TYPICAL = np.array([250.0])
EMPTIED = 1.5  # rad, from where the bucket is as the load is lifted


def digging(seed, lifts=LIFTS, count=900):
    """Return arguments of `free_stretches` by name: a load in every lift, between them a hundred times the noise."""
    rng, t = np.random.default_rng(seed), np.arange(count)
    loads = np.stack([1.0 + 0.5 * np.sin(t / 31.0), 0.6 + 0.4 * np.cos(t / 23.0)], axis=1)[..., None]
    residual = 100.0 * np.stack([np.sin(t / 7.0), np.cos(t / 9.0)], axis=1)
    for first, last, carried in lifts:
        residual[first:last] = loads[first:last, :, 0] * carried
    residual = residual + rng.standard_normal(residual.shape)
    usable = np.ones(residual.shape, dtype=np.bool_)
    tilt = 0.3 * np.sin(t / 40.0)
    return {"residual": residual, "loads": loads, "usable": usable, "tilt": tilt, "typical": TYPICAL, "settle": SETTLE}


def test_lifts_and_returns_are_found_without_the_rows_in_which_filters_settle():
    found = free_stretches(**digging(SEED))
    assert [each.loaded for each in found] == [True, False, True, False], f"seed {SEED}"
    for each, (first, last, _) in zip(found, LIFTS, strict=True):
        assert first + SETTLE - 4 <= each.first <= first + SETTLE + 4
        assert last - SETTLE - 4 <= each.last <= last - SETTLE + 4


@pytest.mark.parametrize(("lifts", "free"), [((), 0.0), (((0, 900, 0.0),), 0.85)])
def test_contact_all_the_time_has_no_free_stretch_and_none_at_all_hardly_anything_else(lifts, free):
    """A stretch of twenty seconds is followed by another one."""
    found = free_stretches(**digging(SEED, lifts))
    share = sum(each.last - each.first for each in found) / 900.0
    assert share >= free if lifts else share == 0.0
    assert not any(each.loaded for each in found)


PARTS = ((100, 260, 900.0), (266, 400, 840.0), (500, 660, 500.0))  # 60 fall out of the first within 0.3 s


@pytest.mark.parametrize(
    ("until", "tilted", "begins", "carried_on"),
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
def test_a_load_is_carried_on_unless_it_is_dumped_or_the_ground_takes_it(until, tilted, begins, carried_on):
    """Emptied at last between the rows 400 and 480; before, the bucket is tilted from some row on."""
    given = digging(SEED, (PARTS[0], (until, *PARTS[1][1:]), PARTS[2]))
    tilt = np.where(np.arange(900) >= (begins if tilted == EMPTIED else 261), tilted, 0.0)
    tilt[400:480] = EMPTIED
    found = free_stretches(**(given | {"tilt": tilt}))
    assert [each.carried_on for each in found if each.loaded] == [False, carried_on, False], f"seed {SEED}"


def test_a_tool_that_never_turns_is_not_seen_to_be_emptied():
    found = free_stretches(**(digging(SEED, PARTS) | {"tilt": np.zeros(900)}))
    assert not any(each.carried_on for each in found)


def test_what_happens_while_nothing_is_usable_is_not_known():
    given = digging(SEED, PARTS)
    given["usable"][255:320] = False
    tilt = np.where(np.arange(900) % 500 < 400, 0.0, EMPTIED)
    assert not any(each.carried_on for each in free_stretches(**(given | {"tilt": tilt})))


def test_a_recording_in_which_nothing_is_usable_has_no_load():
    given = digging(SEED)
    given["usable"][:] = False
    assert not any(each.loaded for each in free_stretches(**given))
