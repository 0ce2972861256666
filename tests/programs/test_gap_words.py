"""The answer in plain words: every verdict has its own, every effect of the library a name that a mechanic knows."""

import re
from types import SimpleNamespace

import pytest
from rich.console import Console

from cylforce.diagnosis.decide import Verdict
from cylforce.diagnosis.model import REGIMES
from cylforce.effects.library import LIBRARY, proposals
from cylforce.estimation.model import FRICTION, Model
from cylforce.programs.gap_output import show
from cylforce.programs.wording.fault_words import TOLD, WORDS, amount, fault, happening_beside, place
from cylforce.programs.wording.parameter_words import UNKNOWN, meaning
from cylforce.programs.wording.plain import WHEN, plain
from cylforce.settings.machine_file import load
from scenarios import CONFIG

LOADED = load(CONFIG / "excavator_20t.toml").service
MACHINE = LOADED.machine
JARGON = re.compile(r"nats|residual|rms|regime|regressor|posterior|_|N m\b", re.IGNORECASE)
SPOT = {"channel": "stick", "regime": "slow", "share": 0.81, "p": 0.001, "found": True}
SIZE = {"value": -52300.0, "low": -61000.0, "high": -44000.0, "unit": "Pa"}
BAR = {"stick": {"fixed": 2.46, "after": 0.31, "floor": 0.29}, "boom": {"fixed": 0.3, "after": 0.3, "floor": 0.29}}


def effect(name="pressure_offset", at="stick_rod_pressure", size=SIZE, when="", confidence=0.87):
    closure = {"value": 0.96, "low": 0.9, "high": 0.99}
    return {
        "name": name,
        "at": at,
        "when": when,
        "parameters": {"size": size},
        "shape": {},
        "confidence": confidence,
        "confused_with": [],
        "closure": closure,
    }


def answered(verdict, *effects, unknown=None):
    """An answer as `diagnose` gives it."""
    rivals = [
        {"name": "pressure_offset", "at": "stick_rod_pressure", "probability": 0.7},
        {"name": "coulomb_friction", "at": "stick", "probability": 0.2},
    ]
    keys = [
        *({k: r[k] for k in ("name", "at")} for r in rivals),
        {"name": "unknown", "at": ""},
        {"name": "no_gap", "at": ""},
    ]
    return {
        "verdict": verdict,
        "gap": {"bar": BAR},
        "where": [SPOT],
        "effects": list(effects),
        "end_quantities": {
            "payload_kg": {"before": 43.21, "after": 1.2},
            "tip_force_n": {"before": 912.0, "after": 88.0},
        },
        "probabilities": {"no_gap": 0.02, "unknown": 0.08, "effects": rivals},
        "set": keys,
        "unknown": unknown,
        "warnings": ["the sensor x shakes"],
        "next_experiment": ["move the stick alone"],
        "reason": "nothing moved",
        "working": verdict == "not_observable",
    }


def text(answer):
    said = plain(MACHINE, answer)
    return " ".join([said.headline, *(f"{p.title}: {' '.join(p.lines)}" for p in said.points)])


def test_two_causes_that_are_one_answer_are_said_together():
    mass = effect("extra_mass", "boom", {"value": 80.0, "low": 70.0, "high": 90.0, "unit": "kg"})
    said = text(answered("explained", mass | {"same_as": [{"name": "first_moment_change", "at": "boom"}]}))
    assert "Very probably extra mass on the boom or a shifted centre of gravity of the boom." in said


def test_a_cause_is_said_with_all_that_a_mechanic_asks():
    said = text(answered("explained", effect()))
    for part in (
        "Very probably a wrong zero of the rod-side pressure sensor of the stick cylinder.",
        "0.523 bar too low (90 % sure: 0.44 to 0.61)",
        "At the stick, above all while it moves slowly.",
        "87 %: of ten such answers about 9 are right.",
        "20 %: changed dry friction in the stick cylinder",
        "8 %: something that is none of the known faults",
        "weights are wrong by about 43 kg, forces at the teeth by 910 N",
        "about 1.2 kg and 88 N",
        "the stick cylinder falls from 2.5 to 0.31 bar; 0.29 bar is normal",
        "96 % of the difference",
        "The sensor x shakes.",
        "Move the stick alone.",
    ):
        assert part in said


BEGINNINGS = {
    Verdict.NO_GAP: "No fault found",
    Verdict.EXPLAINED: "Very probably a wrong zero",
    Verdict.PARTLY: "Very probably a wrong zero",
    Verdict.AMBIGUOUS: "Not decided yet.",
    Verdict.UNKNOWN: "Something is wrong at the boom that is none of the known faults; it depends on the load.",
    Verdict.NOT_OBSERVABLE: "The cause cannot be named while the machine works",
}


def likeliest(verdict):
    """Probabilities by which the verdict is the likeliest, where it names no fault."""
    if verdict is Verdict.NO_GAP:
        return {"probabilities": in_order(0.95)}
    none = {"no_gap": 0.1, "unknown": 0.8, "effects": [{"name": "soil_contact", "at": "bucket", "probability": 0.1}]}
    return {"probabilities": none} if verdict is Verdict.UNKNOWN else {}


def in_order(probability):
    """Probabilities of a machine in order, and of a cause that the library lacks."""
    return {"no_gap": probability, "unknown": 1.0 - probability, "effects": []}


def test_a_machine_that_is_only_probably_in_order_is_called_so():
    unsure, sure = (text(answered("no_gap") | {"probabilities": in_order(p)}) for p in (0.6, 0.9))
    assert unsure.startswith("Probably no fault")
    assert sure.startswith("No fault found")


def test_what_a_machine_in_order_may_show_is_no_fault():
    """It moves otherwise than in its references; the machine does not work."""
    said = text(answered("not_observable") | {"working": False})
    assert said.startswith("These recordings do not suffice: they differ from the references, but so may a machine in")
    assert "while the machine works" not in said


def test_an_unknown_fault_is_not_claimed_where_a_known_one_is_likelier():
    """It may be withdrawn by its simulation, or stand beside too many others."""
    said = text(answered("unknown", unknown={"at": "boom", "of": "load", "detail": "", "share": 0.5}))
    assert said.startswith("Something is wrong at the boom; which fault it is cannot be said yet; it depends on")
    assert "How sure" not in said
    assert "that it is none of them" not in said
    many = [{"name": "soil_contact", "at": f"{k}", "probability": 0.075} for k in range(12)]
    each = {"probabilities": {"no_gap": 0.02, "unknown": 0.08, "effects": many}}
    assert "cannot be said yet" in plain(MACHINE, answered("unknown") | each).headline


@pytest.mark.parametrize("verdict", Verdict)
def test_every_verdict_has_its_words_without_jargon(verdict):
    named = (effect(),) if verdict in (Verdict.EXPLAINED, Verdict.PARTLY, Verdict.AMBIGUOUS) else ()
    shape = {"at": "boom", "of": "load", "detail": "", "share": 0.5} if verdict is Verdict.UNKNOWN else None
    said = text(answered(str(verdict), *named, unknown=shape) | likeliest(verdict))
    assert said.startswith(BEGINNINGS[verdict])
    assert not JARGON.search(said)
    assert ("only a part" in said) == (verdict is Verdict.PARTLY)


def test_in_order_nothing_is_to_be_done():
    assert "Move the stick" not in text(answered("no_gap"))


def test_nothing_concluded_says_why():
    answer = {"verdict": "not_observable", "effects": [], "reason": "only 3 s of usable motion"}
    assert text(answer) == "Nothing can be concluded: only 3 s of usable motion."


def test_clocks_that_are_apart_say_by_how_much():
    size = {"value": 0.35, "low": 0.33, "high": 0.37, "unit": "s"}
    answer = {"verdict": "explained", "effects": [effect("clock_fault", "machine", size)], "reason": "0.35 s late"}
    said = text(answer)
    assert "pressures and angles that were recorded on different clocks" in said
    assert "350 ms (90 % sure: 330 to 370)" in said
    assert "0.35 s late." in said


@pytest.mark.parametrize("path", sorted(CONFIG.glob("*.toml")), ids=lambda path: path.stem)
def test_every_effect_at_every_place_has_words(path):
    machine = load(path).service.machine
    for p in proposals(machine):
        assert p.name in WORDS
        said = fault(machine, p.name, p.at)
        assert "{" not in said
        assert p.name == "clock_fault" or "_" not in said.replace(p.at, "")
        size = {"value": p.about.low, "low": p.about.low, "high": p.about.high, "unit": p.about.unit}
        told = effect(p.name, p.at, size) | {"shape": p.shape}
        assert not re.search(r"Pa\b|rad|s/m|e[+-]\d", amount(machine, told))


def test_all_units_are_told_in_those_of_every_day():
    silent = {"rad (m)", "rad^2/s^2"}  # told otherwise
    assert {group[0].about.unit for group in LIBRARY} <= set(TOLD) | silent


def test_an_effect_of_the_users_own_keeps_its_name():
    assert fault(MACHINE, "loose_bolt", "stick") == "loose bolt at stick"


def test_a_length_sensor_is_told_in_millimetres():
    crane = load(CONFIG / "excavator_20t.toml").service.machine
    size = {"value": 0.02, "low": 0.01, "high": 0.03, "unit": "rad (m)"}
    assert amount(crane, effect("angle_offset", "stick_angle", size)).startswith("1.15 degrees too high")
    assert place(crane, "machine") == "the machine"


@pytest.mark.parametrize("when", ["from 12 s on", "3 times"])
def test_how_much_fell_out_is_said(when):
    size = {"value": -76.0, "low": -82.0, "high": -70.0, "unit": "kg"}
    told = effect("payload_spill", "bucket", size, when)
    said = plain(MACHINE, answered("explained", told))
    assert f"76 kg less (90 % sure: 70 to 82), {when}." in [line for point in said.points for line in point.lines]


def test_direction_of_friction():
    size = {"value": 1200.0, "low": 900.0, "high": 1500.0, "unit": "N"}
    told = effect("asymmetric_friction", "stick", size) | {"shape": {"way": -1}}
    assert amount(MACHINE, told) == "1200 N more than before (90 % sure: 900 to 1500), while it retracts"


def test_the_terminal_cuts_nothing_off_at_80_columns(capsys):
    show(SimpleNamespace(answer=answered("ambiguous", effect())), MACHINE, Console(width=80, highlight=False))
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    assert "…" not in out
    for part in text(answered("ambiguous", effect())).replace(":", "").split():
        assert part in out.replace(":", "")
    assert "pressure_offset@stick_rod_pressure" in out


def test_every_circumstance_has_words():
    assert set(WHEN) == set(REGIMES)


@pytest.mark.parametrize("incident", [None, ("soil_contact", "bucket"), ("unknown", "")])
def test_moments_that_do_not_count_are_told_without_jargon(incident):
    told = happening_beside(MACHINE, 12.0, incident)
    assert "12 s" in told
    assert not JARGON.search(told)
    assert incident is None or fault(MACHINE, *incident) in told
    assert happening_beside(MACHINE, 0.0, incident) == ""


def test_without_references_no_sentence_speaks_of_them():
    answer = answered("not_observable") | {"working": False, "compared_with": "identification"}
    assert "they differ from the identified model, but so may" in text(answer)
    assert "reference" not in text(answer)


@pytest.mark.parametrize(
    ("source", "than"),
    [
        ("references", "than before"),
        ("simulation", "than in the simulation"),
        ("identification", "than identified"),
    ],
)
def test_only_what_was_recorded_before_is_said_to_have_changed_since(source, than):
    size = {"value": 1200.0, "low": 900.0, "high": 1500.0, "unit": "N"}
    said = text(answered("explained", effect("coulomb_friction", "stick", size)) | {"compared_with": source})
    assert f"1200 N more {than} (90 % sure" in said
    assert ("before" in said) == (source == "references")


FIRST = {"because": "nobody has identified this machine", "share": 0.953, "parameters": []}
CHANGES = [
    {"name": "stick.X", "unit": "kg m", "before": 1080.0, "after": 1000.0, "torque": 900.0},
    {"name": "boom.coulomb", "unit": "N", "before": 0.0, "after": 4100.0, "torque": 300.0},
]


def test_where_the_machine_was_not_identified_that_comes_first():
    """With the parameters that are wrong, and nothing of an effect."""
    said = text(answered("not_observable") | {"identify_first": FIRST | {"parameters": CHANGES}, "effects": []})
    assert said.startswith("Identify the machine first: nobody has identified this machine.")
    assert "alone removes 95 % of the difference" in said
    assert "In the model, the stick is 8 % too heavy; the dry friction of the boom is 4100 N too small." in said
    assert "How sure" not in said


@pytest.mark.parametrize("share", [0.0, -0.7])
def test_a_refit_that_does_not_reduce_the_difference_is_no_share_of_it(share):
    first = FIRST | {"share": share}
    said = text(answered("not_observable") | {"identify_first": first, "effects": []})
    assert "does not reduce the difference" in said
    assert "record motion in the air" in said
    assert "removes" not in said


def test_what_remains_once_the_parameters_are_identified_is_said_beside_them():
    known = FIRST | {"because": "the simulation's masses and friction are not this machine's"}
    said = text(answered("explained", effect()) | {"identify_first": known, "compared_with": "simulation"})
    assert "Then: Very probably a wrong zero of the rod-side pressure sensor of the stick cylinder." in said


def test_every_parameter_of_the_model_has_a_name_that_a_mechanic_knows():
    names = [parameter.name for parameter in Model(MACHINE, LOADED.filters, FRICTION).parameters]
    assert UNKNOWN[0] not in {meaning(name) for name in names}
    assert not [name for name in names if JARGON.search(meaning(name))]
