"""A load of which nothing is known is taken off; what it weighs is no noise."""

import numpy as np
import pytest

from cylforce.diagnosis.columns.rows import BLOCK
from cylforce.diagnosis.columns.statistics import White, statistics
from cylforce.diagnosis.inference.discrepancy import Scatter, moments, sums
from cylforce.diagnosis.inference.hypotheses import Inference
from cylforce.diagnosis.inference.sizes import Terms

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
    recording = sums(spread, [statistics([white], [0], np.zeros((1, 2)))])
    hangs = moments([white], [0], spread, [1], max(times, 1.0) * unit)
    scene = Terms(spread, spread, (), 0)
    case = Inference(scene, recording, USUAL, np.zeros(1), np.eye(1), np.zeros(1), moments=hangs)
    found = case.hypothesis((), USUAL)
    assert found.noise.v[0] == pytest.approx(1.0, abs=0.05), f"seed {SEED}"
    assert found.noise.rho[0] < 0.3
