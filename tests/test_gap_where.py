"""Where a gap lies: chance is told as chance, and what a load alone makes is no gap."""

import numpy as np
import pytest

from cylforce.diagnosis.where import EXCHANGES, chance

SEED, CASES = 11, 1000
FIELD, ORDER = 16, 40  # spans


def drawn(rng, gap=0.0, by_load=0.0, loaded_field=0.5):
    """Log energies of spans: (values, faulty, loaded); what faulty ones have in excess, and loaded ones."""
    faulty = np.arange(FIELD + ORDER) < FIELD
    loaded = rng.uniform(size=len(faulty)) < np.where(faulty, loaded_field, 0.3)
    loaded[[0, 1, -1, -2]] = [True, False, True, False]
    return rng.standard_normal(len(faulty)) + gap * faulty + by_load * loaded, faulty, loaded


@pytest.mark.parametrize(("by_load", "loaded_field"), [(0.0, 0.5), (3.0, 0.8)])
def test_chance_is_told_as_chance(by_load, loaded_field):
    rng = np.random.default_rng(SEED)
    p = np.sort([chance(*drawn(rng, 0.0, by_load, loaded_field), rng) for _ in range(CASES)])
    uniform = (np.arange(CASES) + 0.5) / CASES
    assert np.max(np.abs(p - uniform)) < 1.95 / np.sqrt(CASES)  # Kolmogorov and Smirnov, 0.1 %


def test_a_gap_is_found():
    rng = np.random.default_rng(SEED)
    assert chance(*drawn(rng, gap=3.0), rng) == 1.0 / (1 + EXCHANGES)


def test_less_than_usual_is_no_gap():
    rng = np.random.default_rng(SEED)
    assert chance(*drawn(rng, gap=-3.0), rng) > 0.95


def test_a_gap_within_the_margin_is_none():
    rng = np.random.default_rng(SEED)
    assert chance(*drawn(rng, gap=np.log(2.0)), rng, 10.0) > 0.5
