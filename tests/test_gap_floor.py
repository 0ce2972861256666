"""The noise floor of the diagnosis is what sensor noise makes of the torque, and references predict each other."""

import numpy as np
import pytest

from cylforce.diagnosis.columns.floor import fitted_tares, noise_floor
from cylforce.diagnosis.columns.problem import Problem, looked_at
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.diagnosis.columns.whitening import whitened
from cylforce.diagnosis.inference.search import asked
from cylforce.effects.fault import ForceLaw
from cylforce.effects.library import LIBRARY
from cylforce.estimation.model import FRICTION, Model
from cylforce.programs.common.recorded import chosen
from cylforce.settings.machine_file import load

LAWS = tuple(group for group in LIBRARY if isinstance(group[0], ForceLaw))
REFERENCES = ("reference_static", "reference_moving")
MACHINES = ("machine_1", "machine_4")  # both without the imperfections of a used machine


@pytest.fixture(scope="module", params=MACHINES)
def problem(request):
    """The references of a machine whose declared standard errors are those of its sensors."""
    folder = request.getfixturevalue("shared") / "data/foreign_machines" / request.param
    loaded = load(folder / "machine.toml")
    clean = chosen(loaded, [folder / f"{name}.parquet" for name in REFERENCES], {}).stretches
    model = Model(loaded.service.machine, loaded.service.filters, FRICTION)
    viewer = Viewer(model, fitted_tares(model, clean))
    wanted = asked(model.machine, LAWS)
    known = np.sqrt(np.diag(model.prior.covariance))
    return viewer, Problem(model, known, wanted, looked_at(viewer, clean, wanted), (), tares=viewer.tares)


def rms(left):
    return np.sqrt(np.nanmean(left**2, axis=0))


def test_the_floor_is_what_sensor_noise_makes(problem):
    """As much noise once more, drawn with the declared standard errors and sent through the same filters."""
    viewer, problem = problem
    errors = np.array([s.standard_error for s in problem.model.machine.signals])
    rng, made = np.random.default_rng(1), []
    for seen in problem.clean:
        values = seen.recorded.values
        noisy = seen.recorded._replace(values=values + errors * rng.standard_normal(values.shape))
        made.append(viewer.rows(noisy, ()).left - seen.rows.left)
    assert noise_floor(problem).rms == pytest.approx(rms(np.concatenate(made)), rel=0.1)


def test_a_reference_leaves_of_the_other_what_is_predicted(problem):
    """The floor, and the uncertainty of what was fitted to the one along the columns of the other. Motion predicts
    still postures; the other way round it is not tested, for still postures say little of friction in motion
    (measured: 0.4 to 2.2 of what is predicted)."""
    _, problem = problem
    floor, own = noise_floor(problem), problem.mechanical
    other, columns = (problem.columns(seen) for seen in problem.clean)
    gram, score = np.diag(problem.always[own] ** -2.0), np.zeros(len(own))
    for r, memory in enumerate(floor.memory):
        white = whitened(columns[:, r][:, [*own, -1]], memory) / floor.white[r]
        white = white[np.all(np.isfinite(white), axis=1)]
        gram += white[:, :-1].T @ white[:, :-1]
        score += white[:, :-1].T @ white[:, -1]
    covariance = np.linalg.inv(gram)
    left = other[..., -1] - other[..., own] @ (covariance @ score)
    spread = np.einsum("trk,kl,trl->tr", other[..., own], covariance, other[..., own])
    predicted = np.sqrt(floor.rms**2 + np.nanmean(np.where(np.isfinite(left), spread, np.nan), axis=0))
    assert rms(left) / predicted == pytest.approx(np.ones(len(predicted)), abs=0.3)
