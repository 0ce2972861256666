"""The healthy machine: what recordings, a simulation and an identification say of it."""

from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from cylforce.commissioning.identification import identify
from cylforce.diagnosis import diagnose, question_of
from cylforce.diagnosis.constants import SAME_MACHINE, VARYING_CHANGE
from cylforce.diagnosis.decide import Verdict
from cylforce.diagnosis.model import (
    LEARNT,
    REGIMES,
    RUN_TO_RUN_CHANGE,
    KnowledgeSource,
    fitted_parameters,
    forms_of,
    identified,
    noise_of_sensors,
    quiet_blocks,
    regime,
)
from cylforce.diagnosis.regressors import Regressors, typical_incidents
from cylforce.diagnosis.statistics import rms
from cylforce.effects.fault import INCIDENTAL, RunToRun
from cylforce.effects.unknown import NAME as UNKNOWN_TORQUE
from cylforce.estimation.model import FRICTION, Model
from cylforce.programs.common.gap_machine import MOST_UNEXPLAINED, unexplained
from cylforce.readings.constants import BLOCK_ROWS
from cylforce.readings.recording import Recording
from cylforce.settings.identified import read_identified, write_identified
from cylforce.settings.machine_file import load
from diagnosis.scenes import (
    MACHINE,
    PROPOSALS,
    REFERENCE_SEEDS,
    SENSOR_NOISE,
    SERVICE,
    asked,
    effect,
    healthy_machine,
    learnt_from,
    names,
    recorded,
)
from scenarios import CONFIG

FIELD = 5  # seed of a recording that nothing was learnt from
FEW = tuple(p for p in PROPOSALS if p.name in ("coulomb_friction", "pressure_offset", "angle_offset", "sensor_delay"))


@cache
def few():
    """The healthy machine with a few effects: quicker."""
    return learnt_from(*(recorded(seed) for seed in REFERENCE_SEEDS), wanted=FEW)


# Spread of its own recordings


def test_two_recordings_may_differ_as_much_as_a_part_of_the_references_from_the_others():
    machine = few()
    alike, unlike = np.tile(machine.floor.rms**2, (8, 1)), np.tile(machine.floor.rms**2, (8, 1))
    unlike[:2, 1] *= 3.0  # of four parts the first, at the second joint
    assert replace(machine, floor_unseen=alike).spread == pytest.approx(SAME_MACHINE)
    assert replace(machine, floor_unseen=unlike).spread == pytest.approx(2.0)
    assert replace(machine, floor_unseen=unlike).spread_of_joints == pytest.approx([SAME_MACHINE, 2.0])
    unlike[:2, 0] = np.nan  # a joint that does not move there
    assert replace(machine, floor_unseen=unlike).spread == pytest.approx(2.0)


def test_references_that_leave_a_large_share_of_the_torque_show_no_healthy_machine():
    references = [recorded(seed) for seed in REFERENCE_SEEDS]
    assert unexplained(few(), references) < 0.1 * MOST_UNEXPLAINED
    loose = replace(few(), floor=few().floor.scaled(100.0 * few().floor.rms))
    assert unexplained(loose, references) > MOST_UNEXPLAINED
    assert unexplained(replace(loose, known=np.array([False, False])), references) == 0.0


# Columns


def test_every_effect_has_columns_of_its_own_but_for_the_clock():
    layout = healthy_machine().layout
    own = [c for p, columns in zip(layout.proposals, layout.places, strict=True) for c in columns if not p.course]
    assert sorted(own) == list(range(layout.first, layout.clock))
    assert layout.size == layout.clock + 2
    assert len(layout.unit) == len(layout.healthy) == layout.size
    assert np.all(layout.unit > 0.0)
    seen, shown = recorded(1), healthy_machine().regressors.rows(recorded(1), layout.proposals)
    assert layout.columns(shown, seen).shape[-1] == layout.size + len(layout.typical) + 1


VARIES = {
    **dict.fromkeys(("coulomb_friction", "viscous_friction", "asymmetric_friction"), RunToRun.VARYING),
    **dict.fromkeys(("friction_level_change", "pressure_offset"), RunToRun.VARYING),
    **dict.fromkeys(("stribeck", "presliding_hysteresis"), RunToRun.CREEP),
}


def test_errors_of_sensors_and_masses_do_not_change_from_run_to_run_but_friction_and_zeros_do():
    layout = healthy_machine().layout
    for p, columns in zip(layout.proposals, layout.places, strict=True):
        if p.course or p.name == UNKNOWN_TORQUE:
            continue
        static = layout.static[list(columns)]
        assert np.all(static == static[0])
        assert p.about.varies is VARIES.get(p.name, RunToRun.STATIC), p.name
        if p.about.varies in LEARNT or p.rubs:
            assert not np.any(static), p.name
        if p.name in ("angle_offset", "pressure_gain", "extra_mass", "linkage_geometry"):
            assert np.all(static), p.name


# Learnt from recordings


@pytest.mark.parametrize("seed", [FIELD, 6, 7])
def test_two_references_predict_a_third_recording(seed):
    question = asked((seed, ()))
    ratio = rms(question.residuals()) / healthy_machine().floor.rms
    assert np.all((ratio > 0.7) & (ratio < 1.3)), ratio


def test_the_noise_floor_is_no_less_than_the_sensors_noise_and_not_much_more():
    machine = healthy_machine()
    seen = [recorded(seed) for seed in REFERENCE_SEEDS]
    rows = [machine.regressors.rows(each, ()) for each in seen]
    noise = noise_of_sensors(machine.regressors, seen, rows, SENSOR_NOISE, np.random.default_rng(3))
    ratio = machine.floor.rms / noise.rms
    assert np.all((ratio > 0.9) & (ratio < 2.0)), ratio


def test_what_is_not_seen_in_a_fit_is_no_smaller_than_what_is():
    machine = healthy_machine()
    assert np.nanmean(machine.floor_unseen) >= 0.98 * np.nanmean(machine.floor_seen)
    assert np.nanmean(machine.floor_unseen) < 1.5 * np.nanmean(machine.floor_seen)
    assert (machine.references, machine.loaded, bool(np.all(machine.known))) == (2, False, True)


def test_the_fitted_parameters_reduce_the_residual_of_the_data_sheet():
    model = Model(MACHINE, SERVICE.filters, FRICTION)
    seen = [recorded(seed) for seed in REFERENCE_SEEDS]
    values = fitted_parameters(model, seen)
    fitted, sheet = (
        rms([Regressors(model, each).rows(recorded(FIELD), ()).residual]) for each in (values, model.prior.mean)
    )
    assert np.all(fitted < 0.2 * sheet)


def test_a_known_load_does_not_disturb_the_fitted_parameters():
    model = Model(MACHINE, SERVICE.filters, FRICTION)
    empty, loaded = recorded(1), recorded(2, load_kg=500.0)
    values = fitted_parameters(model, [empty, loaded])
    residual = Regressors(model, values).rows(recorded(FIELD), ()).residual
    plain = healthy_machine().floor.rms
    assert np.all(rms([residual]) < 2.0 * plain)


def test_blocks_with_contact_in_a_reference_do_not_count():
    """In one of two references the teeth are in the ground for ten seconds."""
    dug = effect("soil_contact", "bucket", [1e4, 2e4], begin=30.0, end=40.0)
    machine = learnt_from(recorded(1), recorded(2, dug), wanted=FEW)
    ratio = machine.floor.rms / few().floor.rms
    assert np.all((ratio > 0.8) & (ratio < 1.2)), ratio
    field = question_of(machine, [recorded(FIELD)], np.random.default_rng(1))
    assert np.all(rms(field.residuals()) < 1.3 * few().floor.rms)


def stated(machine, name):
    """Return the columns of an effect, and the variation that physics states for them."""
    layout = machine.layout
    about = next(p.about for p in layout.proposals if p.name == name)
    columns = [c for f in forms_of(layout) if f.name == name for c in f.columns]
    return columns, RUN_TO_RUN_CHANGE[about.varies] * about.low / layout.unit[columns[0]]


def test_references_that_differ_teach_a_larger_run_to_run_variation_and_like_ones_a_smaller_one():
    """Zeros of pressures that differ by ten times what is stated; geometry, clocks and friction are no part of that."""
    rng, own = np.random.default_rng(4), [k for k, s in enumerate(MACHINE.signals) if "pressure" in s.name]
    varied = []
    for seed in (1, 2, 3):
        seen = recorded(seed)
        values = seen.values.copy()
        values[:, own] += rng.normal(0.0, 10.0 * VARYING_CHANGE * 0.4e5, len(own))
        varied.append(replace(seen, values=values))
    columns, usual = stated(few(), "pressure_offset")
    steady = learnt_from(*(recorded(seed) for seed in (1, 2, 3)), wanted=FEW).machine.variation
    moving = learnt_from(*varied, wanted=FEW).machine.variation
    assert np.all(moving[columns] > 1.5 * usual), moving[columns] / usual
    assert np.all(steady[columns] < 0.6 * usual), steady[columns] / usual
    static, least = stated(few(), "angle_offset")
    for each in (steady, moving):
        np.testing.assert_allclose(each[static], least, rtol=0.05)
    rubbing, usual_friction = stated(few(), "coulomb_friction")
    assert np.all(moving[rubbing] <= 1.001 * usual_friction), moving[rubbing] / usual_friction


def test_friction_that_differs_between_references_is_no_sign_of_zeros_that_differ():
    """With a common factor, friction that differed between strokes and sines widened what zeros vary by eight times."""
    names = ("coulomb_friction", "friction_level_change", "pressure_offset")
    wanted = tuple(p for p in PROPOSALS if p.name in names)
    levels = enumerate((-0.3, 0.0, 0.3), 1)
    machine = learnt_from(
        *(recorded(seed, effect("friction_level_change", "stick", level)) for seed, level in levels), wanted=wanted
    )
    coulomb, level, offset = (
        machine.machine.variation[columns] / usual for columns, usual in (stated(machine, name) for name in names)
    )
    assert np.all(coulomb > 1.5), coulomb
    assert np.all(level > 1.5), level
    assert np.all(offset < 1.001), offset


def test_an_error_that_references_show_with_an_impossible_sign_is_no_evidence_that_it_went():
    """The bucket's angle is early in the references and no longer in the field: no sensor is early, so that it was
    something else; a late one in the field is one all the same."""
    own = next(k for k, s in enumerate(MACHINE.signals) if s.name == "bucket_angle")

    def shifted(seen, late_s):
        values, t = seen.values.copy(), np.arange(len(seen.values)) / SERVICE.filters.rate_hz
        values[:, own] = np.interp(t - late_s, t, values[:, own])
        return replace(seen, values=values)

    early = learnt_from(*(shifted(recorded(seed), -0.03) for seed in REFERENCE_SEEDS), wanted=FEW)
    for machine, late_s, there in ((early, 0.0, False), (few(), 0.03, True)):
        field = question_of(machine, [shifted(recorded(FIELD), late_s)], np.random.default_rng(1))
        case = field.likelihood()
        form = next(k for k, f in enumerate(field.forms) if f.key == ("sensor_delay", "bucket_angle"))
        nats = case.likeliest((form,), case.machine.noise).log - case.likeliest((), case.machine.noise).log
        assert bool(nats > 20.0) is there, nats


# Learnt from a simulation


def test_a_simulation_without_noise_has_the_sensors_noise_as_floor():
    """Otherwise every residual of the machine would be a gap."""
    silent = [recorded(seed, noise=False) for seed in REFERENCE_SEEDS]
    plain, simulated = (
        learnt_from(*silent, wanted=FEW, source=source)
        for source in (KnowledgeSource.REFERENCES, KnowledgeSource.SIMULATION)
    )
    rows = [simulated.regressors.rows(each, ()) for each in silent]
    noise = noise_of_sensors(simulated.regressors, silent, rows, SENSOR_NOISE, np.random.default_rng(3))
    assert plain.floor.rms[0] < 0.8 * noise.rms[0]
    assert np.all(simulated.floor.rms > 0.95 * noise.rms)
    found = diagnose(simulated, [recorded(FIELD)], np.random.default_rng(1))
    assert (found.verdict, names(found)) == (Verdict.NO_GAP, [])


# From an identification


@cache
def tares():
    """What identifying the machine from an empty recording finds."""
    return identify(Model(MACHINE, SERVICE.filters, FRICTION), [recorded(1, seconds=120.0).values], refuse=False)


def identified_machine(read, field):
    model = Model(MACHINE, SERVICE.filters, read.friction)
    regressors = Regressors(model, read.values)
    return identified(
        regressors, PROPOSALS, read.covariance, read.row_error, field, SENSOR_NOISE, np.random.default_rng(1)
    )


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    """An identified.toml, read again."""
    loaded = load(CONFIG / "excavator_stick_bucket.toml")
    path = tmp_path_factory.mktemp("identified") / "identified.toml"
    write_identified(path, tares(), loaded, [])
    return read_identified(path, loaded)


OFFSET = effect("angle_offset", "stick_angle", 0.02)


def test_the_floor_of_an_identified_machine_is_what_its_identification_left_whatever_the_fault(read):
    healthy, faulty = (identified_machine(read, [recorded(FIELD, *own)]) for own in ((), (OFFSET,)))
    for machine in (healthy, faulty):
        np.testing.assert_allclose(machine.floor.rms, read.row_error)
    np.testing.assert_allclose(faulty.floor.white, healthy.floor.white, rtol=0.1)


def test_parameters_are_as_certain_together_as_the_identification_says(read):
    """One by one, their errors would leave the torques far less certain than they are."""
    machine = identified_machine(read, [recorded(FIELD)])
    count, unit = len(read.values), machine.layout.unit
    known = machine.machine.covariance[:count, :count] * np.outer(unit[:count], unit[:count])
    np.testing.assert_allclose(known, read.covariance, rtol=1e-9)
    assert machine.source is KnowledgeSource.IDENTIFICATION
    assert (machine.references, machine.regimes) == (0, None)


def test_a_healthy_machine_with_its_identification_alone_is_not_alarmed(read):
    field = [recorded(FIELD)]
    found = diagnose(identified_machine(read, field), field, np.random.default_rng(1))
    assert (found.verdict, names(found)) == (Verdict.NO_GAP, [])


def test_a_fault_is_found_with_the_identification_alone(read):
    field = [recorded(FIELD, OFFSET)]
    found = diagnose(identified_machine(read, field), field, np.random.default_rng(1))
    assert found.evidence.first == ("angle_offset", "stick_angle")
    assert names(found)[0] == ("angle_offset", "stick_angle")


# Blocks of references in which the machine works


OWN, ROWS, COUNT = 6, 3, 40
LOAD, TIP = INCIDENTAL.index("load.mass"), INCIDENTAL.index("tip.x.0")


@dataclass(frozen=True)
class Columns:
    """A layout whose columns are the rows themselves."""

    first: int = OWN
    size: int = OWN

    @property
    def unit(self):
        """Typical sizes of the machine's columns."""
        return np.ones(OWN)

    @property
    def typical(self):
        """Typical sizes of the incidental columns of a machine with three joints."""
        three = SimpleNamespace(rows=range(ROWS))
        return typical_incidents(three)

    def columns(self, rows, _recording):
        """Return the rows."""
        return rows


def worked(rng, load_kg=0.0, force=0.0):
    """Return rows (T, ROWS, K) of which in the second quarter a load acts, in the third a force at the teeth."""
    count = COUNT * BLOCK_ROWS
    found = np.zeros((count, ROWS, OWN + len(Columns().typical) + 1))
    found[..., :OWN] = 500.0 * rng.standard_normal((count, ROWS, OWN))
    lever = np.array([7.0, 4.0, 1.2]) * (1.0 + 0.2 * rng.standard_normal((count, 1)))
    found[..., OWN + LOAD], found[..., OWN + TIP] = 9.81 * lever, lever
    residual = found[..., :OWN] @ rng.standard_normal(OWN) + 200.0 * rng.standard_normal((count, ROWS))
    quarter = np.arange(count) * 4 // count
    residual[quarter == 1] += load_kg * found[quarter == 1][..., OWN + LOAD]
    residual[quarter == 2] += force * found[quarter == 2][..., OWN + TIP]
    found[..., -1] = residual
    return found


def kept(rows):
    """Return which blocks of one recording count."""
    return quiet_blocks(Columns(), [rows], [Recording("made", np.zeros((1, 1)))])[0]


QUARTER = np.arange(COUNT) * 4 // COUNT


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_blocks_at_work_do_not_count(seed):
    found = kept(worked(np.random.default_rng(seed), 900.0, 2e4))
    assert np.array_equal(found, (QUARTER == 0) | (QUARTER == 3))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_all_blocks_of_a_machine_that_does_not_work_count(seed):
    assert np.all(kept(worked(np.random.default_rng(seed))))


def test_a_known_load_away_from_the_origin_is_no_work_beside_a_machine_that_works():
    """The centre of each known load is unknown."""
    rng = np.random.default_rng(4)
    loaded, working = worked(rng), worked(rng, 900.0, 2e4)
    centre = slice(OWN + LOAD + 1, OWN + LOAD + 3)
    loaded[..., centre] = 9.81 * rng.uniform(-1.0, 1.0, (len(loaded), ROWS, 2))
    loaded[..., -1] += loaded[..., centre] @ np.array([1500.0, -700.0])
    recordings = [Recording("loaded", np.zeros((1, 1)), load_kg=1000.0), Recording("work", np.zeros((1, 1)))]
    found = quiet_blocks(Columns(), [loaded, working], recordings)
    assert np.all(found[0])
    assert np.array_equal(found[1], (QUARTER == 0) | (QUARTER == 3))


def test_blocks_in_which_nothing_is_usable_are_no_work():
    rows = worked(np.random.default_rng(1), 900.0, 2e4)
    rows[: COUNT // 8 * BLOCK_ROWS] = np.nan
    assert np.array_equal(kept(rows), (QUARTER == 0) | (QUARTER == 3))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_machine_that_works_most_of_the_time_is_found_in_the_remainder(seed):
    """Digging cycles are free of load and contact for a quarter to a third of the time."""
    rng = np.random.default_rng(seed)
    rows = worked(rng)
    quiet = np.isin(np.arange(COUNT), rng.permutation(COUNT)[: int(0.3 * COUNT)])
    load, force = (
        np.repeat(x, BLOCK_ROWS)[:, None] for x in (rng.uniform(500.0, 1500.0, COUNT), rng.uniform(1e4, 1e5, COUNT))
    )
    lifts = np.repeat(rng.random(COUNT) < 0.5, BLOCK_ROWS)[:, None]
    added = np.where(lifts, load * rows[..., OWN + LOAD], force * rows[..., OWN + TIP])
    rows[..., -1] += np.where(np.repeat(quiet, BLOCK_ROWS)[:, None], 0.0, added)
    assert np.array_equal(kept(rows), quiet)


def test_what_a_poor_quarter_does_not_show_of_the_machine_is_no_work():
    """The quarter with which the search begins moves few columns; in the others the machine shows them."""
    rng = np.random.default_rng(4)
    rows, values = worked(rng), 3.0 * rng.standard_normal(OWN)
    poor = np.arange(len(rows)) < COUNT // 3 * BLOCK_ROWS
    rows[poor, :, OWN // 2 : OWN] = 0.0
    noise = np.where(poor, 150.0, 200.0)[:, None] * rng.standard_normal(rows.shape[:2])
    rows[..., -1] = rows[..., :OWN] @ values + noise
    assert np.all(kept(rows))


@pytest.mark.parametrize("count", [1, OWN])
def test_a_joint_of_which_a_quarter_has_hardly_a_row_is_not_fitted_exactly_there(count):
    """As many rows as columns show no noise: beside none, all others would be work."""
    rows, half = worked(np.random.default_rng(5)), COUNT // 2 * BLOCK_ROWS
    values = np.random.default_rng(6).standard_normal(OWN)
    rows[:half, 0] = 0.0
    rows[:count, 0, :OWN] = 500.0 * np.random.default_rng(7).standard_normal((count, OWN))
    rows[..., -1] = rows[..., :OWN] @ values
    noise = 200.0 * np.random.default_rng(8).standard_normal(rows.shape[:2])
    noise[:half] *= 0.1
    rows[..., -1] += np.where(np.any(rows[..., :OWN] != 0.0, axis=-1), noise, 0.0)
    assert np.all(kept(rows))


# Regimes


@pytest.mark.parametrize(
    ("name", "rows"),
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
def test_regimes_are_what_they_are_called(name, rows):
    """Cylinder 1 at 0.2, 0.01, -0.01, -0.2 m/s; joint 0 at 3, -2, -1, 5 degrees; 500 kg in the bucket."""
    assert name in REGIMES
    own = SimpleNamespace(
        speed=np.array([[9.0, 0.2], [9.0, 0.01], [9.0, -0.01], [9.0, -0.2]]),
        posture=np.radians([[3.0, 0.0], [-2.0, 1.0], [-1.0, 2.0], [5.0, 3.0]]),
        t=np.arange(4.0),
    )
    assert np.flatnonzero(regime(name, own, Recording("made", np.zeros((1, 1)), 500.0), 1, 0)).tolist() == rows
