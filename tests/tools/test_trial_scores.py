"""Scores of the trial are pure functions: a perfect answer scores 1, a constant one has no skill."""

import json
import sys

import numpy as np
import pytest

from trial.asking import of_folder, of_machines, run
from trial.diagnosis import Diagnosis
from trial.judged import NO_GAP, UNKNOWN, Judged, Share
from trial.orders import order
from trial.probability import LEAST, Stated, brier, brier_skill, calibration_error, log_score, stated
from trial.run import Trial
from trial.scoring import figures, shares, true_closure
from trial.source import labelled, orders
from trial.summary import AIMS, WORDS, by_effect, result
from trial.summary import judged as judged_of


def judged(kind, answer, effects=(("stribeck", "boom"),), clutter=(), floors=5.0, **label):
    named = [{"name": n, "at": a, "over_floor": floors} for n, a in effects]
    return Judged({"kind": kind, "clutter": list(clutter), "effects": named} | label, answer)


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
        judged("known", SILENCE, floors=2.4),  # too small to be demanded
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
    assert found["first"] == (3, 6)
    assert found["in_set"] == (4, 6)
    assert found["pairs_in_set"] == (1, 2)
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


def test_friction_that_a_data_sheet_does_not_know_is_no_false_alarm():
    friction, bent = (said("explained", (name, "boom", 1.0)) for name in ("coulomb_friction", "compliance"))
    assert not judged("none", friction, (), references=[]).alarm
    assert judged("none", friction, (), references=["strokes"]).alarm
    assert judged("none", bent, (), references=[]).alarm
    both = said("explained", ("coulomb_friction", "boom", 1.0), ("compliance", "boom", 0.9))
    assert judged("none", both, (), references=[]).alarm
    assert judged("none", {"verdict": "unknown"}, (), references=[]).alarm


TO_IDENTIFY = {"verdict": "not_observable", "identify_first": {"share": 0.9}}


def test_a_data_sheet_alone_is_to_be_identified_first():
    """No effect can be named beside it: such a case is no miss; a name is one."""
    told, named = (judged("known", answer, references=[]) for answer in (TO_IDENTIFY, RIGHT))
    found = shares([told, named])
    assert found["first"] == (0, 0)
    assert found["identify_first"] == (1, 2)


def test_air_and_work_are_counted_apart():
    cases = [judged("known", a, scenario=s) for a, s in ((RIGHT, "air"), (SILENCE, "air"), (RIGHT, "dig_cycles"))]
    found = shares(cases)
    assert found["first"] == (1, 2)
    assert found["dig_first"] == (1, 1)
    assert found["in_set"] == (2, 3)


def test_a_gap_to_the_data_sheet_alone_is_not_the_hidden_effect():
    stated = {"value": 0.9, "low": 0.8, "high": 0.95}
    answer = said("explained", ("stribeck", "boom", 1.0), closure=stated)
    case = judged("known", answer, closure=-40.0, references=[])
    assert shares([case])["closure_coverage"] == (0, 0)
    assert figures([case])["closure_error_p90"] is None


def test_a_second_cause_beside_a_set_is_named():
    found = said("ambiguous", ("backlash", "boom", 0.5), ("stribeck", "boom", 0.9))
    found["effects"][0]["confused_with"] = [{"name": "backlash", "at": "stick"}]
    found["set"] = [{"name": "backlash", "at": "boom"}, {"name": "backlash", "at": "stick"}]
    assert judged("pair", found, PAIR).covered
    assert not judged("pair", found, [*PAIR[:1], ("mud", "stick")]).covered


def test_clutter_that_is_large_enough_to_be_seen_is_no_wrong_name():
    small = {"name": "backlash", "at": "boom"}
    case, hidden = (judged("known", WRONG, present=small | {"over_floor": floors}) for floors in (3.0, 1.2))
    assert not case.right
    assert not case.wrong
    assert case.answers == case.truth | {("backlash", "boom")}
    assert hidden.wrong
    assert shares([case, hidden])["precision"] == (1, 2)
    assert shares([case, hidden])["first"] == (0, 2)


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


def answer(verdict, effects=(), no_gap=0.0, unknown=0.0, members=()):
    """An answer with probabilities and a set."""
    listed = [{"name": n, "at": a, "probability": p} for n, a, p in effects]
    named = [{"name": n, "at": a, "confidence": 0.1} for n, a, _ in effects[:1]] if verdict == "explained" else []
    return {
        "verdict": verdict,
        "effects": named,
        "probabilities": {"no_gap": no_gap, "unknown": unknown, "effects": listed},
        "set": [{"name": n, "at": a} for n, a in members],
    }


def perfect(case):
    """What somebody says who knows the label."""
    (truth,) = [next(iter(case.truths))] if case.truths else [set()]
    if case.kind == "none":
        return answer("no_gap", no_gap=1.0, members=[NO_GAP])
    if case.kind in ("foreign", "without"):
        return answer("unknown", unknown=1.0, members=[UNKNOWN])
    return answer("explained", [(*next(iter(truth)), 1.0)], members=list(truth))


ALL = [
    *(judged("known", SILENCE) for _ in range(4)),
    *(judged("known", SILENCE, scenario="dig_cycles") for _ in range(4)),
    *(judged("none", SILENCE, ()) for _ in range(4)),
    *(judged("foreign", SILENCE, [("gusts", "machine")]) for _ in range(4)),
    *(judged("without", SILENCE) for _ in range(4)),
]


def test_a_perfect_answer_scores_one():
    cases = [Judged(c.label, perfect(c)) for c in ALL]
    found, numbers = shares(cases), figures(cases)
    for name in ("first", "dig_first", "in_set", "precision", "named_share", "top1_clean", "unknown_recall"):
        assert found[name].value == 1.0, name
    for name in ("false_alarms", "foreign_named", "foreign_alone", "leave_one_out_named"):
        assert found[name].value == 0.0, name
    assert numbers["set_size"] == 1.0
    assert numbers["brier"] == numbers["ece"] == numbers["log_score"] == 0.0
    assert brier_skill([*stated(cases), Stated(0.0, False)]) == pytest.approx(1.0)


def test_a_constant_answer_has_no_skill():
    """At the base rate none; at any other constant less than none."""
    base = [Stated(0.3, k < 3) for k in range(10)]
    assert brier_skill(base) == pytest.approx(0.0)
    assert brier_skill([s._replace(probability=0.8) for s in base]) < 0.0
    assert brier_skill([s._replace(probability=float(s.right)) for s in base]) == 1.0
    assert brier_skill([Stated(0.9, True)] * 4) is brier_skill([]) is brier([]) is None


def test_an_honest_mixture_has_the_skill_of_its_spread():
    honest = [Stated(p, k < round(100 * p)) for p in (0.1, 0.9) for k in range(100)]
    assert brier_skill(honest) == pytest.approx(1.0 - 0.09 / 0.25)
    assert calibration_error(honest) == pytest.approx(0.0, abs=1e-9)
    assert calibration_error([Stated(0.99, k % 4 > 0) for k in range(100)]) == pytest.approx(0.24)
    assert calibration_error(honest[:3]) is None


def test_the_log_score_is_that_of_the_truth():
    half = judged("known", answer("explained", [("stribeck", "boom", 0.5), ("backlash", "boom", 0.3)], unknown=0.2))
    missed = judged("known", answer("unknown", [("backlash", "boom", 0.3)], unknown=0.7))
    assert log_score([half]) == pytest.approx(np.log(0.5))
    assert log_score([missed]) == pytest.approx(np.log(LEAST))
    assert log_score([]) is log_score([judged("known", SILENCE)]) is None
    pair = judged("pair", answer("explained", [("stribeck", "boom", 0.5), ("backlash", "stick", 0.4)]), PAIR)
    assert log_score([pair]) == pytest.approx(np.log(0.9))


def test_a_name_where_the_library_lacks_the_effect_counts_when_it_is_sure():
    sure = judged("without", answer("explained", [("backlash", "boom", 0.85)]))
    unsure = judged("without", answer("explained", [("backlash", "boom", 0.6)], unknown=0.4))
    silent = judged("without", SILENCE)
    assert shares([sure, unsure, silent])["leave_one_out_named"] == (1, 3)
    assert stated([sure, unsure]) == []
    assert figures([sure])["cases"] == 0.0


def test_a_foreign_effect_that_the_library_has_by_now_may_be_named():
    right = judged("foreign", RIGHT)
    assert shares([right])["foreign_named"] == (0, 1)
    assert shares([judged("foreign", WRONG)])["foreign_named"] == (1, 1)


def test_an_effect_at_several_places_is_right_at_each():
    case = judged("known", said("explained", ("stribeck", "stick", 0.9)))
    assert not case.right
    case.label["effects"][0]["places"] = ["boom", "stick"]
    assert case.right
    assert case.covered


def test_a_failed_answer_is_nothing():
    """Neither silence nor a name: no set, no probability, and on a machine in order an alarm."""
    failed = {"verdict": "failed", "effects": [], "reason": "none"}
    case = judged("known", failed)
    assert (case.possible, case.first, case.confidence, case.right) == (set(), None, 0.0, False)
    assert shares([judged("none", failed, ())])["false_alarms"] == (1, 1)
    assert figures([case])["brier"] is None


def test_every_figure_with_an_aim_has_words():
    assert set(AIMS) == set(WORDS)
    assert {"brier_skill", "log_score", "leave_one_out_named", "dig_first", "source"} <= set(result([]))


def test_the_table_by_effect_has_a_row_for_each():
    rows = by_effect(ALL)
    assert rows["stribeck"]["right"] == Share(0, 8)
    assert rows["stribeck (left out)"]["detected"] == Share(0, 4)
    assert rows["in order: "]["right"] == Share(4, 4)


ANSWERING = """
import json, os, sys
left = [sys.argv[k + 1] for k, word in enumerate(sys.argv) if word == "--without"]
if "--help" in sys.argv:
    print("--without")
else:
    assert not [name for name in os.listdir(".") if "case" in name and name != "case.json" or "label" in name]
    effect = {"name": "stribeck", "at": "stick", "confidence": 0.9}
    found = {"verdict": "unknown", "effects": []} if left else {"verdict": "explained", "effects": [effect]}
    open(sys.argv[sys.argv.index("--json") + 1], "w").write(json.dumps(found | {"words": sys.argv[1:]}))
"""


def effect(name, at, over_floor, nameable=True):
    """Of labels.json."""
    return {"name": name, "at": [at], "strength": 1.0, "unit": "N", "nameable": nameable,
            "residual_over_floor": [1.0, over_floor, 1.0]}  # fmt: skip


@pytest.fixture
def source(tmp_path):
    """Labelled recordings of one machine, none of which can be read."""
    folder = tmp_path / "made" / "machine_1"
    folder.mkdir(parents=True)
    listed = {
        "reference_static": [],
        "empty_in_order": [],
        "case_1": [effect("stribeck", "stick", 1.5)],
        "case_2": [effect("stribeck", "stick", 3.0)],
        "case_3": [effect("stribeck", "stick", 4.0)],
        "case_4": [effect("gusts", "machine", 4.0, nameable=False)],
        "case_5": [effect("soil_contact_in_air", "bucket tip", 4.0)],
    }
    (folder / "machine.toml").write_text("")
    for name in listed:
        (folder / f"{name}.parquet").write_text("")
    labels = [
        {"machine": "machine_1", "recording": name, "scenario": "dig_cycles_slew", "effects": effects}
        for name, effects in listed.items()
    ]
    (folder.parent / "labels.json").write_text(json.dumps(labels))
    return folder.parent


def test_labelled_machines_are_asked_like_any_other(source, tmp_path):
    """Once each, the first visible recording of a known effect also without it; names of files tell nothing."""
    program = tmp_path / "answers.py"
    program.write_text(ANSWERING)
    trial = Trial(tmp_path / "table.jsonl", diagnosis=Diagnosis((sys.executable, str(program))))
    asked = of_folder(trial, source, ("",))
    assert run(trial, asked, 1) == []
    assert run(trial, asked, 1) == []
    records = {r["case"].split("/")[1]: r for r in trial.done()}
    assert list(records) == ["empty_in_order", "case_1", "case_2", "case_3", "case_4", "case_5"]
    assert [name for name, r in records.items() if r["without"]] == ["case_2", "case_5"]
    words = records["case_2"]["without"]["words"]
    assert words[:4] == ["machine.toml", "field.parquet", "--reference", "reference_0.parquet"]
    assert words[-2:] == ["--without", "stribeck"]
    found = result(list(records.values()), "made")
    assert found["source"] == "made"
    assert found["counts"]["first"] == [0, 0]
    assert found["counts"]["dig_first"] == [2, 3]
    assert found["counts"]["foreign_named"] == [1, 1]
    assert found["counts"]["false_alarms"] == [1, 1]
    assert found["counts"]["leave_one_out_named"] == [0, 2]
    assert found["cases"] == 6
    assert len(judged_of(list(records.values()))) == 8


def test_a_stratum_is_called_by_words(source, tmp_path):
    trial = Trial(tmp_path / "table.jsonl")
    asked = of_folder(trial, source, ("",))
    assert [name[-6:] for name in asked.stratum(["known", "stribeck"]).orders] == ["case_1", "case_2", "case_3"]
    assert asked.stratum([]).orders == asked.orders
    with pytest.raises(ValueError, match=r"no case is glue: words are dig_cycles_slew, foreign"):
        asked.stratum(["glue"])
    wanted = of_machines(trial, [order(1, k, development=True) for k in range(80)])
    work = wanted.stratum(["known", "work", "clean"]).orders
    assert {o["kind"] for o in work.values()} == {"known"}
    assert not any(o["clutter"] for o in work.values())
    assert 0 < len(work) < 32


def test_labels_are_read_in_the_library_s_words(source):
    last = labelled(source)[-1]
    assert (last.truth, last.kind, last.over_floor) == (("soil_contact", "bucket"), "known", 4.0)
    assert [o["asked_again"] for o in orders(labelled(source))] == [False, False, True, False, False, True]
