"""What is taken out of the readings takes some of the sensors' noise with it, and that is no evidence."""

import numpy as np
import pytest

from cylforce.diagnosis.columns.correction import Applied
from cylforce.diagnosis.columns.floor import noise_floor
from cylforce.diagnosis.columns.problem import Problem, looked_at
from cylforce.diagnosis.inference.asking import Asking, noisy
from cylforce.diagnosis.inference.search import asked
from cylforce.effects.library import LIBRARY
from gap_scene import MACHINE, as_it_was, recordings

SIZE = 1e-3
PLACES = ("boom_head_pressure", "stick_head_pressure", "bucket_rod_pressure")
OWN = tuple(group for group in LIBRARY if group[0].about.name == "pressure_gain")


@pytest.fixture(scope="module")
def asking() -> Asking:
    """A machine in order: one recording of it, and another one as its field."""
    viewer = as_it_was().viewer
    wanted, recorded = asked(MACHINE, OWN), recordings(1)
    clean, faulty = looked_at(viewer, recorded[:1], wanted), looked_at(viewer, recorded[1:2], wanted)
    known = np.sqrt(np.diag(viewer.model.prior.covariance))
    problem = Problem(viewer.model, known, wanted, clean, faulty, tares=viewer.tares)
    floor = noise_floor(problem)
    return Asking(viewer, problem, floor, noisy(viewer, problem, floor, np.random.default_rng(1)))


def shared(asking: Asking, column: int) -> np.ndarray:
    """What columns of the field and what is left have in common (R,) per row; the last one: its
    noise."""
    found = asking.noisy.faulty[0]
    return np.sum(found.products[:, :, 0, column], axis=0) / np.sum(found.rows, axis=0)


def test_with_nothing_taken_out_the_noise_is_what_it_was(asking):
    assert asking.noise_without(())[:, 0] == pytest.approx(shared(asking, -1), rel=0.02)


@pytest.mark.parametrize("at", PLACES)
def test_a_small_size_takes_away_what_its_column_shares(asking, at):
    """y' = y - X s, so that the energy of the noise in y' changes by -2 s cov(X, y)."""
    proposal, column = next(
        (p, places[0]) for p, places in zip(asking.problem.proposals, asking.problem.places, strict=True) if p.at == at
    )
    more, less = (asking.noise_without([Applied(proposal, np.array([sign * SIZE]))]) for sign in (1.0, -1.0))
    slope, told = (more - less)[:, 0] / (2.0 * SIZE), -2.0 * shared(asking, column)
    assert np.max(np.abs(told)) > 0.0
    assert np.max(np.abs(slope - told)) < 0.1 * np.max(np.abs(told))
