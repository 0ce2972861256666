"""Sufficient statistics: the noise floor whitens, and Gram matrices add up."""

import numpy as np
import pytest

from cylforce.diagnosis.constants import MEMORY, POLYNOMIALS
from cylforce.diagnosis.statistics import (
    FEWEST_ROWS,
    STATIONARY,
    Blocks,
    Gram,
    NoiseFloor,
    SharedNoise,
    in_blocks,
    polynomials,
    predicted_off,
    rms,
)
from cylforce.readings.constants import BLOCK_ROWS

SEED = 5
AUTOREGRESSION = np.array([0.5, 0.2, -0.15])


def coloured(seed, count=20_000):
    """Return a residual (T, 1) that follows the autoregression, and its innovations (T, 1)."""
    innovations = np.random.default_rng(seed).normal(0.0, 3.0, count)
    found = np.zeros(count)
    for k in range(count):
        found[k] = innovations[k] + sum(a * found[k - n] for n, a in enumerate(AUTOREGRESSION, 1) if k >= n)
    return found[:, None], innovations[:, None]


def test_whitening_returns_the_innovations_of_an_autoregression():
    residual, innovations = coloured(SEED)
    white = predicted_off(residual[:, 0], AUTOREGRESSION)
    assert np.all(np.isnan(white[:MEMORY]))
    np.testing.assert_allclose(white[MEMORY:], innovations[MEMORY:, 0], atol=1e-10)


def test_the_noise_floor_finds_rms_colour_and_white_part():
    residual, innovations = coloured(SEED)
    floor = NoiseFloor.of([residual[:9_000], residual[9_000:]])
    assert floor.memory[0] == pytest.approx(AUTOREGRESSION, abs=0.03), f"seed {SEED}"
    assert floor.white[0] == pytest.approx(np.std(innovations), rel=0.01)
    assert floor.rms[0] == pytest.approx(np.std(residual), rel=1e-3)
    louder = floor.scaled(np.array([2.0]) * floor.rms)
    assert louder.white == pytest.approx(2.0 * floor.white)
    np.testing.assert_array_equal(louder.memory, floor.memory)


def test_a_row_that_is_not_usable_spoils_the_rows_that_it_would_predict_and_no_others():
    residual = coloured(SEED, 100)[0][:, 0]
    residual[50] = np.nan
    white = predicted_off(residual, AUTOREGRESSION)
    assert np.flatnonzero(np.isnan(white)).tolist() == [*range(MEMORY), *range(50, 51 + MEMORY)]


def test_what_is_slow_does_not_vanish_as_noise():
    """A drift is predicted by its last samples; a fifth of a constant passes all the same."""
    drift = np.cumsum(np.random.default_rng(SEED).standard_normal(5_000))[:, None]
    assert np.sum(NoiseFloor.of([drift]).memory[0]) <= 1.0 - STATIONARY + 1e-12


def test_rms_ignores_what_is_not_usable():
    assert rms([np.array([[3.0, np.nan], [np.nan, np.nan]]), np.array([[4.0, np.nan]])]) == pytest.approx(
        [12.5**0.5, 0.0]
    )


def test_polynomials_are_orthonormal_on_the_usable_rows_of_each_block():
    rng = np.random.default_rng(SEED)
    usable = rng.uniform(size=(6, BLOCK_ROWS, 2)) < 0.6
    usable[3, FEWEST_ROWS - 1 :, 1] = False
    found = polynomials(usable)
    for b in range(6):
        for r in range(2):
            own = found[b, :, r]
            np.testing.assert_allclose(own[~usable[b, :, r]], 0.0, atol=1e-12)
            unit = np.eye(POLYNOMIALS) * (usable[b, :, r].sum() >= FEWEST_ROWS)
            np.testing.assert_allclose(own.T @ own, unit, atol=1e-12)
    assert not np.any(found[3, :, 1])


def test_blocks_hold_all_rows_and_are_filled_up_with_zeros():
    rows = np.arange(1.0, BLOCK_ROWS + 3.0)[:, None]
    found = in_blocks(rows)
    assert found.shape == (2, BLOCK_ROWS, 1)
    np.testing.assert_array_equal(found.reshape(-1)[: len(rows)], rows[:, 0])
    assert not np.any(found.reshape(-1)[len(rows) :])


def whitened(seed, count, joints=2, columns=4, lost=0.1):
    """Return blocks of `count` random rows, some of them not usable."""
    rng = np.random.default_rng(seed)
    rows = rng.standard_normal((count, joints, columns + 1))
    rows[rng.uniform(size=(count, joints)) < lost] = np.nan
    floor = NoiseFloor(np.ones(joints), np.zeros((joints, MEMORY)), np.array([1.0, 2.0])[:joints])
    return Blocks.whitened(rows, floor), rows


def gram(blocks, unit, noise=None):
    columns = range(len(unit))
    return Gram.of(blocks, columns, unit, noise or SharedNoise.none(blocks.usable.shape[2], len(unit) + 1))


UNIT = np.array([1.0, 10.0, 0.1, 3.0])


def test_the_gram_holds_the_products_of_all_usable_rows_in_units_of_the_white_noise():
    blocks, rows = whitened(SEED, 5 * BLOCK_ROWS)
    found, scale = gram(blocks, UNIT), np.append(UNIT, 1.0)
    for r, white in enumerate((1.0, 2.0)):
        finite = np.all(np.isfinite(rows[:, r]), axis=1)
        known = np.all([finite[MEMORY - lag : len(rows) - lag] for lag in range(MEMORY + 1)], axis=0)
        good = rows[MEMORY:, r][known] / white * scale
        assert found.rows[r] == len(good)
        np.testing.assert_allclose(found.whole[r], good.T @ good, rtol=1e-4, atol=1e-4 * np.max(found.whole[r]))
    along = np.einsum("btrs,btrn->brsn", blocks.basis, blocks.rows) * scale
    expected = np.einsum("brsi,brsj->rsij", along, along)
    np.testing.assert_allclose(found.smooth, expected, rtol=1e-4, atol=1e-5 * np.max(expected))


def test_the_gram_of_two_recordings_is_the_sum():
    one, two = whitened(1, 5 * BLOCK_ROWS)[0], whitened(2, 3 * BLOCK_ROWS)[0]
    both = Blocks(np.concatenate([one.rows, two.rows]), np.concatenate([one.usable, two.usable]))
    total, whole = Gram.total([gram(one, UNIT), gram(two, UNIT)]), gram(both, UNIT)
    for name in ("whole", "smooth", "rows", "blocks"):
        np.testing.assert_allclose(getattr(total, name), getattr(whole, name), rtol=1e-5, atol=1e-4, err_msg=name)


@pytest.mark.parametrize("changed", [[1], [0, 3], [4], [2, 4]], ids=str)
def test_a_gram_with_some_columns_renewed_is_that_of_the_new_rows(changed):
    """Number 4 stands for the residual."""
    blocks = whitened(1, 5 * BLOCK_ROWS)[0]
    rows = blocks.rows.copy()
    rows[..., changed] += np.random.default_rng(9).standard_normal(rows[..., changed].shape).astype(np.float32)
    other = Blocks(rows * blocks.usable[..., None], blocks.usable)
    found, anew = gram(blocks, UNIT).with_columns([other], changed, UNIT, [SharedNoise.none(2, 5)]), gram(other, UNIT)
    assert np.max(np.abs(anew.whole - gram(blocks, UNIT).whole)) > 1.0
    for name in ("whole", "smooth"):
        one, two = getattr(found, name), getattr(anew, name)
        assert np.max(np.abs(one - two)) <= 1e-6 * np.max(np.abs(two)), name


def test_energies_of_a_residual_are_those_of_its_rows():
    blocks = whitened(1, 5 * BLOCK_ROWS)[0]
    coefficients = np.array([0.3, -0.1, 2.0, 0.5, 1.0])
    found = gram(blocks, UNIT)
    residual = blocks.rows.astype(np.float64) @ (coefficients * np.append(UNIT, 1.0))
    along = np.einsum("btrs,btr->brs", blocks.basis, residual)
    white, smooth = found.energies(coefficients, np.zeros((4, 4)))
    np.testing.assert_allclose(smooth, np.sum(along**2, axis=0), rtol=1e-4)
    np.testing.assert_allclose(white + np.sum(smooth, axis=1), np.sum(residual**2, axis=(0, 1)), rtol=1e-4)
    for one, many in zip((white, smooth), found.certain_energies(coefficients[None]), strict=True):
        np.testing.assert_allclose(many[0], one, rtol=1e-9)
    assert found.rms(coefficients) ** 2 * found.rows == pytest.approx(white + np.sum(smooth, axis=1))


def test_parameters_that_are_uncertain_add_the_energy_of_their_columns():
    found, covariance = gram(whitened(1, 5 * BLOCK_ROWS)[0], UNIT), np.diag([0.5, 0.0, 0.0, 0.0])
    coefficients = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
    more, plain = (sum(map(np.sum, found.energies(coefficients, c))) for c in (covariance, 0.0 * covariance))
    assert more - plain == pytest.approx(0.5 * np.sum(found.whole[:, 0, 0]))


def test_rows_laid_into_new_blocks_keep_what_they_hold():
    blocks = whitened(1, 2 * BLOCK_ROWS)[0]
    order = np.full(BLOCK_ROWS, -1)
    order[:4] = [BLOCK_ROWS + 7, 20, 21, 3]
    found, flat = blocks.laid(order), blocks.rows.reshape(-1, *blocks.rows.shape[2:])
    np.testing.assert_array_equal(found.rows[0, :4], flat[order[:4]])
    np.testing.assert_array_equal(found.usable[0, :4], blocks.usable.reshape(-1, 2)[order[:4]])
    assert not np.any(found.rows[0, 4:])
    assert not np.any(found.usable[0, 4:])


def noise_in_both(slow, blocks=20, factor=2.0):
    """Return what sensor noise adds to one column, `factor` times what it adds to the residual."""
    rng = np.random.default_rng(SEED)
    noise = np.repeat(rng.standard_normal(blocks), BLOCK_ROWS) if slow else rng.standard_normal(blocks * BLOCK_ROWS)
    added = np.stack([factor * noise, noise], axis=-1)[:, None, :].astype(np.float32)
    return SharedNoise.of(Blocks(in_blocks(added), np.ones((blocks, BLOCK_ROWS, 1), dtype=np.bool_)), [0])


@pytest.mark.parametrize("slow", [False, True])
def test_noise_in_both_is_known_along_the_polynomials(slow):
    """White noise has as much along each polynomial as in a row; what is constant in a block is along the first."""
    found = noise_in_both(slow)
    products, rows = found.products.sum(axis=0)[0, :, 0], float(found.counts.sum())
    assert products[0] == pytest.approx(2.0 * rows, rel=0.5 if slow else 0.1)
    assert products[1] / products[0] == pytest.approx(1.0 if slow else 1.0 / BLOCK_ROWS, rel=0.01 if slow else 1.0)
    assert products[2] / products[0] == pytest.approx(0.0 if slow else 1.0 / BLOCK_ROWS, abs=1e-6 if slow else 0.03)


def test_noise_of_a_part_is_expected_in_the_whole_in_proportion_to_its_rows():
    found, counts = noise_in_both(slow=False), np.full((60, 1), float(BLOCK_ROWS))
    np.testing.assert_allclose(found.expected(counts).sum(axis=0), 3.0 * found.products.sum(axis=0), rtol=1e-9)
    assert found.energy()[0, 0] == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize(("loudness", "given"), [(0.5, 0.25), (3.0, 1.0)])
def test_noise_that_a_correction_removed_is_given_back_but_no_more_than_there_is(loudness, given):
    """The residual has white noise of energy one a row."""
    rng, usable = np.random.default_rng(SEED), np.ones((20, BLOCK_ROWS, 1), dtype=np.bool_)
    noise = rng.standard_normal((20, BLOCK_ROWS, 1, 2)).astype(np.float32)
    added = SharedNoise.of(Blocks(np.float32(loudness) * noise, usable), [0])
    plain = Gram.of(Blocks(noise, usable), [0], np.ones(1), added)
    found = plain.with_noise(added.energy())
    more = (found.whole - plain.whole)[0] / (20 * BLOCK_ROWS)
    np.testing.assert_allclose(more, [[0.0, 0.0], [0.0, given]], atol=0.03)
