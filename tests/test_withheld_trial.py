"""The withheld trial is fair: seeds decide, effects are in the field alone, folders tell nothing, labels are sealed."""

import json
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
from trial.diagnosis import Diagnosis
from trial.effects.fault import Draw, same_physics
from trial.field import Lengths, Site, faulty, lacking, scene
from trial.effects.foreign import FOREIGN
from trial.effects.library import CLUTTER, KNOWN, clutter
from trial.orders import FIRST_SCORED, KINDS, PER_MACHINE, POOR, Order, machine_seed, order
from trial.run import Trial, Truth, records
from trial.scoring import Judged, Share, bounds, calibration_error, figures, shares, true_closure
from trial.sigmas import Effect
from trial.summary import AIMS, result

SHORT = Lengths(8.0, 4.0, 4.0, 4.0)
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
    return Site(1, "own", SHORT)


@pytest.mark.parametrize("name", [*KNOWN, *FOREIGN])
def test_every_effect_changes_the_field_s_physics_or_signals(site, name):
    """Not the machine itself; the same draws give the same fault, and another size when drawn anew."""
    seen = scene(site.pieces)
    fault, again, other = ((KNOWN | FOREIGN)[name](Draw(np.random.default_rng(s)), seen) for s in (4, 4, 5))
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


def test_boom_moves_under_a_system_of_two_links_in_the_field_alone(site, tmp_path):
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
    assert min(Counter(o.names[0] for o in orders if o.kind == "foreign").values()) == 9 >= 6
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
    assert len({f.name for f in small}) == CLUTTER == 16
    assert "angle_offset" not in {f.name for f in small}
    usual = KNOWN["pressure_offset"](Draw(np.random.default_rng(0), 0.05), seen)
    assert abs(usual.size) == pytest.approx(0.05 * np.sqrt(0.5 * 5.0))
    tilted = KNOWN["tilt_ignored"](Draw(np.random.default_rng(0), 0.05), seen)
    assert tilted.size == pytest.approx(0.05 * np.sqrt(0.3 * 5.0))  # whatever the field's slope
    assert not same_physics(faulty(site.pieces[1], small), site.machine)


def test_poor_motion_lacks_what_it_says(site):
    plan = Site(1, "own", Lengths()).pieces[0].plan
    most = int(np.argmax(np.ptp(plan.lengths, axis=0)))
    moves = np.ptp(lacking(plan, "one_joint", most).lengths, axis=0)
    assert [k for k in range(3) if moves[k] > 0.05] == [most]
    assert np.count_nonzero(moves) == 1
    speed = [np.abs(np.diff(p.lengths, axis=0)).max() for p in (plan, lacking(plan, "slow", 0))]
    assert 0.0 < speed[1] <= 1.001 * speed[0] / 6.0
    assert [p.stretch.name for p in site.field(np.random.default_rng(0), 9, "empty_only")] == ["field_empty"]


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
    assert not [name for name in (*KNOWN, *FOREIGN, "truth", "seed") if name in texts]
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
    trial = Trial(tmp_path / "table.jsonl", SHORT, Diagnosis((sys.executable, str(program))))
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
    figures_of = result(found)
    assert set(AIMS) <= set(figures_of)
    assert figures_of["false_alarms"] == 1.0
    assert figures_of["cases"] == 2
    json.dumps(figures_of)


def test_diagnosis_that_fails_is_counted_as_such(site, tmp_path):
    trial = Trial(tmp_path / "table.jsonl", SHORT, Diagnosis((sys.executable, "-c", "raise SystemExit('no idea')")))
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


def judged(kind, answer, effects=(("stribeck", "boom"),), clutter=(), sigmas=50.0, **label):
    named = [{"name": n, "at": a, "sigmas": sigmas} for n, a in effects]
    return Judged({"kind": kind, "clutter": list(clutter), "effects": named, "sigmas": sigmas} | label, answer)


def said(verdict, *effects, **more):
    return {"verdict": verdict, "effects": [{"name": n, "at": a, "confidence": c} | more for n, a, c in effects]}


RIGHT = said("explained", ("stribeck", "boom", 0.95))
WRONG = said("explained", ("backlash", "boom", 0.8))
SET = said("ambiguous", ("backlash", "stick", 0.5), confused_with=[{"name": "stribeck", "at": "boom"}])
PAIR = [("backlash", "stick"), ("stribeck", "boom")]
SILENCE = {"verdict": "no_gap", "effects": []}


def test_shares_of_cases_made_by_hand():
    cases = [
        *(judged("known", a) for a in (RIGHT, RIGHT, WRONG, SET, SILENCE)),
        judged("known", SILENCE, sigmas=6.0),  # too small to be demanded
        judged("known", RIGHT, clutter=[{"name": "x"}]),
        *(judged("none", a, ()) for a in (SILENCE, SILENCE, {"verdict": "not_observable"}, {"verdict": "unknown"})),
        judged("foreign", {"verdict": "unknown"}, [("hose_spring", "boom")]),
        judged("foreign", WRONG, [("hose_spring", "boom")]),
        judged("pair", said("explained", ("stribeck", "boom", 1), ("backlash", "stick", 1)), PAIR),
        judged("pair", RIGHT, PAIR),
        judged("poor", WRONG),
        judged("poor", SET),
    ]  # fmt: skip
    found = shares(cases)
    assert found["detected"] == (5, 6)
    assert found["top1_clean"] == (2, 4)
    assert found["top1_clutter"] == (1, 1)
    assert found["precision"] == (3, 4)
    assert found["named_share"] == (4, 5)
    assert found["false_alarms"] == (1, 4)
    assert found["foreign_named"] == (1, 2)
    assert found["unknown_recall"] == (1, 2)
    assert found["set_coverage"] == (4, 5)
    assert found["pairs_exact"] == (1, 2)
    assert found["poor_wrong"] == (1, 2)
    assert figures(cases)["set_size"] == pytest.approx((4 + 2) / 5)


def test_closure_and_payload_by_hand():
    stated = {"value": 0.9, "low": 0.8, "high": 0.95}
    cases = [
        judged("known", said("explained", ("stribeck", "boom", 1.0), closure=stated)
               | {"end_quantities": {"payload_kg": {"before": 60, "after": a}}}, closure=c, oracle_payload_kg=-10.0)
        for a, c in ((10.0, 0.92), (-20.0, 0.7))
    ]  # fmt: skip
    found = figures(cases)
    assert found["closure_error_median"] == pytest.approx(0.11)
    assert shares(cases)["closure_coverage"] == (1, 2)
    assert found["payload_ratio"] == pytest.approx(np.sqrt(2.5))


def test_true_closure_is_of_the_effect_not_of_the_floor():
    rng = np.random.default_rng(0)
    d, floor = rng.normal(size=(200, 3)), 5.0 * rng.normal(size=(200, 3))
    level = np.array([1.0, 2.0, 3.0])
    assert true_closure(d, d + floor, floor, level) == pytest.approx(1.0)
    assert true_closure(d, d + floor, 0.5 * d + floor, level) == pytest.approx(0.75)
    assert true_closure(d, d + floor, d + floor, level) == pytest.approx(0.0)
    assert true_closure(0.0 * d, floor, floor, level) is None
    holed = d.copy()
    holed[:20] = np.nan
    assert true_closure(holed, d + floor, 0.5 * d + floor, level) == pytest.approx(0.75)


def test_calibration_error_is_the_gap_between_confidence_and_truth():
    honest = [
        judged("known", said("explained", ("stribeck" if k % 4 else "backlash", "boom", 0.75))) for k in range(100)
    ]
    assert calibration_error(honest) == pytest.approx(0.0, abs=0.02)
    boasting = [
        judged("known", said("explained", ("stribeck" if k % 4 else "backlash", "boom", 0.99))) for k in range(100)
    ]
    assert calibration_error(boasting) == pytest.approx(0.24, abs=0.02)


def test_bounds_are_exact_binomial():
    assert bounds(Share(0, 100)) == pytest.approx((0.0, 0.0362), abs=1e-4)
    assert bounds(Share(100, 100)) == pytest.approx((0.9638, 1.0), abs=1e-4)
    assert bounds(Share(8, 10)) == pytest.approx((0.4439, 0.9748), abs=1e-4)


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
    assert all(b - a > SHORT.field_empty for a, b in pairwise(begins))
    assert replace(site.pieces[0].stretch, name="x").payload_kg == 0.0
