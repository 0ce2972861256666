"""Where a gap lies: chance is told as chance, and what a load alone makes is no gap."""

from types import SimpleNamespace

import numpy as np
import pytest

from cylforce.diagnosis.answer.where import EXCHANGES, REGIMES, SPAN, chance, where
from cylforce.diagnosis.inference.residuals import rms

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


def crossed(seconds=40 * SPAN, gap=0.0):
    """A machine whose first cylinder drives the outer joint and whose second drives the inner one, and what its model
    leaves (T, 2) [N m]: `gap` times as much where the inner joint is far out, or the outer cylinder extends."""
    rng = np.random.default_rng(SEED)
    posture, speed = rng.uniform(-1.0, 1.0, (seconds, 2)), rng.uniform(-0.2, 0.2, (seconds, 2))
    rows = SimpleNamespace(posture=posture, speed=speed, t=np.arange(seconds, dtype=np.float64))
    left = rng.standard_normal((seconds, 2))
    left[:, 0] *= 1.0 + gap * (posture[:, 0] > np.median(posture[:, 0]))
    left[:, 1] *= 1.0 + gap * (speed[:, 0] > 0.0)
    return SimpleNamespace(rows=rows, recorded=SimpleNamespace(load=0.0)), left


def test_a_gap_is_told_in_the_joints_own_posture_and_its_own_cylinders_direction():
    """Where the number of a cylinder is not that of its joint."""
    (clean, unseen), (faulty, left) = crossed(), crossed(gap=3.0)
    links = [SimpleNamespace(name=name) for name in ("inner", "outer")]
    model = SimpleNamespace(machine=SimpleNamespace(rows=(0, 1), links=links), acting=((1,), (0,)))
    problem = SimpleNamespace(model=model, clean=(clean,), faulty=(faulty,))
    size = SimpleNamespace(nominal=[left], clean=[unseen], floor=rms([unseen]))
    spots = {(s.channel, s.regime): s for s in where(problem, size, np.random.default_rng(SEED))}
    for (joint, there), not_there in {
        ("inner", "angle high"): "angle low",
        ("outer", "extending"): "retracting",
    }.items():
        assert spots[joint, there].faulty == pytest.approx(4.0, rel=0.05)
        assert spots[joint, not_there].faulty == pytest.approx(1.0, rel=0.05)
        assert spots[joint, there].share == pytest.approx(1.0, abs=0.05)
    assert spots["outer", "angle high"].faulty == pytest.approx(spots["outer", "angle low"].faulty, rel=0.1)


@pytest.mark.parametrize(
    ("regime", "rows"),
    [
        ("extending", [0, 1]),
        ("retracting", [2, 3]),
        ("slow", [1, 2]),
        ("fast", [0, 3]),
        ("empty", []),
        ("loaded", [0, 1, 2, 3]),
        ("first half", [0, 1]),
        ("second half", [2, 3]),
        ("angle low", [1, 2]),
        ("angle high", [0, 3]),
    ],
)
def test_regimes_are_what_they_are_called(regime, rows):
    """Cylinder 1 at 0.2, 0.01, -0.01, -0.2 m/s; joint 0 at 3, -2, -1, 5 degrees; 500 kg in the bucket."""
    seen = SimpleNamespace(
        rows=SimpleNamespace(
            speed=np.array([[9.0, 0.2], [9.0, 0.01], [9.0, -0.01], [9.0, -0.2]]),
            posture=np.radians([[3.0, 0.0], [-2.0, 1.0], [-1.0, 2.0], [5.0, 3.0]]),
            t=np.arange(4.0),
        ),
        recorded=SimpleNamespace(load=500.0),
    )
    assert np.flatnonzero(REGIMES[regime](seen, 1, 0)).tolist() == rows
