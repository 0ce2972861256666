"""Slow adaptation: it follows what the empty machine in motion shows, freezes otherwise, and stays within bounds."""

from types import SimpleNamespace

import numpy as np
import pytest

from cylforce.commissioning.identification import identify
from cylforce.estimation.model import BetweenStrokes, Model
from cylforce.files.checkpoint import packed
from cylforce.programs.common.readings import model_of, recorded_segments
from cylforce.programs.sim import run_sim
from cylforce.service.adaptation import FRICTION_RANGE, DriftConstants, DriftFilter
from cylforce.settings.machine_file import load
from instants import ALL, NONE, unexplained_of
from scenarios import EXCAVATOR, moved
from studies.parked import rows_of

SURE = np.full(3, 100.0**2)


@pytest.fixture(scope="module")
def bench():
    """An adapter and rows (columns, torque) of half a minute of moves."""
    loaded = load(EXCAVATOR)
    model = Model(loaded.service.machine, loaded.service.filters, ("coulomb", "viscous"))
    values = model.data_sheet.values.copy()
    for k, p in enumerate(model.parameters):
        values[k] = {"coulomb": 3e3, "viscous": 1e4}.get(p.name.partition(".")[2], values[k])
    constants = DriftConstants(model, model.data_sheet._replace(values=values, identified=True))
    rows = model.filtered.run(model.channels.run(moved(loaded, seconds=30.0)).motion)
    return SimpleNamespace(constants=constants, columns=rows.columns[model.settle_steps :])


def columns_of(constants, columns):
    """Columns (..., D) of the adapted parameters."""
    return columns[..., constants.model.changing]


def adapted(bench, true, drift=None):
    """The drift after all rows, when what is not explained by the tares is that of `true` (D,)."""
    drift = DriftFilter.start(bench.constants) if drift is None else drift
    for columns in bench.columns:
        torque = columns_of(bench.constants, columns) @ (true - drift.values)
        drift.update(unexplained_of(columns, torque, SURE), ALL)
    return drift


def true_drift(constants):
    """Friction falls by a fifth, the boom's pressures read half a bar too much."""
    friction = -0.2 * np.array([3e3] * 3 + [1e4] * 3)
    return np.concatenate([friction, [0.5e5 * constants.model.machine.cylinders[0].area_head, 0.0, 0.0]])


def test_it_follows_what_motion_shows(bench):
    """After a minute, two memories, less than a fifth of the friction's torque is left; it is told in kilograms."""
    true = true_drift(bench.constants)
    true[6:] = 0.0  # a pressure zero looks like a load, and what remains in the bucket is not known
    drift = adapted(bench, true, adapted(bench, true))
    columns = columns_of(bench.constants, bench.columns)
    left, whole = (np.sqrt(np.mean((columns @ v) ** 2)) for v in (true - drift.values, true))
    assert left < whole / 5.0
    assert drift.mass != 0.0


def test_it_is_frozen_when_not_told_and_at_rest(bench):
    """Loaded, touching or parked: not one bit changes but the word that it follows."""
    drift = adapted(bench, true_drift(bench.constants))
    moving = bench.columns[500]
    parked = bench.columns[500].copy()
    model = bench.constants.model
    parked[:, model.at_rest], parked[:, model.coulomb] = np.abs(parked[:, model.coulomb]), 0.0
    for columns, usable in ((moving, NONE), (parked, ALL)):
        drift.following = False
        before = packed(drift.snapshot())
        drift.update(unexplained_of(columns, np.full(3, 5e3), SURE), usable)
        assert packed(drift.snapshot()) == before


def test_it_stays_within_what_is_physical(bench):
    """No friction below a tenth or above ten times the reference, no zero beyond six bar."""
    reference = np.array([3e3] * 3 + [1e4] * 3)
    low, high = (FRICTION_RANGE[0] - 1.0) * reference, (FRICTION_RANGE[1] - 1.0) * reference
    zero = 6e5 * np.array([c.area_head for c in bench.constants.model.machine.cylinders])
    for sign in (-1.0, 1.0):
        drift = adapted(bench, sign * 30.0 * np.abs(true_drift(bench.constants)))
        assert np.all(drift.values[:6] >= low)
        assert np.all(drift.values[:6] <= high)
        assert np.all(np.abs(drift.values[6:]) <= zero)


def test_what_one_friction_tells_of_the_oil_holds_for_the_others(bench):
    """The bucket's cylinder alone moves, with twice its friction: the boom's has risen about as much then, less
    certainly; did frictions differ each by itself, it would stay as it was."""
    model, tares = bench.constants.model, bench.constants.tares
    true = np.concatenate([[0.0, 0.0, 3e3, 0.0, 0.0, 1e4], np.zeros(3)])
    told = {}
    for strokes in (None, BetweenStrokes(0.25, 1e4)):
        alone = DriftConstants(model, tares, strokes)
        drift = DriftFilter.start(alone)
        for columns in bench.columns:
            own = columns.copy()
            own[:2] = 0.0
            torque = columns_of(alone, own) @ (true - drift.values)
            drift.update(unexplained_of(own, torque, SURE), ALL)
        told[strokes] = drift
    reference = np.array([3e3] * 3 + [1e4] * 3)
    alike, apart = (drift.values[:6] / reference for drift in told.values())
    assert apart[3] == pytest.approx(0.0, abs=0.05)
    assert 0.5 * alike[5] < alike[3] < 1.5 * alike[5]
    errors = np.sqrt(np.diagonal(told[None].covariance))[:6] / reference
    assert errors[3] > errors[5]


def mass_of(bench, values):
    """What a drift is worth as a load in the bucket [kg], over all rows."""
    columns = columns_of(bench.constants, bench.columns)
    model = bench.constants.model
    load = bench.columns[..., : len(model.parameters)] @ model.load
    flat = load.reshape(-1, 4)
    return np.linalg.lstsq(flat, (columns @ values).ravel(), rcond=None)[0][0]


def after_returns(bench, amounts, zero=0.0):
    """The drift after returns with these amounts [kg] in the bucket, with pressures that read `zero` [Pa] too much."""
    model, drift = bench.constants.model, DriftFilter.start(bench.constants)
    own, true = len(model.parameters), np.zeros(len(drift.values))
    true[6:] = zero * np.array([c.area_head for c in model.machine.cylinders])
    for kilograms, part in zip(amounts, np.array_split(bench.columns, len(amounts)), strict=True):
        drift.pause()
        sticks = model.load @ (kilograms * np.array([1.0, 0.7, 0.1, 0.5]))
        for columns in part:
            left = columns[:, :own] @ sticks + columns_of(bench.constants, columns) @ (true - drift.values)
            drift.update(unexplained_of(columns, left, SURE), ALL)
    return drift.values - true


@pytest.mark.parametrize("mean", [0.0, 10.0])
def test_what_sticks_in_the_bucket_is_not_taken_for_a_drift(bench, mean):
    """Ten returns, clean or with 3 to 17 kg in the bucket, another amount every time: less than 1 kg is followed."""
    assert abs(mass_of(bench, after_returns(bench, mean * np.linspace(1 / 3, 5 / 3, 10)))) < 1.0


def test_the_usual_amount_is_wrong_once_and_not_at_every_return(bench):
    """18 kg stick in every return, four times the mean that is expected. Twenty returns of three seconds each leave no
    larger error than five, and less than a kilogram."""
    five = SimpleNamespace(constants=bench.constants, columns=bench.columns[: len(bench.columns) // 2])
    twenty = SimpleNamespace(constants=bench.constants, columns=np.tile(bench.columns, (2, 1, 1)))
    few, many = (mass_of(bench, after_returns(work, np.full(n, 18.0))) for work, n in ((five, 5), (twenty, 20)))
    assert abs(many) <= abs(few)
    assert abs(many) < 1.0


def test_zeros_are_not_taken_for_what_sticks_in_the_bucket(bench):
    """Half a bar on each cylinder, 20 kg either way, beside 3 to 17 kg: less than a third of it is left."""
    left = [mass_of(bench, after_returns(bench, np.linspace(3.0, 17.0, 10), zero)) for zero in (5e4, -5e4)]
    assert np.abs(left).max() < 20.0 / 3.0


def test_an_unseen_drift_keeps_its_prior_error(bench):
    """Nothing is known before the first motion; afterwards friction is known better than before."""
    begun = DriftFilter.start(bench.constants)
    after = adapted(bench, 0.0 * true_drift(bench.constants))
    assert np.all(np.diag(after.covariance)[:6] < 0.5 * np.diag(begun.covariance)[:6])


def test_what_no_motion_shows_is_not_known_better_for_being_waited_for(bench):
    """Two minutes of motion in which nothing depends on the bucket's zero: its error stays, but for what the two other
    zeros tell of their kind; with k^2 = (1 + 0 + 0 + k^2) / (1 + 3) at least a third of its variance."""
    begun, hidden = DriftFilter.start(bench.constants), bench.constants.model.changing[-1]
    blind, drift = bench.columns.copy(), DriftFilter.start(bench.constants)
    blind[..., hidden] = 0.0
    for columns in np.tile(blind, (4, 1, 1)):
        drift.update(unexplained_of(columns, np.zeros(3), SURE), ALL)
    assert 0.333 < drift.covariance[-1, -1] / begun.covariance[-1, -1] <= 1.0


def test_the_study_of_standing_still_takes_drifts_in_units_of_their_prior(tmp_path):
    """A column of the study is the torque by one prior standard error, over the row's error."""
    loaded, log = load(EXCAVATOR), tmp_path / "moves.log"
    run_sim(EXCAVATOR, scenario="moves", seed=1, duration=60.0, log=log)
    found = identify(model_of(loaded), recorded_segments(loaded, log), refuse=False)
    constants = DriftConstants(found.model, found.tares)
    data, begun = rows_of(loaded, constants, found.tares, log), DriftFilter.start(constants)
    assert data.columns.shape[1:] == (3, begun.values.size)
    zero = found.model.changing.tolist().index(found.model.zero.start)
    lever = np.abs(data.columns[:, 0, zero]) * found.tares.row_error[0] / np.sqrt(begun.covariance[zero, zero])
    boom = loaded.service.machine.cylinders[0]
    assert 0.2 < lever.min() < lever.max() < boom.length_high


def test_what_a_moment_of_empty_motion_tells_is_no_measurement(bench):
    """Three seconds, as long as model errors keep their sign, are one; without adaptation none is waited for."""
    assert adapted(bench, np.zeros(9)).returned
    begun = DriftFilter.start(bench.constants)
    assert not begun.returned
    begun.informed, begun.updates = True, 1
    begun.pause()
    assert not begun.returned
    known = DriftConstants(bench.constants.model, bench.constants.tares, BetweenStrokes(0.05, 1e4))
    assert DriftFilter.start(known).returned
