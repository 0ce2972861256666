"""`cylforce gap` at its edges: the answer's keys, patch, text and report; what is no recording to judge by."""

import json
import re
import tomllib

import numpy as np
import pytest
from typer.testing import CliRunner

from command_line import cylforce_
from cylforce.diagnosis.explain import WIDEST
from cylforce.diagnosis.model import REGIMES
from cylforce.effects.imposed import imposed
from cylforce.effects.library import LIBRARY, proposals
from cylforce.files.tables import Table, read_table, write_table
from cylforce.programs import cli
from cylforce.programs.common.gap_question import Question
from cylforce.programs.common.play import read_effects
from cylforce.programs.gap import STEPS, diagnose
from cylforce.programs.reports import report
from cylforce.programs.reports.gap_shown import acts_on
from cylforce.programs.reports.units import SHOWN, interval, shown
from cylforce.programs.sim import run_sim
from cylforce.programs.wording.plain import NEXT, plain
from cylforce.settings.machine_file import load
from cylforce.simulation import scenario
from cylforce.simulation.sensing import run, sensors
from pages import Page, check_one_file
from scenarios import CONFIG, EXCAVATOR, SEED, truth_of

MACHINE = CONFIG / "excavator_stick_bucket.toml"
LOADED = load(MACHINE)
OFFSET = 0.02  # rad
ASKED = "angle_offset@stick_angle"
VERDICTS = {"no_gap", "explained", "partly_explained", "ambiguous", "unknown", "not_observable"}
SECTIONS = ["verdict", "next", "causes", "evidence", "waterfall", "pressures", "where", "signatures", "friction"]
SECTIONS += ["confusions", "least", "provenance"]
FIGURES = {"evidence", "waterfall", "where", "pressures", "signatures", "friction"}


def recorded(path, motion, *effects, seconds=60.0):
    """A table of the machine's empty moves; one `motion` is one course of strokes."""
    service = LOADED.service
    truth = truth_of(LOADED)._replace(effects=effects)
    scene = scenario.moves(service.machine, np.random.default_rng((SEED, motion)), seconds)
    made, rng = sensors(service.machine, service.nodes), np.random.default_rng((SEED, motion, 2))
    records = run(service.machine, truth, made, [scene], dt=1.0 / service.filters.rate_hz, rng=rng)
    values = np.concatenate([record.values for record in records])
    t_s = np.arange(len(values)) / service.filters.rate_hz
    write_table(path, Table(t_s, values, tuple(s.name for s in service.machine.signals)))
    return values


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A recording of the machine in order, one with an offset of the stick's angle."""
    folder = tmp_path_factory.mktemp("gap")
    recorded(folder / "order.csv", 1)
    recorded(folder / "field.csv", 7, imposed(LOADED.service.machine, "angle_offset", "stick_angle", OFFSET))
    return folder


def gap(capsys, *words):
    """The command in this process: (exit code, output, errors), on one line each."""
    code = cylforce_("gap", *words)
    return code, *(" ".join(text.split()) for text in capsys.readouterr())


@pytest.fixture(scope="module")
def made(files):
    """(answer, patch file, page, output) as the command writes them when asked for one effect."""
    out = files / "out"
    out.mkdir()
    asked = (MACHINE, files / "field.csv", "--reference", files / "order.csv", "--only", ASKED)
    outputs = (
        "--json",
        out / "a.json",
        "--patch",
        out / "p.toml",
        "--html",
        out / "r.html",
        "--residuals",
        out / "l.npz",
    )
    done = CliRunner().invoke(cli.app, ["gap", *map(str, (*asked, *outputs))])
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in out.iterdir()) == ["a.json", "l.npz", "p.toml", "r.html"]
    assert set(np.load(out / "l.npz")) == {"field.t", "field.before", "field.after"}
    answer = json.loads((out / "a.json").read_text(), parse_constant=pytest.fail)  # NaN is no JSON
    return answer, out / "p.toml", (out / "r.html").read_text(encoding="utf-8"), done.output


@pytest.fixture(scope="module")
def whole(files):
    """The answer to the same, with nothing asked for, and what was said to be done meanwhile."""
    done = []
    question = Question((files / "field.csv",), (files / "order.csv",))
    return diagnose(LOADED, question, watch=lambda doing, _: done.append(doing)).answer, done


def shape(value):
    """Types instead of values; of a list what all its members have in common, of a dict by name its members'."""
    if isinstance(value, dict):
        return {key: shape(each) for key, each in value.items()}
    if isinstance(value, list):
        kinds = [shape(each) for each in value]
        return [k for n, k in enumerate(kinds) if k not in kinds[:n]]
    return "number" if isinstance(value, float | int) and not isinstance(value, bool) else type(value).__name__


N, PLACE = "number", {"name": "str", "at": "str"}
SIZE = {"value": N, "low": N, "high": N, "unit": "str"}
EFFECT = {
    **PLACE,
    "when": "str",
    "parameters": {"size": SIZE},
    "shape": {},
    "confidence": N,
    "confused_with": [],
    "same_as": [],
    "share": N,
    "removed_nm": N,
    "evidence_nats": N,
}
JOINT = {"fixed": N, "refit": N, "after": N, "floor": N}
BAR = {"fixed": N, "after": N, "floor": N}
SPOT = {
    "channel": "str",
    "regime": "str",
    "share": N,
    "p": N,
    "found": "bool",
    "rms_faulty": N,
    "rms_clean": N,
    "floors": N,
}
KEYS = {
    "verdict": "str",
    "compared_with": "str",
    "gap": {
        "units": "str",
        **JOINT,
        "parameter_shift": [{"name": "str", "standard_errors": N}],
        "joints": {"stick": JOINT, "bucket": JOINT},
        "bar": {"stick": BAR, "bucket": BAR},
        "simulated": [{**PLACE, "named": "bool"}],
    },
    "where": [SPOT],
    "effects": [EFFECT],
    "explained": N,
    "working": "bool",
    "end_quantities": {"payload_kg": {"before": N, "after": N}, "tip_force_n": {"before": N, "after": N}},
    "next_experiment": ["str"],
    "evidence": [{**PLACE, "nats": N, "probability": N}],
    "probabilities": {"no_gap": N, "unknown": N, "effects": [{**PLACE, "probability": N}]},
    "set": [PLACE],
    "looked_at": [{"name": "str", "seconds": N, "of_seconds": N, "stretches": N}],
    "noise": [{"sensor": "str", "seen": N, "declared": N, "before": N, "shakes": "bool"}],
    "vibration": [],
    "warnings": [],
}


def test_the_answer_has_the_documented_keys_and_types(made):
    answer = made[0]
    plain = [{key: effect[key] for key in effect if key != "closure"} for effect in answer["effects"]]
    assert {key: shape((answer | {"effects": plain})[key]) for key in KEYS} == KEYS
    assert set(answer) - set(KEYS) == {"not_observable", "unknown"}
    assert answer["verdict"] in VERDICTS
    assert {spot["regime"] for spot in answer["where"]} <= set(REGIMES)
    assert all(0.0 <= spot[key] <= 1.0 for spot in answer["where"] for key in ("share", "p"))


def test_a_share_is_told_with_its_interval_or_not_at_all(made):
    for closure in (effect["closure"] for effect in made[0]["effects"]):
        value, low, high = (closure[key] for key in ("value", "low", "high"))
        assert {value, low, high} == {None} or low <= value <= high <= low + WIDEST


def test_refitting_never_makes_the_gap_larger(made):
    gap = made[0]["gap"]
    assert 0.0 < gap["refit"] <= gap["fixed"]


def test_what_nothing_explains_is_null_or_has_a_shape(made):
    shape_of = made[0]["unknown"]
    assert (shape_of is None) == (made[0]["verdict"] not in ("unknown", "partly_explained"))
    assert shape_of is None or set(shape_of) == {"at", "of", "detail", "share", "alternatives"}


def test_the_effect_asked_for_is_found_with_its_size(made):
    (effect,) = made[0]["effects"]
    assert (effect["name"], effect["at"]) == ("angle_offset", "stick_angle")
    size = effect["parameters"]["size"]
    assert size["low"] < size["value"] < size["high"]
    assert abs(size["value"] - OFFSET) < 3.0 * (size["high"] - size["low"]) / 3.3  # three standard errors


def test_the_patch_is_what_the_simulator_takes(made):
    answer, patch, *_ = made
    (effect,) = read_effects(patch, LOADED)
    assert (effect.at, effect.group[0].about.name) == ("stick_angle", "angle_offset")
    assert effect.sizes == pytest.approx([answer["effects"][0]["parameters"]["size"]["value"]])


def test_the_page_has_every_section_and_figure_and_loads_nothing(made):
    answer, _, text, _ = made
    page = Page(text)
    assert page.sections == SECTIONS
    assert page.figures == FIGURES
    check_one_file(text)
    size = answer["effects"][0]["parameters"]["size"]
    assert shown(size["value"], "rad") in page.text["causes"]
    said = plain(LOADED.service.machine, answer)
    for text in (said.headline, *(line for point in said.points if point.title != NEXT for line in point.lines)):
        assert text in page.text["verdict"]
    assert answer["next_experiment"][0] in page.text["next"]


@pytest.mark.parametrize(
    ("name", "at", "joints"),
    [
        ("coulomb_friction", "stick", ["stick"]),
        ("pressure_offset", "bucket_rod_pressure", ["bucket"]),
        ("angle_offset", "stick_angle", ["stick"]),
        ("compliance", "bucket", ["bucket"]),
        ("tilt_ignored", "machine", ["stick", "bucket"]),
    ],
)
def test_the_page_draws_the_torque_of_the_joint_that_the_cause_acts_on(name, at, joints):
    machine = LOADED.service.machine
    proposal = next(p for p in proposals(machine) if (p.name, p.at) == (name, at))
    assert [machine.links[machine.rows[r]].name for r in acts_on(machine, proposal)] == joints


def test_units_of_the_reader():
    assert shown(2e5, "Pa") == "2\u00a0bar"
    assert shown(np.pi / 180, "rad") == "1\u00a0°"
    assert interval(-0.012, 0.0031, "s") == "-12 to 3.1\u00a0ms"
    assert shown(12345.6, "kg") == "12346\u00a0kg"
    known = {group[0].about.unit for group in LIBRARY}
    assert known - set(SHOWN) == {"kg", "kg m"}


def test_the_text_says_verdict_effect_and_next_step(made):
    said, words = plain(LOADED.service.machine, made[0]), " ".join(made[3].split())
    assert said.headline in words
    for point in said.points:
        assert point.title in words
    assert ASKED in words


def test_every_step_is_told(whole):
    assert len(dict.fromkeys(whole[1])) == 2 + STEPS


def test_an_effect_left_out_of_the_library_is_not_named(files, whole):
    """Nor listed anywhere; with an empty list the library is whole."""
    assert {each["name"] for each in whole[0]["effects"]} == {"angle_offset"}
    question = Question((files / "field.csv",), (files / "order.csv",), without=("angle_offset",))
    assert '"angle_offset"' not in json.dumps(diagnose(LOADED, question).answer)


def without(folder, rows=slice(None), **columns):
    """field.csv with some rows, and columns set to what is given (None: left out)."""
    names = [s.name for s in LOADED.service.machine.signals]
    table = read_table(folder / "field.csv", names)
    values = table.values[rows].copy()
    for name, value in columns.items():
        values[:, names.index(name)] = np.nan if value is None else value
    kept = [k for k, name in enumerate(names) if columns.get(name, 0) is not None]
    path = folder / "spoilt.csv"
    write_table(path, Table(table.t_s[rows], values[:, kept], tuple(names[k] for k in kept)))
    return path


def nothing_concluded(capsys, folder, field, reference):
    """The reason of the verdict not_observable; all three files are written, whole."""
    out = folder / "none"
    out.mkdir(exist_ok=True)
    outputs = ("--json", out / "a.json", "--patch", out / "p.toml", "--html", out / "r.html")
    code, text, _ = gap(capsys, MACHINE, field, "--reference", reference, *outputs)
    assert code == 0
    answer = json.loads((out / "a.json").read_text())
    assert (answer["verdict"], answer["effects"]) == ("not_observable", [])
    assert f"Nothing can be concluded: {answer['reason']}." in text
    page = Page((out / "r.html").read_text(encoding="utf-8"))
    assert answer["reason"] in page.text["verdict"]
    assert page.sections == ["verdict", "next", "provenance"]
    assert tomllib.loads((out / "p.toml").read_text()).get("effects", []) == []
    return answer["reason"]


def test_too_short_a_recording_is_not_judged(capsys, files):
    reason = nothing_concluded(capsys, files, without(files, slice(0, 1500)), files / "order.csv")
    assert reason == "no gapless stretch of 20 s in spoilt.csv"


def test_after_a_minute_of_reference_another_recording_in_order_is_no_gap(capsys, files):
    recorded(files / "again.csv", 8)
    code, output, _ = gap(capsys, MACHINE, files / "again.csv", "--reference", files / "order.csv")
    assert code == 0
    assert output.startswith("No fault")


def test_a_minute_of_reference_is_enough_to_find_a_fault(whole):
    """The fault is the likeliest cause, if less sure than with more."""
    assert "a wrong zero of the angle sensor of the stick" in plain(LOADED.service.machine, whole[0]).headline


def test_nan_everywhere_within_twenty_seconds_leaves_nothing(capsys, files):
    path = without(files)
    table = read_table(path, [s.name for s in LOADED.service.machine.signals])
    for first in range(0, len(table.t_s), 1500):
        table.values[first : first + 100] = np.nan
    write_table(path, table)
    assert nothing_concluded(capsys, files, path, files / "order.csv").startswith("no gapless stretch")


def test_a_machine_at_rest_is_not_judged(capsys, files):
    path = without(files)
    table = read_table(path, [s.name for s in LOADED.service.machine.signals])
    write_table(path, table._replace(values=np.tile(table.values[0], (len(table.t_s), 1))))
    assert "move every joint both ways" in nothing_concluded(capsys, files, path, files / "order.csv")


def refused(capsys, folder, *words):
    """The sentence of a refusal; nothing is written."""
    out = folder / "refused"
    out.mkdir(exist_ok=True)
    outputs = ("--json", out / "a.json", "--patch", out / "p.toml", "--html", out / "r.html")
    code, text, said = gap(capsys, *words, *outputs)
    assert (code, text, list(out.iterdir())) == (2, "", [])
    assert re.fullmatch(r"cylforce: [^.].*", said)
    return said


def test_what_cannot_be_read_is_one_sentence(capsys, files):
    (files / "junk.parquet").write_text("junk")
    (files / "junk.log").write_text("hello\n")
    for name in ("junk.parquet", "junk.log", "absent.csv"):
        assert name in refused(capsys, files, MACHINE, files / name)
    said = refused(capsys, files, MACHINE, without(files, stick_angle=None))
    assert "spoilt.csv" in said
    assert "stick_angle" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--load", "other.csv=100"), "--load other.csv: is none of the recordings (field.csv)"),
        (("--load", "field.csv"), "--load field.csv: write the recording's name, =, and the load in kg"),
        (("--load", "field.csv=much"), "--load field.csv=much: write the recording's name"),
        (("--load", "field.csv=-5"), "--load field.csv=-5: is no weight in kg"),
        (("--only", "glue"), "effect 'glue' is not known: choose one of coulomb_friction"),
        (("--without", "stribeck", "--without", "glue"), "effect 'glue' is not known: choose one of coulomb_friction"),
        (("--without", "stribeck", "--only", "stribeck"), "effect 'stribeck' is not known: choose one of"),
        (("--only", "stribeck@roof"), "effect 'stribeck' sits at 'roof', which is no cylinder: choose one of stick"),
    ],
)
def test_what_is_asked_wrongly_is_one_sentence(capsys, files, words, said):
    assert said in refused(capsys, files, MACHINE, files / "field.csv", *words)


def test_a_log_of_another_machine_is_refused(capsys, files):
    """Its header names the machine file."""
    run_sim(EXCAVATOR, scenario="moves", duration=10.0, seed=SEED, log=files / "other.log")
    capsys.readouterr()
    said = refused(capsys, files, MACHINE, files / "other.log")
    assert "excavator_20t.toml" in said
    assert "excavator_stick_bucket.toml" in said


def test_a_recording_named_twice_is_refused(capsys, files):
    """In order and not in order at once; and what could not be told apart in the answer."""
    field = files / "field.csv"
    assert "name it as one of them" in refused(capsys, files, MACHINE, field, "--reference", field)
    assert "several recordings have this name" in refused(capsys, files, MACHINE, field, field)


def test_a_folder_that_is_not_there_is_said_before_anything_is_computed(capsys, files):
    code, _, said = gap(capsys, MACHINE, files / "absent.csv", "--json", files / "no" / "a.json")
    assert code == 2
    assert "in a folder that exists" in said


@pytest.mark.parametrize("name", ["clock_fault", "slew_centrifugal"])
def test_no_other_effect_is_named_than_the_one_asked_for(capsys, files, name):
    """And a gap that it does not explain is still a gap."""
    code, _, said = gap(capsys, MACHINE, files / "field.csv", "--only", name, "--json", files / "alone.json")
    assert code == 0, said
    answer = json.loads((files / "alone.json").read_text())
    assert {effect["name"] for effect in answer["effects"]} <= {name}
    assert answer["verdict"] != "no_gap"


def test_a_report_without_its_libraries_is_refused_at_once(capsys, files, monkeypatch):
    monkeypatch.setattr(report, "find_spec", lambda name: None)
    assert "pip install 'cylforce[report]'" in refused(capsys, files, MACHINE, files / "field.csv")
