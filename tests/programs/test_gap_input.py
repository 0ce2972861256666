"""Recordings that a diagnosis cannot use as they are: an answer with its uncertainty, or a sentence that names the
file; never a confident name. (Files that cannot be read, and recordings too short or at rest: test_gap.py.)"""

import numpy as np
import pytest

from cylforce.diagnosis.regressors import Regressors
from cylforce.effects.imposed import imposed
from cylforce.estimation.model import Model
from cylforce.files.atomic import RecordingError
from cylforce.files.tables import Table, write_table
from cylforce.programs.common.gap_machine import ALWAYS
from cylforce.programs.common.gap_question import Question
from cylforce.programs.common.gap_references import alike, references_of
from cylforce.programs.gap import diagnose
from cylforce.programs.sim import run_sim
from cylforce.readings.faulty_sensors import faulty_sensors
from cylforce.readings.recording import Recording
from cylforce.settings.machine_file import load
from cylforce.simulation import scenario
from cylforce.simulation.sensing import run, sensors
from scenarios import CONFIG, SEED, truth_of

LOADED = load(CONFIG / "excavator_stick_bucket.toml")
SERVICE = LOADED.service
NAMES = tuple(s.name for s in SERVICE.machine.signals)
MODEL = Model(SERVICE.machine, SERVICE.filters, ALWAYS)
KILOGRAMS = 500.0
RATE = SERVICE.filters.rate_hz
PRESSURES = [k for k, name in enumerate(NAMES) if "pressure" in name]


def moved(motion, *effects, load=0.0):
    """A minute of the machine's moves, with a load [kg] in the bucket."""
    truth = truth_of(LOADED)._replace(effects=effects)
    scene = scenario.moves(SERVICE.machine, np.random.default_rng((SEED, motion)), 60.0, payload=load)
    made, rng = sensors(SERVICE.machine, SERVICE.nodes), np.random.default_rng((SEED, motion, 2))
    records = run(SERVICE.machine, truth, made, [scene], dt=1.0 / RATE, rng=rng)
    return np.concatenate([record.values for record in records])


@pytest.fixture(scope="module")
def order():
    """Four recordings of the machine in order."""
    return [moved(k) for k in (1, 2, 3, 4)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("input")


def written(path, values, every=1):
    """A table of every so manieth sample."""
    t_s = np.arange(len(values)) / RATE
    write_table(path, Table(t_s[::every], values[::every], NAMES))
    return path


def held(values, name):
    """The same with a sensor that never changes."""
    found = values.copy()
    found[:, NAMES.index(name)] = found[0, NAMES.index(name)]
    return found


def slowed(values):
    """The same with all pressures at half speed."""
    found, k = values.copy(), np.arange(len(values))
    for s in PRESSURES:
        found[:, s] = np.interp(0.5 * k, k, values[:, s])
    return found


def named(values):
    return [Recording(f"run {k}", each, 0.0) for k, each in enumerate(values)]


def references(recordings):
    """Recordings to compare, all blocks of them."""
    regressors = Regressors(MODEL, np.zeros(len(MODEL.parameters)))
    rows = [regressors.rows(each, ()) for each in recordings]
    return references_of(MODEL, recordings, rows, [np.ones(len(own.t), dtype=np.bool_) for own in rows])


def outliers(recordings):
    return references(recordings).outliers()


def test_references_in_order_are_alike(order):
    assert outliers(named(order)) == []
    assert faulty_sensors(MODEL, named(order)) == []


def test_the_reference_that_is_unlike_the_others_is_named(order):
    faulty = moved(5, imposed(SERVICE.machine, "pressure_offset", "stick_head_pressure", 6e5))
    assert outliers(named([*order, faulty])) == ["run 4"]


def test_a_reference_with_a_known_load_is_like_the_others_wherever_the_load_hangs(order):
    """One whose load is another than was said is not."""
    values = moved(6, load=KILOGRAMS)
    assert outliers([*named(order), Recording("loaded", values, KILOGRAMS)]) == []
    assert outliers([*named(order), Recording("loaded", values, 0.5 * KILOGRAMS)]) == ["loaded"]


def test_of_two_references_neither_is_called_wrong_but_both_are_named(order):
    faulty = moved(5, imposed(SERVICE.machine, "pressure_offset", "stick_head_pressure", 6e5))
    assert outliers(named([order[0], faulty])) == []
    found = alike(MODEL, named([order[0], faulty]))
    assert len(found.kept) == 2
    assert "run 0 and run 1 contradict each other" in " ".join(found.warnings)
    assert references(named(order[:2])).contradiction() < 1.5
    assert references(named([order[0]])).contradiction() == 0.0


def test_a_reference_of_another_machine_is_refused(order, folder, capsys):
    """Its header names the machine file; a table lacks its signals."""
    other = CONFIG / "excavator_20t.toml"
    run_sim(other, scenario="moves", duration=30.0, seed=SEED, log=folder / "other.log")
    capsys.readouterr()
    field = written(folder / "field.csv", order[1])
    with pytest.raises((RecordingError, ValueError), match=r"excavator_20t\.toml"):
        diagnose(LOADED, Question((field,), (folder / "other.log",)))
    write_table(folder / "less.csv", Table(np.arange(len(order[0])) / RATE, order[0][:, 1:], NAMES[1:]))
    with pytest.raises((RecordingError, ValueError), match=r"less\.csv"):
        diagnose(LOADED, Question((field,), (folder / "less.csv",)))


def test_a_frozen_pressure_in_the_field_is_told(order, folder):
    path = written(folder / "stuck.csv", held(order[0], "bucket_rod_pressure"))
    found = diagnose(LOADED, Question((path,), (written(folder / "order.csv", order[1]),)))
    assert (found.answer["verdict"], found.answer["effects"]) == ("not_observable", [])
    assert "bucket_rod_pressure never changes in stuck.csv" in found.answer["reason"]


def changed(values, name, by):
    """The same with a sensor that reads otherwise."""
    found = values.copy()
    found[:, NAMES.index(name)] = by(found[:, NAMES.index(name)])
    return found


def frozen_from(row):
    """A reading that stays what it is at a row."""
    return lambda v: np.where(np.arange(len(v)) < row, v, v[row])


@pytest.mark.parametrize(("name", "by", "said"), [
    ("stick_rod_pressure", frozen_from(2000), "stick_rod_pressure does not change in run 0 from 20 to 60 s"),
    ("stick_angle", np.negative, "stick_angle reads"),
    ("stick_angle", np.degrees, "is it reversed, or in other units"),
])  # fmt: skip
def test_a_sensor_that_does_not_tell_what_the_machine_does_is_named(order, name, by, said):
    (found,) = faulty_sensors(MODEL, named([changed(order[0], name, by)]))
    assert found.name == "run 0"
    assert said in found.sentence


def test_a_frozen_sensor_is_told_wherever_the_recording_begins(order):
    values = changed(order[0], "stick_rod_pressure", frozen_from(2000))
    (found,) = faulty_sensors(MODEL, [Recording("later", values, 0.0, 1e4)])
    assert "does not change in later from 10020 to 10060 s" in found.sentence


def test_a_sensor_of_coarse_steps_may_stay_at_one(order):
    values = order[0].copy()
    values[:, PRESSURES] = np.round(values[:, PRESSURES] / 2e5) * 2e5
    assert faulty_sensors(MODEL, named([values])) == []


def test_a_stretch_with_the_engine_off_and_a_zero_error_are_readable(order):
    """A recording is judged as a whole, and no more than its zero error may be is none."""
    off, low = order[1].copy(), order[2].copy()
    off[:, PRESSURES] = 0.0
    assert (
        faulty_sensors(MODEL, [Recording("day", order[0], 0.0), Recording("day", off + 1e-3 * order[1], 0.0, 100.0)])
        == []
    )
    k = NAMES.index("stick_rod_pressure")
    low[:, k] = SERVICE.machine.signals[k].low - 3e5 + 0.01 * low[:, k]
    assert faulty_sensors(MODEL, named([low])) == []


@pytest.mark.parametrize(("first", "last"), [(0, None), (1000, 3000), (2000, None)])
def test_an_angle_that_is_frozen_is_told(order, first, last):
    """As is one that is so from the begin to the end: in the others it shows noise."""
    values, k = order[0].copy(), NAMES.index("stick_angle")
    values[first:last, k] = values[first, k]
    (found,) = faulty_sensors(MODEL, named([values, *order[1:]]))
    assert found.name == "run 0"
    assert "stick_angle" in found.sentence
    assert "frozen" in found.sentence
    assert faulty_sensors(MODEL, named(order[1:]), named([values])) == []


def test_a_joint_that_stands_is_no_frozen_sensor(order):
    """With a sensor without noise, in steps, it reads the same for long."""
    coarse, k = [values.copy() for values in order], NAMES.index("bucket_angle")
    for values in coarse:
        values[:, k] = np.round(values[:, k], 3)
        values[:2000, k] = values[2000, k]
        values[3000:, k] = values[3000, k]
    coarse[0][:, k] = coarse[0][0, k]
    assert faulty_sensors(MODEL, named(coarse)) == []
    moving = order[1].copy()
    moving[:, k] = np.round(moving[:, k], 2)
    assert faulty_sensors(MODEL, named([coarse[0], moving])) == []
    lost = order[0].copy()
    lost[500:2000, k] = np.nan
    assert faulty_sensors(MODEL, named([lost, *order[1:]])) == []


def test_sides_of_a_cylinder_that_are_exchanged_are_told(order):
    """With no reference a machine was explained by friction, and its boom left 228 kN m."""
    head, rod = (NAMES.index(f"stick_{side}_pressure") for side in ("head", "rod"))
    values = order[0].copy()
    values[:, [head, rod]] = values[:, [rod, head]]
    (found,) = faulty_sensors(MODEL, named([values]))
    assert "stick_head_pressure and stick_rod_pressure are exchanged in run 0" in found.sentence


def test_pressures_in_bar_are_told(order):
    values = order[0].copy()
    values[:, PRESSURES] /= 1e5
    (found,) = faulty_sensors(MODEL, named([values]))
    assert "no pressure reaches 1 bar in run 0" in found.sentence


def test_what_is_no_longer_than_a_stretch_is_named_and_no_data_sheet_stands_in_for_references(order, folder):
    """Break-away friction, which a data sheet does not know, was named with 99 % on a machine in order."""
    field, short = written(folder / "whole.csv", order[1]), written(folder / "short.csv", order[0][:1000])
    alone = diagnose(LOADED, Question((field,), (short,))).answer
    assert alone["verdict"] == "not_observable"
    assert "no reference is left: short.csv has no gapless stretch of 20 s" in alone["reason"]
    both = diagnose(LOADED, Question((field,), (short, written(folder / "long.csv", order[2])))).answer
    assert both["verdict"] == "no_gap"
    assert any(text.startswith("short.csv has no gapless stretch") for text in both["warnings"])


def test_two_recordings_of_one_name_are_refused(order, folder):
    """They could not be told apart in the answer."""
    (folder / "other").mkdir()
    paths = [written(place / "same.csv", order[0]) for place in (folder, folder / "other")]
    for question in (Question(tuple(paths)), Question((paths[0],), (paths[1],)), Question((paths[0], paths[0]))):
        with pytest.raises(RecordingError, match=r"same\.csv: several recordings"):
            diagnose(LOADED, question)


def test_references_of_which_one_looks_like_work_beside_the_other_are_named(order):
    """One carries a load that nobody told: which of them is right, they do not tell."""
    heavy = moved(5, load=KILOGRAMS)
    found = alike(MODEL, [Recording("long", order[0], 0.0), Recording("short", heavy[:4000], 0.0)])
    assert [each.name for each in found.kept] == ["long", "short"]
    assert len(found.warnings) == 1
    assert "contradict each other" in found.warnings[0]
    assert alike(MODEL, named(order)).warnings == []


def test_a_reference_of_work_is_left_out_beside_others(order):
    """A third of it is empty; while it carries a load, pressures are those of the same motion with the load."""
    work = moved(5)
    third = len(work) // 3
    work[third:] = moved(5, load=KILOGRAMS)[third:]
    found = alike(MODEL, [*named(order), Recording("work", work, 0.0)])
    assert [each.name for each in found.kept] == [each.name for each in named(order)]
    assert len(found.warnings) == 1
    assert "work shows contact or unknown loads" in found.warnings[0]
    assert [each.name for each in alike(MODEL, [Recording("work", work, 0.0)]).kept] == ["work"]


def test_references_that_are_none_are_named_and_the_diagnosis_goes_on(order, folder):
    """One with clocks apart, one with a frozen sensor; two are left, and the field is as these are."""
    paths = [written(folder / f"reference_{k}.csv", values) for k, values in enumerate(order[:2])]
    paths.append(written(folder / "late.csv", slowed(order[2])))
    paths.append(written(folder / "stuck.csv", held(order[2], "bucket_rod_pressure")))
    found = diagnose(LOADED, Question((written(folder / "field.csv", order[3]),), tuple(paths)))
    assert found.answer["verdict"] == "no_gap"
    warned = " ".join(found.answer["warnings"])
    assert "late.csv is no reference" in warned
    assert "bucket_rod_pressure never changes in stuck.csv" in warned
    assert "reference_" not in warned


@pytest.mark.parametrize(
    ("slow", "every"), [("reference", 2), ("all", 5), pytest.param("field", 2, marks=pytest.mark.long)]
)
def test_tables_slower_than_the_machine_file_says_are_examined_at_their_own_rate(order, folder, slow, every):
    """Drawn out to 100 Hz by straight lines, 50 and 20 Hz were a faulty sensor, or load that fell out, with 97 %."""
    often = {name: every if slow in (name, "all") else 1 for name in ("reference", "field")}
    paths = [written(folder / f"reference_{k}.csv", values, often["reference"]) for k, values in enumerate(order[:3])]
    answer = diagnose(LOADED, Question((written(folder / "field.csv", order[3], often["field"]),), tuple(paths))).answer
    assert answer["verdict"] == "no_gap"
    said = f"has {RATE / every:g} rows a second, the machine file says {RATE:g} (filter.rate_hz)"
    assert [said in text for text in answer["warnings"]].count(True) == 1


def test_a_rate_that_the_filters_do_not_allow_is_refused_as_before(order, folder):
    """Of five rows a second nothing can be told."""
    with pytest.raises(RecordingError, match="too few for 100 Hz: record 20 at least"):
        diagnose(LOADED, Question((written(folder / "field.csv", order[3], 20),), ()))
