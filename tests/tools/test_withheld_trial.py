"""The withheld trial is fair: seeds decide, effects are in the field alone, folders tell nothing, labels are sealed."""

import json
import shutil
import sys
from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pyarrow.parquet as pq
import pytest

from cylforce.settings.machine_file import load
from reference_machine import draw
from reference_machine.sensors import SIGNALS
from trial.cases import sealed, simulated, write
from trial.diagnosis import Diagnosis, arguments
from trial.effects.fault import WIDER, Draw, same_physics
from trial.effects.foreign import FOREIGN
from trial.effects.library import CLUTTER, KNOWN, clutter
from trial.effects.unheard import UNHEARD
from trial.field import PAUSE_S, Site, faulty, lacking, scene
from trial.knowledge import Knowledge, Limited
from trial.motion import KINDS as MOTIONS
from trial.orders import FIRST_SCORED, KINDS, NAMES, PER_MACHINE, POOR, Order, machine_seed, order
from trial.repertoire import LOAD_KG, REFERENCES, Repertoire, Ride, drawn
from trial.run import Trial, Truth, records
from trial.sigmas import Effect
from trial.summary import AIMS, result

SHORT = Repertoire(
    (Ride("reference_empty", "strokes", 8.0), Ride("reference_loaded", "strokes", 4.0, LOAD_KG)),
    (Ride("field_empty", "strokes", 4.0), Ride("field_loaded", "strokes", 4.0, LOAD_KG)),
    1.0,
)
ANSWERS = """
import json, os, sys
assert not [key for key in os.environ if "label" in key.lower()]
out = sys.argv[sys.argv.index("--json") + 1] if "--json" in sys.argv else None
if out:
    effect = {"name": "stribeck", "at": "boom", "confidence": 0.5}
    open(out, "w").write(json.dumps({"verdict": "explained", "effects": [effect], "seen": sorted(os.listdir("."))}))
"""


def one(name, friction="own", **more):
    return Order(**{"number": 3, "kind": "known", "names": (name,), "clutter": False, "poor": "", "machine": 1,
                    "friction": friction, "seed": (0, 3, 1)} | more)  # fmt: skip


@pytest.fixture(scope="module")
def site():
    return Site(1, "own", 1.0, SHORT)


@pytest.mark.parametrize("name", [*KNOWN, *FOREIGN, *UNHEARD])
def test_every_effect_changes_the_field_s_physics_or_signals(site, name):
    """Not the machine itself; the same draws give the same fault, and another size when drawn anew."""
    seen = scene(site.pieces)
    fault, again, other = ((KNOWN | FOREIGN | UNHEARD)[name](Draw(np.random.default_rng(s)), seen) for s in (4, 4, 5))
    assert fault.label() == again.label()
    assert name == "slew_centrifugal" or fault.label() != other.label()
    assert fault.name == name
    places = {"machine", "boom", "stick", "bucket", *SIGNALS}
    assert fault.at in places
    loaded = site.pieces[1]
    changed = fault.apply(loaded.machine, loaded.stretch)
    assert changed is not loaded.machine
    assert not same_physics(changed, loaded.machine) or changed.sensors != loaded.machine.sensors
    assert draw(1).specimen == site.machine.specimen


@pytest.mark.parametrize("name", ["pressure_gain", "clock_fault", "compliance", "tilt_ignored", "extra_mass"])
def test_twin_differs_by_the_effect_alone(site, name):
    """The references stay, and signals that the effect cannot reach keep their very noise."""
    case, twin = simulated(site, one(name))
    clean, _ = simulated(site, one(name, kind="none", names=()))
    assert all(np.array_equal(case.references[key], clean.references[key]) for key in clean.references)
    assert all(np.array_equal(twin[key], clean.field[key]) for key in twin)
    changed = [
        s
        for k, s in enumerate(SIGNALS)
        if not np.array_equal(case.field["field_loaded"][:, k], twin["field_loaded"][:, k])
    ]
    assert changed
    if name != "extra_mass":
        assert "slew_rate" not in changed


def test_boom_moves_under_a_system_of_two_links_in_the_field_alone(tmp_path):
    site = Site(1, "own", repertoire=Repertoire(SHORT.references, (Ride("field_empty", "sines", 30.0),), 1.0))
    case, twin = simulated(site, one("boom_motion", two_links=True))
    pitch = case.signals.index("pitch")
    assert case.label["effects"][0]["at"] == "machine"
    for values in (*case.references.values(), *twin.values()):
        assert np.ptp(values[:, pitch]) < np.radians(2.0)
    assert np.ptp(case.field["field_empty"][:, pitch]) > np.radians(2.0)
    write(case, tmp_path)
    signals = load(tmp_path / "machine.toml").service.machine.signals
    assert (
        tuple(s.name for s in signals)
        == case.signals
        == tuple(pq.read_table(tmp_path / "field_empty.parquet").column_names[1:])
    )


def test_a_seed_decides_all(site):
    cases = [simulated(site, one("pressure_offset"))[0] for _ in range(2)]
    assert cases[0].label == cases[1].label
    assert np.array_equal(cases[0].field["field_empty"], cases[1].field["field_empty"])
    assert [order(4, k, development=False) for k in range(40)] == [order(4, k, development=False) for k in range(40)]
    assert order(4, 0, development=False) != order(5, 0, development=False)


def test_mix_and_machines():
    orders = [order(9, k, development=False) for k in range(600)]
    count = Counter(o.kind for o in orders)
    assert {kind: count[kind] for kind in set(KINDS)} == {
        "known": 240,
        "none": 150,
        "foreign": 90,
        "pair": 60,
        "poor": 60,
    }
    known = [o for o in orders if o.kind == "known"]
    assert sum(o.clutter for o in known) == 120
    assert min(Counter(o.names[0] for o in known).values()) >= 240 // (len(KNOWN) + 1)
    foreign = Counter(o.names[0] for o in orders if o.kind == "foreign")
    assert sum(foreign[name] for name in UNHEARD) == sum(foreign[name] for name in FOREIGN) == 45
    assert min(foreign[name] for name in (*UNHEARD, *FOREIGN)) >= 4
    assert Counter(o.names[0] for o in orders if o.without) == dict.fromkeys(NAMES, 1)
    assert Counter(o.poor for o in orders if o.kind == "poor") == dict.fromkeys(POOR, 12)
    assert all(len(set(o.names)) == 2 for o in orders if o.kind == "pair")
    assert max(Counter(o.machine for o in orders).values()) == PER_MACHINE
    assert min(o.machine for o in orders) >= FIRST_SCORED
    assert max(machine_seed(s, k, development=True) for s in range(600) for k in (0, 999)) < FIRST_SCORED
    two = Counter(o.kind for o in orders if o.two_links)
    assert two["known"] == sum(o.names == ("boom_motion",) for o in known) >= 8
    assert two["none"] >= two["known"]
    assert {o.friction for o in orders} == {"own", "foreign"}


def test_clutter_is_small_and_of_other_names(site):
    seen = scene(site.pieces)
    small = clutter(Draw(np.random.default_rng(0)), seen, ("angle_offset",))
    assert CLUTTER[0] <= len({f.name for f in small}) == len(small) <= CLUTTER[1]
    assert "angle_offset" not in {f.name for f in small}
    usual = KNOWN["pressure_offset"](Draw(np.random.default_rng(0), 0.05), seen)
    assert abs(usual.size) == pytest.approx(0.05 * np.sqrt(0.5 * 5.0))
    tilted = KNOWN["tilt_ignored"](Draw(np.random.default_rng(0), 0.05), seen)
    assert tilted.size == pytest.approx(0.05 * np.sqrt(0.3 * 5.0))  # whatever the field's slope
    assert not same_physics(faulty(site.pieces[1], small), site.machine)


def test_poor_motion_lacks_what_it_says(site):
    plan = Site(1, "own", repertoire=SHORT).usual[0].plan
    most = int(np.argmax(np.ptp(plan.lengths, axis=0)))
    moves = np.ptp(lacking(plan, "one_joint", most).lengths, axis=0)
    assert [k for k in range(3) if moves[k] > 0.05] == [most]
    assert np.count_nonzero(moves) == 1
    speed = [np.abs(np.diff(p.lengths, axis=0)).max() for p in (plan, lacking(plan, "slow", 0))]
    assert 0.0 < speed[1] <= 1.001 * speed[0] / 6.0
    assert [p.stretch.name for p in site.poor(np.random.default_rng(0), 9, "empty_only")] == ["field_empty"]


def test_folder_tells_nothing(site, tmp_path):
    case, _ = simulated(site, one("viscous_friction"))
    write(case, tmp_path)
    names = {
        "machine.toml",
        "case.json",
        *(f"{w}_{h}.parquet" for w in ("reference", "field") for h in ("empty", "loaded")),
    }
    assert {p.name for p in tmp_path.rglob("*")} == names
    texts = "".join((tmp_path / name).read_text() for name in ("machine.toml", "case.json"))
    assert not [name for name in (*KNOWN, *FOREIGN, *UNHEARD, "truth", "seed") if name in texts]
    other, _ = simulated(site, one("", kind="none", names=()))
    assert other.machine_toml == case.machine_toml
    for path in tmp_path.glob("*.parquet"):
        table = pq.read_table(path)
        assert table.column_names == ["t_s", *SIGNALS]
        assert not [k for k in table.schema.metadata or {} if k != b"ARROW:schema"]


def test_label_is_sealed_before_and_opened_after(site, tmp_path, capsys):
    """End to end with a diagnosis that lists what it sees and always says the same."""
    program = tmp_path / "answers.py"
    program.write_text(ANSWERS)
    trial = Trial(tmp_path / "table.jsonl", diagnosis=Diagnosis((sys.executable, str(program))))
    orders = [one("stribeck"), one("stribeck", number=4, kind="none", names=())]
    for record in records(trial, site, orders):
        trial.append(record)
    found = trial.done()
    printed = capsys.readouterr().out
    for record in found:
        assert f"case {record['case']} sealed {record['sealed']}" in printed
        assert sealed(record["label"], record["salt"]) == record["sealed"]
        assert sealed(record["label"] | {"kind": "pair"}, record["salt"]) != record["sealed"]
        assert not [name for name in record["answer"]["seen"] if "label" in name or "truth" in name]
    assert found[0]["label"]["effects"][0]["sigmas"] > 0.0
    assert found[0]["label"]["effects"][0]["over_floor"] >= 1.0
    figures_of = result(found)
    assert set(AIMS) <= set(figures_of)
    assert figures_of["false_alarms"] == 1.0
    assert figures_of["cases"] == 2
    json.dumps(figures_of)


def test_diagnosis_that_fails_is_counted_as_such(site, tmp_path):
    trial = Trial(tmp_path / "table.jsonl", diagnosis=Diagnosis((sys.executable, "-c", "raise SystemExit('no idea')")))
    (record,) = records(trial, site, [one("pressure_offset")])
    assert record["answer"]["verdict"] == "failed"
    assert "no idea" in record["answer"]["reason"]
    assert result([record])["failed"] == 1


def test_true_closure_of_an_answer_s_rows(site, tmp_path):
    """Rows at another rate that take away all, half or nothing of what the twin says the effect is."""
    case, twin = simulated(site, one("angle_offset"))
    write(case, tmp_path)
    truth = Truth(case, twin, tmp_path)
    count, parts = len(truth.twin[0].torque), np.split(truth.whole.difference, 2)
    t = np.arange(1.5, 3.5, 0.02)
    for left in (0.0, 0.5, 1.0):
        stated = {}
        for name, part in zip(case.field, parts, strict=True):
            added = np.stack([np.interp(t, truth.floor.times(count), x) for x in part.T], axis=-1)
            stated |= {f"{name}.t": t, f"{name}.before": added + 7.0, f"{name}.after": left * added + 7.0}
        np.savez(tmp_path / "residuals.npz", **stated)
        assert truth.opened(truth.sized(site), tmp_path, None)["closure"] == pytest.approx(1.0 - left**2)


def test_sigmas_grow_with_the_effect_and_know_that_the_floor_is_correlated():
    rng = np.random.default_rng(2)
    signal = np.sin(np.arange(4000) / 30.0)[:, None] * np.ones(2)
    white = rng.normal(size=(4000, 2))
    slow = np.apply_along_axis(lambda x: np.convolve(x, np.ones(50) / np.sqrt(50), "same"), 0, white)
    level = np.ones(2)
    one = Effect(signal, white, level).sigmas
    assert one == pytest.approx(np.linalg.norm(signal), rel=0.3)
    assert Effect(3.0 * signal, white, level).sigmas == pytest.approx(3.0 * one)
    assert Effect(signal, slow, level).sigmas < 0.4 * one


def test_cases_of_a_machine_share_its_references(site):
    assert site.references is site.references
    begins = [p.stretch.begin_s for p in site.pieces]
    assert all(b - a > PAUSE_S for a, b in pairwise(begins))
    assert replace(site.pieces[0].stretch, name="x").payload_kg == 0.0


def test_sizes_reach_three_times_as_far():
    drawn_ = [Draw(np.random.default_rng(k)).size(1.0, 10.0) for k in range(400)]
    assert max(drawn_) / min(drawn_) == pytest.approx(10.0 * WIDER, rel=0.1)
    assert min(drawn_) == pytest.approx(1.0 / np.sqrt(WIDER), rel=0.05)


def test_repertoires_differ_from_machine_to_machine():
    """References of every kind, of one minute of strokes alone, or none; fields of every kind."""
    found = [drawn(k) for k in range(400)]
    kinds = Counter(tuple(sorted(r.name.removeprefix("reference_") for r in f.references)) for f in found)
    assert 10 < kinds[()] < 60
    assert {name for names in kinds for name in names} == set(REFERENCES)
    assert sum(f.references == (Ride("reference_strokes", "strokes", 60.0),) for f in found) > 20
    assert {f.field[0].kind for f in found} == set(MOTIONS)
    assert drawn(7) == drawn(7) != drawn(8)


@pytest.mark.parametrize("kind", MOTIONS)
def test_motions_stay_in_the_working_range_above_the_ground(kind):
    site = Site(3, "own", repertoire=Repertoire((), (Ride("field_any", kind, 30.0),), 1.0))
    (piece,) = site.pieces
    low, high = site.machine.geometry.working.T
    lengths = piece.plan.lengths
    assert np.all(lengths >= low - 1e-6)
    assert np.all(lengths <= high + 1e-6)
    assert np.all(np.ptp(lengths, axis=0) > 0.05) or kind == "stairs"
    assert np.abs(np.diff(lengths, axis=0)).max() < 0.01
    assert piece.quiet.all() == (kind != "work")
    again = Site(3, "own", repertoire=site.repertoire).pieces[0]
    assert np.array_equal(again.plan.lengths, lengths)


def test_an_effect_of_a_load_gets_a_field_with_a_load():
    site = Site(3, "own", 0.5, Repertoire((), (Ride("field_empty", "stairs", 60.0),), 1.0))
    assert site.showing(("stribeck",)) is site.pieces
    assert any(p.stretch.payload_kg for p in site.showing(("payload_spill",)))
    assert any(np.ptp(p.plan.slew) for p in site.showing(("slew_centrifugal",)))


def test_a_load_that_falls_is_back_in_the_next_cycle():
    site = Site(3, "own", repertoire=Repertoire((), (Ride("field_work", "work", 60.0),), 1.0))
    (piece,) = site.pieces
    fault = KNOWN["payload_spill"](Draw(np.random.default_rng(2)), scene(site.pieces))
    changed = fault.apply(piece.machine, piece.stretch).edited(piece.plan)
    less = piece.plan.payload[:, 0] - changed.payload[:, 0] > 1.0
    assert len(set(piece.plan.cycle[less])) == 1


def test_work_without_references_has_a_size(tmp_path):
    """Soil and unknown loads are no part of the floor."""
    site = Site(3, "own", repertoire=Repertoire((), (Ride("field_work", "work", 60.0),), 1.0))
    case, twin = simulated(site, one("pressure_offset", machine=3))
    write(case, tmp_path)
    label = Truth(case, twin, tmp_path).sized(site)
    assert label["scenario"] == "dig_cycles"
    assert label["references"] == []
    assert 1.0 < label["effects"][0]["sigmas"] < 1e4


class TestKnowledge:
    """A diagnosis gets what it may know of the healthy machine, and no more."""

    @pytest.fixture
    def folder(self, site, tmp_path):
        case, _ = simulated(site, one("stribeck"))
        write(case, tmp_path)
        return tmp_path

    @pytest.mark.parametrize(
        ("knowledge", "references", "compared"),
        [
            (Knowledge.REFERENCES, 2, 2),
            (Knowledge.ONE_REFERENCE, 1, 1),
            (Knowledge.DATA_SHEET, 0, 0),
        ],
    )
    def test_references_that_it_may_not_know_are_gone(self, folder, knowledge, references, compared):
        with Limited(knowledge) as limited:
            assert len(limited.apply(folder)) == compared
        words = arguments(folder)
        assert words.count("--reference") == references
        assert len(list(folder.glob("reference*"))) == references
        assert all((folder / word).exists() for word in words if word.endswith(".parquet"))

    def test_an_identification_comes_from_the_empty_references_once_for_all_cases(self, folder, tmp_path):
        read = []

        def identify(loaded, recordings, output, how):
            read.append([path.name for path in recordings])
            output.write_text("[identified]\n")

        copy = tmp_path.with_name("copy")
        shutil.copytree(folder, copy)
        with Limited(Knowledge.IDENTIFIED, identify) as limited:
            assert [limited.apply(path) for path in (folder, copy)] == [["identified.toml"]] * 2
        assert read == [["reference_empty.parquet"]]
        assert arguments(copy)[-4:-2] == ["--identified", "identified.toml"]
        assert "--reference" not in arguments(folder)

    def test_where_no_reference_suffices_the_data_sheet_remains(self, folder):
        def refuse(*_):
            raise ValueError("too short")

        with Limited(Knowledge.IDENTIFIED, refuse) as limited:
            assert limited.apply(folder) == []
        assert not {"--identified", "--reference"} & set(arguments(folder))


def test_every_other_healthy_machine_is_in_harsh_conditions():
    orders = [order(5, k, development=True) for k in range(80)]
    assert Counter(o.harsh for o in orders if o.kind == "none") == {True: 10, False: 10}
    assert not any(o.harsh for o in orders if o.kind != "none")
