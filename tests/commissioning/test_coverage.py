"""Coverage of postures counts seconds where they belong and names what is missing; the expected weighing error is what
the weighing itself would say."""

from pathlib import Path

import numpy as np
import pytest

from cylforce.commissioning import expectation
from cylforce.commissioning.coverage import BINS, NEEDED_S, Pace, Way, coverage, missing, plan, planes, share
from cylforce.commissioning.expectation import cost, expected_error, postures
from cylforce.estimation.model import Model
from cylforce.estimation.residual import Residual
from cylforce.service.weighing import LoadConstants, LoadEstimator
from cylforce.settings.machine_file import load
from instants import rows_of
from machines import excavator, stick_and_bucket

REST = 0.006
MACHINES = sorted((Path(__file__).resolve().parents[2] / "config").glob("excavator*.toml"))


def middles(wanted):
    """Postures (BINS, N) in the middle of the bins, all joints together."""
    return ((wanted.edges[:, 1:] + wanted.edges[:, :-1]) / 2.0).T


def test_every_second_counts_once_and_where_it_belongs():
    machine = excavator()
    wanted = plan(machine, REST)
    posture = np.repeat(middles(wanted), 10, axis=0)
    fast = np.tile(wanted.fast * 1.5, (len(posture), 1))
    found = coverage(wanted, posture, fast, 0.1)
    np.testing.assert_allclose(found[:, :, Way.EXTENDING, Pace.FAST], 1.0)
    assert found.sum() == pytest.approx(BINS * 3)
    assert coverage(wanted, posture, -fast / 4, 0.1)[:, :, Way.RETRACTING, Pace.SLOW].sum() == pytest.approx(BINS * 3)
    assert coverage(wanted, posture, np.full_like(fast, REST / 2), 0.1).sum() == 0.0
    assert coverage(wanted, np.full_like(posture, np.nan), fast, 0.1).sum() == 0.0
    # beyond the range: the outermost bin
    np.testing.assert_allclose(coverage(wanted, posture + 10.0, fast, 0.1)[:, -1, 0, 1], BINS)


def test_parts_add_up_to_the_whole():
    rng = np.random.default_rng(1)
    wanted = plan(stick_and_bucket(), REST)
    posture, speed = rng.uniform(-2.5, 0.5, (500, 2)), rng.normal(0.0, 0.06, (500, 2))
    parts = sum(coverage(wanted, posture[k : k + 77], speed[k : k + 77], 0.01) for k in range(0, 500, 77))
    np.testing.assert_allclose(parts, coverage(wanted, posture, speed, 0.01))
    moves = np.any(np.abs(speed) > REST, axis=1)
    assert planes(wanted, posture, speed, 0.01).sum() == pytest.approx(0.01 * moves.sum())


def test_what_is_missing_is_named():
    wanted = plan(excavator(), REST)
    enough = np.full_like(wanted.needed, 2.0)
    assert missing(wanted, enough) == ()
    assert share(wanted, enough) == 1.0
    assert share(wanted, enough * 0.0) == 0.0
    enough[1, 2:4, Way.RETRACTING, Pace.SLOW] = 0.25
    enough[0, 0, Way.EXTENDING, Pace.FAST] = 0.0  # asked of nobody
    (gap,) = missing(wanted, enough)
    assert (gap.joint, gap.way, gap.pace) == (1, Way.RETRACTING, Pace.SLOW)
    assert (gap.seconds, gap.needed) == (0.5, 2 * NEEDED_S[0])
    assert (gap.low, gap.high) == (wanted.edges[1, 2], wanted.edges[1, 4])


def test_a_joint_is_covered_by_the_cylinder_that_ends_there():
    machine = excavator()
    assert plan(machine, REST).cylinders == (0, 1, 2)
    narrow = np.tile([-0.1, 0.1], (3, 1))
    np.testing.assert_allclose(plan(machine, REST, narrow).edges[:, [0, -1]], narrow)


@pytest.fixture(params=MACHINES, ids=lambda path: path.stem)
def model(request):
    service = load(request.param).service
    return Model(service.machine, service.filters, service.effects)


def test_expected_error_is_what_the_weighing_itself_says(model):
    """Fed with the very rows of a posture, the weighing ends with the standard error that was foretold."""
    theta = postures(model.machine).theta[3::6, 4::6].reshape(-1, model.machine.size)
    sheet = model.data_sheet
    known = sheet._replace(covariance=1e-4 * sheet.covariance, row_error=0.02 * sheet.row_error, identified=True)
    foretold = expected_error(model, known, theta)
    left = expectation.posture_residual(model, known, theta)
    constants, repeats = (
        LoadConstants(model, known),
        round(expectation.WEIGHED_S * model.filters.rate_hz / expectation.POINTS),
    )
    for k in range(len(theta)):
        load = LoadEstimator.start(constants)
        for point in range(expectation.POINTS):
            of_posture = Residual(*(part[point, k] for part in left))
            now, usable = constants.residual_of_arrays(of_posture), rows_of(np.isfinite(of_posture.variance))
            for _ in range(repeats):
                weight = load.update(now, usable)
        assert weight.standard_error == pytest.approx(foretold.standard_error[k], rel=0.01)
        assert weight.mass == pytest.approx(model.machine.rated_payload, rel=0.05)


def test_what_a_tare_costs_is_what_knowing_it_would_spare(model):
    theta = postures(model.machine).theta[5, 5]
    sheet = model.data_sheet
    told = expected_error(model, sheet, theta)
    spared = told.standard_error**2 - cost(sheet, told) ** 2
    for k in (1, 4):
        known = sheet.covariance - np.outer(sheet.covariance[k], sheet.covariance[k]) / sheet.covariance[k, k]
        better = expected_error(model, sheet._replace(covariance=known), theta)
        # what is known of the tares does not change how the rows are weighted
        assert better.standard_error**2 == pytest.approx(spared[k])


def test_better_tares_weigh_better(model):
    theta, sheet = postures(model.machine).theta, model.data_sheet
    better = expected_error(model, sheet._replace(covariance=sheet.covariance / 100.0), theta)
    worse = expected_error(model, sheet, theta)
    assert np.all(better.standard_error[np.isfinite(better.standard_error)] > 0.0)
    assert np.nanmedian(better.standard_error) < 0.8 * np.nanmedian(worse.standard_error)
