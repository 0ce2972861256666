"""The study of layers that decide: its likelihood is the textbook's, its search finds what was put in, and no more."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from layers.answers import NOTHING, UNKNOWN, Answer, Asked, calibrated, selected
from layers.bayes import Case, Machine, learnt
from layers.discrepancy import DECAY, Noise, Sums, likeliest, moments, sums
from layers.intervals import wilson
from layers.sizes import BEYOND, log_size
from layers.statistics import SMOOTH, Column, Scene, Statistics, one_way

ROWS, BLOCKS, JOINTS, COUNT = 60, 40, 2, 4  # rows of a block, blocks, joints, columns
PARTS = (Column("one", "a", (2,), 0.2, 8.0, 0, 1), Column("two", "b", (3,), 0.2, 8.0, 0, 1))
SCENE = Scene(
    2, np.array([1.0, 1.0, 0.2, 0.2]), np.array([1.0, 1.0, 4.0, 4.0]), np.full(1, 5.0), PARTS, np.ones(JOINTS)
)


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


def told(rows):
    """Statistics of rows; at single moments there may be one force."""
    waves = np.broadcast_to(WAVE[None, :, :, None], (BLOCKS, JOINTS, ROWS, 1))
    return Statistics(
        whole=np.einsum("brti,brtj->rij", rows, rows),
        smooth=np.einsum("tk,brti->brki", basis(), rows),
        rows=np.full((BLOCKS, JOINTS), float(ROWS)),
        across=np.einsum("brti,brtj->brij", waves, rows),
        within=np.einsum("brti,brtj->brij", waves, waves),
        waves=np.einsum("tk,brti->brki", basis(), waves),
        crossed=np.zeros((JOINTS, COUNT + 1)),
    )


@pytest.fixture(scope="module")
def machine():
    return Machine(SCENE, (sums(SCENE, [told(recording(1))]), sums(SCENE, [told(recording(2))])), {})


def answer(machine, rows):
    each = told(rows)
    return selected(Asked.of(machine.asked(sums(SCENE, [each])), moments(SCENE, each)))


def test_the_likelihood_is_that_of_the_whole_covariance():
    """Against scipy's density of all rows at once, parameters integrated out."""
    rows, noise = recording(3)[:2], Noise(np.array([0.7, 2.0]), np.array([1.1, 0.8]))
    two = told(np.concatenate([rows, np.zeros((BLOCKS - 2, *rows.shape[1:]))]))
    two = two._replace(rows=np.where(np.arange(BLOCKS)[:, None] < 2, float(ROWS), 0.0) * np.ones(JOINTS))
    plain = SCENE._replace(spread=np.ones(COUNT))
    prior = np.diag([1.0, 2.0, 0.5, 0.1])
    case = Case(plain, sums(plain, [two]), noise, np.array([0.2, 0.0, 0.0, 0.1]), prior)
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
    found = sums(SCENE, [told(recording(4, rho=6.0, v=1.3))])
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


@pytest.mark.parametrize(("blocks", "first"), [(8, ("soil_contact", "bucket")), (32, UNKNOWN)])
def test_a_force_at_moments_is_contact_and_all_the_time_it_is_work(machine, blocks, first):
    rows = recording(9)
    rows[:blocks, ..., -1] += np.random.default_rng(9).normal(0.0, 6.0, (blocks, 1, 1)) * WAVE
    assert answer(machine, rows).first == first


def test_everyday_differences_are_learnt(machine):
    rng = np.random.default_rng(0)
    seen = [(machine, sums(SCENE, [told(recording(10 + k, sizes=(0.0, rng.normal(0.0, 0.4))))])) for k in range(12)]
    found = learnt(seen, 30)
    assert found["two"] == pytest.approx(2.0, rel=0.4)  # of the least plausible size, 0.2
    assert found["one"] < 0.6


def test_sensor_noise_in_both_is_taken_off():
    """Errors in variables: without it, least squares tend to the solution that cancels the noise."""
    found = Sums(
        np.zeros((1, 2, 2)), np.zeros((1, SMOOTH, 2, 2)), np.full(1, 100.0), np.full(1, 2.0), np.array([[30.0, 0.0]])
    )
    noise = Noise(np.full(1, 1e-9), np.full(1, 2.0))
    assert found.score(np.array([[5.0, 42.0], [42.0, 9.0]]), noise) == pytest.approx([12.0])


def test_calibration_learns_on_other_machines_only():
    """A group that is always wrong where all others are right does not know it."""
    rows = [
        (Answer({("one", "a"): 0.99, NOTHING: 0.01}, (float(k % 3),)), g != 0, g) for g in range(5) for k in range(6)
    ]
    again = calibrated(rows, [True] * len(rows))
    assert all(a.probability > 0.8 for a, (_, _, g) in zip(again, rows, strict=True) if g == 0)
    assert all(sum(a.of.values()) == pytest.approx(1.0) for a in again)


def test_friction_that_is_larger_one_way_is_half_a_change_and_half_an_asymmetry():
    dry, uneven = (
        Column("coulomb_friction", "c", (0,), 200.0, 2e4, 0, 1),
        Column("asymmetric_friction", "c", (1,), 100.0, 1800.0, 0, 1),
    )
    scene = SCENE._replace(always=np.ones(2), spread=np.ones(2), proposals=(dry, uneven))
    more, made = one_way(scene)
    v = np.linspace(-1.0, 1.0, 9)
    columns = np.stack([np.sign(v), np.abs(np.sign(v)), v], axis=-1) @ made  # the last one is what is left
    assert columns[:, :2] == pytest.approx(np.stack([np.sign(v), np.abs(np.sign(v))], axis=-1))
    assert columns[:, 2] == pytest.approx(np.where(v > 0.0, 1.0, 0.0))
    assert columns[:, 3] == pytest.approx(np.where(v < 0.0, -1.0, 0.0))
    assert columns[:, -1] == pytest.approx(v)
    assert [(p.name, p.columns, p.low) for p in more.proposals[2:]] == [
        (uneven.name, (2,), 200.0),
        (uneven.name, (3,), 200.0),
    ]


def test_intervals_are_wilsons():
    assert wilson(8, 10) == pytest.approx((0.490, 0.943), abs=1e-3)
    assert wilson(0, 0) == (0.0, 1.0)
