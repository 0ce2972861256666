"""Rows of a recording: the column of an effect is what the simulated machine shows of it, and what is switched on in
the model goes from the residual."""

from dataclasses import replace
from functools import cache
from math import radians

import numpy as np
import pytest

from cylforce.diagnosis.model import NOISE_S, ColumnLayout, fitted_parameters
from cylforce.diagnosis.regressors import Regressors, courses
from cylforce.effects.fault import SHAPES, Alteration, Distortion, TimeCourse
from cylforce.effects.friction.presliding_hysteresis import PreslidingHysteresis
from cylforce.effects.friction.stribeck import Stribeck
from cylforce.effects.imposed import distorted, undistorted
from cylforce.effects.library import LIBRARY, Proposal, proposals
from cylforce.estimation.model import FRICTION, Model
from cylforce.estimation.regressor import FilteredRegressor, Regressor
from cylforce.mechanics.installation import Filters
from cylforce.readings.constants import BLOCK_ROWS, ROWS_HZ
from cylforce.readings.recording import Recording
from cylforce.signals.kinds import Kind, Signal
from diagnosis.scenes import MACHINE, RATE_HZ, SERVICE, effect, recorded
from machines import excavator, stick_and_bucket

LOAD_KG = 600.0
SECONDS = 40.0


@cache
def regressors():
    """The model with the parameters of a recording without noise, empty and loaded."""
    model = Model(MACHINE, SERVICE.filters, FRICTION)
    seen = [recorded(1, noise=False, seconds=SECONDS), recorded(2, noise=False, seconds=SECONDS, load_kg=LOAD_KG)]
    return Regressors(model, fitted_parameters(model, seen))


def recording(*effects, load_kg=0.0):
    """A recording without noise, always of the same motion."""
    return recorded(3, *effects, noise=False, seconds=SECONDS, load_kg=load_kg)


# Name, place, sizes, shape, and what of the change the column may lack (rms): the law of a force is exact, an error of
# sensors or of geometry is linear while it is small.
CASES = [
    ("coulomb_friction", "stick", 300.0, {}, 0.02),
    ("viscous_friction", "bucket", 2e3, {}, 0.01),
    ("stribeck", "stick", 300.0, {"width": 0.015}, 0.02),
    ("load_dependent_friction", "stick", 0.01, {"easing": 0.0}, 0.02),
    ("asymmetric_friction", "stick", 300.0, {"way": 1}, 0.01),
    ("asymmetric_friction", "bucket", -300.0, {"way": -1}, 0.01),
    ("presliding_hysteresis", "stick", 300.0, {"way": 0.003}, 0.12),  # its bend at creep depends on the rate
    ("friction_temperature_drift", "machine", -0.3, {"settling": 300.0}, 0.07),  # a share of the fitted friction
    ("friction_temperature_drift", "stick", -0.3, {"settling": 900.0, "alone": True}, 0.05),
    ("friction_level_change", "stick", 0.1, {}, 0.05),
    ("return_line_loss", "stick", [2e4, 1e4], {"power": 2.0}, 0.02),
    ("pin_friction", "stick", 0.002, {}, 0.05),
    ("counterbalance_pressure", "stick", 2e3, {}, 0.02),
    ("end_cushion", "bucket", 3e3, {"length": 0.15, "end": 0}, 0.01),
    ("pressure_offset", "stick_head_pressure", 4e4, {}, 0.01),
    ("pressure_gain", "stick_rod_pressure", 0.005, {}, 0.01),
    ("pressure_drift", "bucket_head_pressure", 2e6, {"fading": 0.0}, 0.01),
    ("pressure_zero_settling", "stick_head_pressure", 1e5, {"settling": 60.0}, 0.01),
    ("pressure_sensor_hysteresis", "stick_rod_pressure", 1e5, {"opening": 30e5}, 0.05),
    ("angle_offset", "stick_angle", 0.003, {}, 0.05),
    ("angle_scale", "stick_angle", 0.003, {"right": 0.0}, 0.05),
    ("encoder_eccentricity", "stick_angle", [0.003, 0.003], {}, 0.05),
    ("sensor_delay", "stick_angle", 0.005, {}, 0.05),
    ("soft_ground", "machine", 1e-8, {"height": 2.0}, 0.1),
    ("tilt_ignored", "machine", [0.005, 0.003], {}, 0.05),
    ("linkage_geometry", "bucket", [0.002, 0.002], {"part": 0}, 0.05),
    ("extra_mass", "stick", [30.0, 40.0, 10.0, 50.0], {}, 0.02),
    ("first_moment_change", "bucket", [20.0, 10.0, 10.0], {}, 0.02),
    ("mud", "bucket", [100.0, 0.0, 0.0], {"slowing": 0.005}, 0.02),
    ("hose_spring", "stick", 400.0, {"rest": 0.0, "cubic": False}, 0.01),
    ("compliance", "stick", 2e-8, {"stiffening": 0.0}, 0.05),
    ("ringing_compliance", "stick", 5e-8, {"frequency": 4.0}, 0.05),
    ("backlash", "stick", 0.004, {"falling": 0.04}, 0.4),  # when it falls is decided by readings that hold the fall
]


@pytest.mark.parametrize(("name", "at", "value", "shape", "lacking"), CASES)
def test_the_simulated_machine_shows_the_column_of_an_effect(name, at, value, shape, lacking):
    own = effect(name, at, value, shape=shape)
    wanted = [Proposal(own.group, at, own.where)]
    before, after = (regressors().rows(each, wanted) for each in (recording(), recording(own)))
    expected, seen = after.effects @ np.array(own.sizes), after.residual - before.residual
    good = np.isfinite(seen)
    off = np.sqrt(np.mean((seen - expected)[good] ** 2) / np.mean(seen[good] ** 2))
    assert off < lacking, f"{off:.3f} of {np.sqrt(np.mean(seen[good] ** 2)):.1f} N m"


NOT_HERE = {
    "intermittent_glitch",
    "boom_motion",
}  # jumps are found in the readings; a base that moves is tested by itself


def test_every_effect_of_the_library_that_lasts_has_its_case():
    lasting = {g[0].about.name for g in LIBRARY if not Proposal(g, "", 0).course}
    assert lasting - {name for name, *_ in CASES} == NOT_HERE


# Errors of sensors and of drawings, of which only what changes is computed


FILTERS = Filters(100.0, 5.0, 2.0, 2.0, 0.002)
BEGINS_S = 100.0
SWINGS = {Kind.HEAD_PRESSURE: (9e6, 4e6), Kind.ROD_PRESSURE: (3e6, 1e6), Kind.PITCH: (0.02, 0.02)}
SWINGS |= {Kind.ROLL: (0.01, 0.02), Kind.SLEW_RATE: (0.1, 0.4)}


def inclined():
    """Stick and bucket with sensors of the stick's inclination and of the bucket cylinder's length."""
    machine = stick_and_bucket()
    others = {
        "stick_angle": Signal("stick_slope", Kind.LINK_INCLINATION, 0, -3.2, 3.2, 0.01, radians(0.01)),
        "bucket_angle": Signal("bucket_length", Kind.CYLINDER_LENGTH, 1, 0.5, 4.0, 0.01, 1e-4),
    }
    return replace(machine, signals=tuple(others.get(s.name, s) for s in machine.signals))


def readings(machine, seconds=8.0):
    """Return smooth samples (T, S) within the range of every sensor; they need not be those of any motion."""
    rng, t = np.random.default_rng(5), np.arange(seconds * FILTERS.rate_hz) / FILTERS.rate_hz
    middle = np.array([(link.angle_low + link.angle_high) / 2.0 for link in machine.links])
    theta = middle + np.stack([0.3 * np.sin((0.9 + 0.4 * j) * t + j) for j in range(machine.size)], axis=-1)
    columns = []
    for s in machine.signals:
        if s.kind is Kind.CYLINDER_LENGTH:
            columns.append(machine.geometry(theta).length[:, s.index])
        elif s.kind is Kind.LINK_INCLINATION:
            columns.append(theta[:, : s.index + 1].sum(axis=1))
        elif s.kind is Kind.JOINT_ANGLE:
            columns.append(theta[:, s.index])
        else:
            offset, swing = SWINGS[s.kind]
            columns.append(offset + swing * np.sin(rng.uniform(0.5, 3.0) * t + rng.uniform(0.0, 6.0)))
    return np.stack(columns, axis=-1)


def whole_residual(own, values, machine):
    """Return the residual (T', R) of a whole model of a machine."""
    model = replace(own.slow, machine=machine)
    f, moved = model.filters, model.channels.run(own.thinned(values))
    regressor = Regressor(machine, model.empty.effects)
    rows = FilteredRegressor(regressor, 1.0 / f.rate_hz, f.regressor_hz, f.smoothing_hz).run(moved.motion)
    return rows.torque - rows.columns @ own.parameters


def central_difference(own, fault, where, values):
    """Return the column (T', R) of a fault by two evaluations of the whole model."""
    step, machine = np.sqrt(fault.about.low * fault.about.high), own.model.machine
    if isinstance(fault, Distortion):
        t = BEGINS_S + np.arange(len(values)) / FILTERS.rate_hz
        more, less = (
            whole_residual(own, fault.distorted(own.weighed, values, t, where, sign * step), machine)
            for sign in (1.0, -1.0)
        )
    else:
        less, more = (whole_residual(own, values, fault.altered(machine, where, sign * step)) for sign in (1.0, -1.0))
    return (more - less) / (2.0 * step)


@pytest.mark.parametrize("made", [excavator, stick_and_bucket, inclined])
def test_the_column_of_a_sensor_or_a_drawing_is_the_central_difference_of_the_residual(made):
    machine = made()
    model = Model(machine, FILTERS, FRICTION)
    own = Regressors(model, model.prior.mean + 0.3 * np.sqrt(np.diag(model.prior.covariance)))
    values = readings(machine)
    every = [p for p in proposals(machine) if isinstance(p.group[0], Distortion | Alteration)]
    wanted = list({(p.name, p.at, len(p.shape)): p for p in every}.values())  # one form of each effect at each place
    found = own.rows(Recording("made", values, 0.0, BEGINS_S), wanted).effects
    expected = [central_difference(own, e, p.where, values) for p in wanted for e in p.group]
    shown = [np.nan_to_num(c[own.slow.settle_steps :]) for c in expected]
    assert found.shape[-1] == len(expected) > 15
    assert sum(bool(np.any(c)) for c in shown) > 15
    for k, column in enumerate(shown):
        np.testing.assert_allclose(found[..., k], column, rtol=0.0, atol=1e-6 * np.max(np.abs(column)))


# Effects switched on in the model


BLOCKS = {
    "force law": {"name": "coulomb_friction", "at": "stick", "value": 4000.0},
    "share of friction": {"name": "friction_level_change", "at": "stick", "value": 0.5},
    "pressure": {"name": "pressure_gain", "at": "stick_head_pressure", "value": 0.04},
    "angle": {"name": "angle_offset", "at": "stick_angle", "value": 0.03},
    "delay": {"name": "sensor_delay", "at": "bucket_angle", "value": 0.08},
    "tilt": {"name": "tilt_ignored", "at": "machine", "value": [0.04, 0.02]},
    "geometry": {"name": "linkage_geometry", "at": "stick", "value": [0.03, 0.01], "shape": {"part": 1}},
    "flexibility": {"name": "compliance", "at": "stick", "value": 6e-7},
    "weight": {"name": "first_moment_change", "at": "stick", "value": [400.0, 100.0, 200.0]},
    "contact": {"name": "soil_contact", "at": "bucket", "value": [4e3, 8e3], "begin": 15.0, "end": 25.0},
    "spill": {"name": "payload_spill", "at": "bucket", "value": [-300.0, -300.0, -50.0], "begin": 18.0},
    "clock": {"name": "clock_fault", "at": "machine", "value": [0.08, 0.0], "begin": 15.0},
}
ONE_SIGN = {"delay", "spill", "flexibility"}  # whose other sign the simulated machine refuses
NOISE_SEED = 4


def block(kind, factor=1.0, later=0.0):
    """Return the effect of a kind with its sizes times a factor."""
    given = dict(BLOCKS[kind])
    given["value"] = (factor * np.array(given["value"])).tolist()
    if "begin" in given:
        given["begin"] += later
    return effect(given.pop("name"), given.pop("at"), given.pop("value"), **given)


def loaded(*effects):
    """A recording with noise and a known load."""
    return recorded(NOISE_SEED, *effects, seconds=SECONDS, load_kg=LOAD_KG)


@cache
def carried():
    """Mass, first moments and inertia of the load, by least squares of a healthy recording."""
    rows, model = regressors().rows(loaded(), ()), regressors().model
    columns, scale = rows.base @ model.load, np.sqrt(np.nanmean(rows.residual**2, axis=0))
    good = np.isfinite(rows.residual)
    rest = ((rows.residual - columns[..., 0] * LOAD_KG) / scale)[good]
    return np.array([LOAD_KG, *np.linalg.lstsq((columns[..., 1:] / scale[:, None])[good], rest, rcond=None)[0]])


def without_load(rows):
    return rows.residual - rows.base @ regressors().model.load @ carried()


@cache
def healthy_floor():
    return np.nanmean(without_load(regressors().rows(loaded(), ())) ** 2, axis=0)


def floors(seen, *switched_on):
    """Return the residual of a recording as a machine with effects explains it, in noise floors (rms of joints)."""
    rows = regressors().simulated(seen, regressors().rows(seen, ()), switched_on, carried())
    return float(np.sqrt(np.mean(np.nanmean(without_load(rows) ** 2, axis=0) / healthy_floor())))


@pytest.mark.parametrize("kind", BLOCKS)
def test_an_effect_without_size_changes_nothing(kind):
    rows = regressors().rows(loaded(), ())
    found = regressors().simulated(loaded(), rows, [block(kind, 0.0)], carried())
    np.testing.assert_allclose(found.residual, rows.residual, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(found.base, rows.base, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", BLOCKS)
def test_the_block_of_a_fault_leaves_the_noise_floor_and_a_wrong_one_does_not(kind):
    """Half of it, its opposite, or another time leave more."""
    own, seen = block(kind), loaded(block(kind))
    fault, right = floors(seen), floors(seen, own)
    assert fault > 2.0
    assert right < 1.0 + 0.1 * (fault - 1.0)
    assert right < floors(seen, block(kind, 0.5)) < fault
    if kind not in ONE_SIGN:
        assert floors(seen, block(kind, -1.0)) > fault
    if own.begin:
        assert floors(seen, block(kind, later=5.0)) > right + 0.1 * (fault - 1.0)


def test_readings_freed_of_an_error_are_distorted_into_what_was_recorded():
    """To the second order of the errors."""
    values = loaded().values
    t = np.arange(len(values)) / RATE_HZ
    effects = [block(kind) for kind in ("pressure", "angle", "tilt", "flexibility")]
    again = distorted(MACHINE, effects, undistorted(MACHINE, effects, values, t), t)
    moved = np.abs(distorted(MACHINE, effects, values, t) - values).max(axis=0)
    assert np.all(np.abs(again - values).max(axis=0) <= 0.01 * moved)


# The rest of the rows


def test_rows_come_at_their_rate_and_time_since_the_start_of_the_file():
    rows = regressors().rows(replace(loaded(), begins_s=100.0), ())
    assert regressors().rows_hz == ROWS_HZ
    np.testing.assert_allclose(np.diff(rows.t), 1.0 / ROWS_HZ)
    settled = regressors().slow.settle_steps / ROWS_HZ
    assert rows.t[0] == pytest.approx(100.0 + settled, abs=1.0 / ROWS_HZ)
    assert len(rows.t) / ROWS_HZ == pytest.approx(SECONDS - settled, abs=2.0 / ROWS_HZ)


def test_the_residual_alone_is_that_of_the_rows_without_the_known_mass():
    rows = regressors().rows(loaded(), ())
    alone = regressors().residual(loaded(), np.isnan(rows.residual))
    expected = rows.residual - (rows.base @ regressors().model.load)[..., 0] * LOAD_KG
    assert alone == pytest.approx(expected, abs=1e-6, nan_ok=True)


def test_the_first_rows_are_the_rows_of_the_beginning():
    rows = regressors().rows(loaded(), ())
    first = rows.first(50)
    for name in ("base", "residual", "t", "speed", "posture"):
        np.testing.assert_array_equal(getattr(first, name), getattr(rows, name)[:50])


def test_courses_of_an_incident_are_orthogonal_with_mean_square_one():
    found = courses((np.arange(2000) + 0.5) / 2000)
    np.testing.assert_allclose(found @ found.T / 2000, np.eye(SHAPES), atol=1e-4)


def test_an_incident_has_columns_of_its_course_in_every_block():
    """A steady force at the teeth is the first course alone; the simulated machine shows its column."""
    push = effect("soil_contact", "bucket", [4e3, 8e3])
    before, after = (regressors().rows(each, ()) for each in (recording(), recording(push)))
    layout = ColumnLayout(regressors().model, proposals(MACHINE))
    contact = next(p for p in layout.proposals if p.name == "soil_contact")
    own = [k - layout.size for k in layout.incident(contact)[:2]]
    expected, seen = after.incidental[..., own] @ np.array([4e3, 8e3]), after.residual - before.residual
    good = np.isfinite(seen)
    assert contact.course is TimeCourse.WINDOWS
    assert np.sqrt(np.mean((seen - expected)[good] ** 2) / np.mean(seen[good] ** 2)) < 0.02
    later = [k - layout.size for k in layout.incident(contact)[2:4]]
    wave = after.incidental[: 2 * BLOCK_ROWS, 0, later[0]] / after.incidental[: 2 * BLOCK_ROWS, 0, own[0]]
    np.testing.assert_allclose(wave[:BLOCK_ROWS], wave[BLOCK_ROWS:], rtol=1e-3)
    assert wave[0] == pytest.approx(-wave[BLOCK_ROWS - 1], rel=1e-3)


def test_friction_at_creep_differs_from_friction_that_builds_up_after_a_reversal():
    """Beside all that the model fits, both point away from each other, or share less than a quarter of their energy;
    both can only be positive."""
    seen = recording()
    laws = [Stribeck(width) for width in (0.006, 0.015, 0.04)]
    others = [PreslidingHysteresis(way) for way in (0.0005, 0.0015, 0.003, 0.006)]
    rows = regressors().rows(seen, [Proposal((law,), "stick", 0) for law in (*laws, *others)])
    good = np.isfinite(rows.residual)
    base, columns = rows.base[good], rows.effects[good].astype(np.float64)
    rest = columns - base @ np.linalg.lstsq(base, columns, rcond=None)[0]
    rest /= np.linalg.norm(rest, axis=0)
    cosines = (rest.T @ rest)[: len(laws), len(laws) :]
    assert np.all((cosines > -0.8) & (cosines < 0.5)), cosines


def test_the_columns_of_a_loaded_recording_are_those_of_its_first_two_minutes():
    """Its load was fitted to other rows than that of its beginning: the difference was taken for sensor noise."""
    whole = recorded(3, noise=False, seconds=150.0, load_kg=LOAD_KG)
    begun = replace(whole, values=whole.values[: round(NOISE_S * RATE_HZ)])
    errors = tuple(p for p in proposals(MACHINE) if p.name in ("angle_offset", "pressure_gain"))
    long, short = (regressors().rows(each, errors).effects for each in (whole, begun))
    assert len(short) > 1000
    np.testing.assert_array_equal(long[: len(short)], short)


@pytest.mark.parametrize("kind", ["angle", "tilt"])
def test_a_known_load_moves_with_the_true_motion(kind):
    """With the recorded motion, the centre of a load of 1000 kg causes an error of 150 N m at the bucket."""
    own, seen = block(kind), loaded(block(kind))
    rows = regressors().simulated(seen, regressors().rows(seen, ()), [own], carried())
    load = rows.base @ regressors().model.load
    np.testing.assert_allclose(rows.incidental[..., : load.shape[-1]], load, rtol=1e-6, atol=1e-6)
