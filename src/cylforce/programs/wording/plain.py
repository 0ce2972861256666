"""The answer of `cylforce gap` in plain words, for a service engineer, made of the answer alone. Pure."""

from math import isfinite
from typing import Any, NamedTuple

from cylforce.diagnosis.decide import Verdict
from cylforce.diagnosis.search import NO_GAP, UNKNOWN
from cylforce.mechanics.machine import Machine
from cylforce.programs.wording.fault_words import BEFORE, THAN, amount, fault, number
from cylforce.programs.wording.parameter_words import parameter_error
from cylforce.readings.constants import SURE

MOST = 0.6  # of a joint's difference, from which on a sentence has its circumstances; as for shapes
MOST_WHEN = 2  # circumstances in a sentence, at most
WITHOUT_SAYING = ("empty", "loaded")  # all of it is in one of them where the other was not recorded
WHEN = {
    "extending": "while its cylinder extends",
    "retracting": "while its cylinder retracts",
    "slow": "while it moves slowly",
    "fast": "while it moves fast",
    "empty": "with an empty bucket",
    "loaded": "with a load",
    "first half": "in the first half of the recording",
    "second half": "in the second half of the recording",
    "angle low": "at its smaller angles",
    "angle high": "at its larger angles",
}
SHAPES = {
    "speed": "it depends on how fast the cylinder moves",
    "position": "it depends on the joint's angle",
    "load": "it depends on the load",
    "time": "it changes with time",
    "moments": "it comes for moments only",
}
LIKELIHOODS = ((0.95, "Almost certainly"), (0.8, "Very probably"), (0.5, "Probably"), (0.0, "Possibly"))  # convention
MOST_OF = 0.9  # of a recording: if less was examined, a line reports it
LEAST = 0.01  # least probability of a rival in the answer
NEXT = "Do next"
Lines = tuple[str, ...]


class Paragraph(NamedTuple):
    """Paragraph of the answer.

    title: its title
    lines: one line or several
    """

    title: str
    lines: Lines


class Plain(NamedTuple):
    """Answer in plain words.

    headline: the answer in one sentence
    points:   paragraphs
    """

    headline: str
    points: tuple[Paragraph, ...]


def plain(machine: Machine, answer: dict[str, Any]) -> Plain:
    """Return the answer in plain words: fault, size, location, probability, other causes, consequences, next steps."""
    points = [Paragraph("Its model", _wrong_parameters(answer))]
    if "identify_first" not in answer or answer["effects"]:
        points += _of_the_cause(machine, answer)
    points += [
        Paragraph("Take care", tuple(sentence(text) for text in answer.get("warnings", ()))),
        Paragraph(NEXT, _next(answer)),
    ]
    return Plain(headline(machine, answer), tuple(point for point in points if point.lines))


def _of_the_cause(machine: Machine, answer: dict[str, Any]) -> list[Paragraph]:
    """Return the paragraphs on the cause, or on a difference without one."""
    return [
        Paragraph("How much", _sizes(machine, answer)),
        Paragraph("Where", _where(answer)),
        Paragraph("How sure", _sure(answer)),
        Paragraph("It may also be" if answer["effects"] else "It may be", _others(machine, answer)),
        Paragraph("What it does", _harm(answer)),
        Paragraph("Once corrected" if answer["effects"] else "How large", _shrinks(answer)),
    ]


def _wrong_parameters(answer: dict[str, Any]) -> Lines:
    """Return the parameters of the model that make most of the difference, with their errors."""
    first = answer.get("identify_first")
    if not first or not first["parameters"]:
        return ()
    largest = first["parameters"][:MOST_PARAMETERS]
    told = [parameter_error(p["name"], p["unit"], p["before"], p["after"]) for p in largest]
    return (sentence(f"in the model, {'; '.join(told)}"),)


MOST_PARAMETERS = 5  # in a sentence
IDENTIFY_FIRST = (
    "Identify the machine first: {because}. Fitting the model's masses and friction to these recordings alone removes "
    "{share} of the difference"
)
IDENTIFY_IN_THE_AIR = (
    "Identify the machine first: {because}. Fitting the model's masses and friction to these recordings does not "
    "reduce the difference, as in contact with the ground or with unknown loads: record motion in the air"
)
HEADLINES = {
    Verdict.NO_GAP: "No fault found: these recordings differ from the model no more than is normal for this machine",
    Verdict.EXPLAINED: "{found}",
    Verdict.PARTLY: "{found}; but that explains only a part of the difference",
    Verdict.AMBIGUOUS: "Not decided yet. {found}",
    Verdict.UNKNOWN: "Something is wrong{there} that is none of the known faults{shape}",
    Verdict.NOT_OBSERVABLE: (
        "The cause cannot be named while the machine works with loads or contact of which nothing is known"
    ),
}
UNLIKE = (
    "These recordings do not suffice: they differ from {normal}, but so may a machine in order that moves otherwise "
    "than in {known}"
)
KNOWN_BY = {  # sources of the healthy machine in words
    "references": {"normal": "the references", "known": "its references"},
    "simulation": {"normal": "the simulation", "known": "the simulated recordings"},
    "identification": {"normal": "the identified model", "known": "the recordings of its identification"},
}
LIKELY_IN_ORDER = (
    "{likely} no fault: these recordings differ from the model, but perhaps no more than is normal for this machine"
)
UNDECIDED = "Something is wrong{there}; which fault it is cannot be said yet{shape}"
SILENT = (Verdict.NO_GAP, Verdict.NOT_OBSERVABLE)  # there is no fault with a size


def headline(machine: Machine, answer: dict[str, Any]) -> str:
    """Return the verdict in a sentence or two."""
    if "gap" not in answer and not answer["effects"]:
        return f"Nothing can be concluded: {answer['reason']}."
    if "identify_first" in answer:
        first = answer["identify_first"]
        words_of_refit = IDENTIFY_FIRST if first["share"] > 0.0 else IDENTIFY_IN_THE_AIR
        identify = f"{words_of_refit.format(because=first['because'], share=percent(first['share']))}."
        return f"{identify} Then: {_found(machine, answer)}." if answer["effects"] else identify
    told = answer.get("unknown")
    words = {
        "found": _found(machine, answer),
        "there": f" at the {told['at']}" if told else "",
        "shape": f"; {SHAPES[told['of']]}" if told and told["of"] in SHAPES else "",
    }
    said = UNDECIDED if _undecided(answer) else HEADLINES[Verdict(answer["verdict"])]
    in_order = answer.get("probabilities", {"no_gap": 1.0})["no_gap"]
    if answer["verdict"] == Verdict.NO_GAP and in_order < SURE:
        said = LIKELY_IN_ORDER.format(likely=_likely(in_order))
    if answer["verdict"] == Verdict.NOT_OBSERVABLE and not answer["working"]:
        said = UNLIKE.format(**KNOWN_BY.get(answer.get("compared_with", ""), KNOWN_BY["references"]))
    return f"{said.format(**words)}."


def _undecided(answer: dict[str, Any]) -> bool:
    """Return whether no cause is named though the library's causes together are likelier than an unknown one.

    The simulation refuted the likeliest cause, or too many are possible.
    """
    known = answer.get("probabilities")
    if answer["verdict"] != Verdict.UNKNOWN or not known:
        return False
    return bool(1.0 - known["no_gap"] - known["unknown"] > known["unknown"])


def _found(machine: Machine, answer: dict[str, Any]) -> str:
    """Return the causes with a word for their probability; empty without any."""
    return f"{_likely(answer['effects'][0]['confidence'])} {_causes(machine, answer)}" if answer["effects"] else ""


def _likely(probability: float) -> str:
    return next(word for least, word in LIKELIHOODS if probability >= least)


def _causes(machine: Machine, answer: dict[str, Any]) -> str:
    first, *others = (_either(machine, e) for e in answer["effects"])
    return f"{first}; and with it {' and '.join(others)}" if others else first


def _either(machine: Machine, effect: dict[str, Any]) -> str:
    """Return a cause, with another one that no evidence separates from it."""
    each = (effect, *effect.get("same_as", ()))
    return " or ".join(fault(machine, e["name"], e["at"]) for e in each)


def _sizes(machine: Machine, answer: dict[str, Any]) -> Lines:
    """Return how large the causes are; each with its name, where there are several."""
    several, than = len(answer["effects"]) > 1, THAN.get(answer.get("compared_with", ""), BEFORE)
    return tuple(filter(None, (_size(machine, effect, than, named=several) for effect in answer["effects"])))


def _size(machine: Machine, effect: dict[str, Any], than: str, *, named: bool) -> str:
    """Return how large one cause is."""
    told = ", ".join(filter(None, (amount(machine, effect, than), effect["when"])))
    name = f"{fault(machine, effect['name'], effect['at'])}: " if named else ""
    return sentence(name + told) if told else ""


def _where(answer: dict[str, Any]) -> Lines:
    """Return the joints with a difference, each with its circumstances."""
    if answer["effects"] and "gap" not in answer:  # the clocks are apart
        return (sentence(str(answer["reason"])),)
    found = [spot for spot in answer.get("where", ()) if spot["found"]]
    joints = dict.fromkeys(spot["channel"] for spot in found)
    return tuple(_shows(joint, [spot for spot in found if spot["channel"] == joint]) for joint in joints)


def _shows(joint: str, found: list[dict[str, Any]]) -> str:
    kept = [s for s in found if s["share"] >= MOST and s["regime"] not in WITHOUT_SAYING]
    when = [WHEN[spot["regime"]] for spot in kept[:MOST_WHEN]]
    return f"At the {joint}{', above all ' + ' and '.join(when) if when else ''}."


def _sure(answer: dict[str, Any]) -> Lines:
    """Return the probability of the headline."""
    known = answer.get("probabilities", {})
    if _undecided(answer):
        return ()
    if answer["verdict"] in (Verdict.NO_GAP, Verdict.UNKNOWN) and known:
        said = "that the machine is in order" if answer["verdict"] == Verdict.NO_GAP else "that it is none of them"
        return (f"{percent(known[answer['verdict']])} {said}.",)
    if not answer["effects"]:
        return ()
    first = answer["effects"][0]["confidence"]
    many, count = ("ten", 10) if round(10 * first) < 10 else ("a hundred", 100)
    right = min(max(round(count * first), 1), count - 1)
    return (f"{percent(first)}: of {many} such answers about {right} are right.",)


def percent(probability: float) -> str:
    """Return a probability in percent, never quite 0 or 100 %."""
    return f"{min(max(round(100 * probability), 1), 99)} %"


def _others(machine: Machine, answer: dict[str, Any]) -> Lines:
    """Return the other causes in the 90 % credible set, by probability."""
    if "probabilities" not in answer:
        return ()
    named = {(e["name"], e["at"]) for e in answer["effects"]}
    own = {Verdict.NO_GAP: NO_GAP, Verdict.UNKNOWN: UNKNOWN}.get(Verdict(answer["verdict"]))
    known = _probable(answer["probabilities"])
    keys = [(m["name"], m["at"]) for m in answer["set"]]
    others = [key for key in keys if key not in named and key != own and known.get(key, 0.0) >= LEAST]
    others.sort(key=lambda key: -known[key])
    return tuple(f"{percent(known[key])}: {fault(machine, *key)}" for key in others)


def _probable(known: dict[str, Any]) -> dict[tuple[str, str], float]:
    found = {(e["name"], e["at"]): e["probability"] for e in known["effects"]}
    return {**found, NO_GAP: known["no_gap"], UNKNOWN: known["unknown"]}


def _harm(answer: dict[str, Any]) -> Lines:
    """Return the effect of the difference on weight and force."""
    ends = answer.get("end_quantities")
    if ends is None or answer["verdict"] in SILENT:
        return ()
    before, after = (
        (_amount(ends["payload_kg"][key], "kg"), _amount(ends["tip_force_n"][key], "N")) for key in ("before", "after")
    )
    told = f"As it is, weights are wrong by about {before[0]}, forces at the teeth by {before[1]}"
    if not answer["effects"]:
        return (f"{told}.",)
    return (f"{told}; with this corrected in the model, by about {after[0]} and {after[1]}.",)


def _amount(value: float | None, unit: str) -> str:
    known = value is not None and isfinite(value)
    return f"{number(float(f'{value:.2g}'))} {unit}" if known else "an unknown amount"


def _shrinks(answer: dict[str, Any]) -> Lines:
    """Return the explained share of the difference, at the cylinder with the largest difference."""
    bars = answer.get("gap", {}).get("bar")
    if not bars or answer["verdict"] in SILENT or answer.get("working"):
        return ()
    name, bar = max(bars.items(), key=lambda item: item[1]["fixed"] / max(item[1]["floor"], 1e-9))
    before, after, usual = (number(float(f"{bar[key]:.2g}")) for key in ("fixed", "after", "floor"))
    if not answer["effects"]:
        return (f"Unexplained at the {name} cylinder: {before} bar; {usual} bar is normal.",)
    closed = answer["effects"][0]["closure"]
    part = f" {_closed(closed)}" if closed["value"] is not None else ""
    return (f"The difference at the {name} cylinder falls from {before} to {after} bar; {usual} bar is normal.{part}",)


def _closed(closed: dict[str, float]) -> str:
    value, low, high = (f"{100 * closed[key]:.0f}" for key in ("value", "low", "high"))
    return f"In all, {value} % of the difference is explained (90 % sure: {low} to {high} %)."


def _next(answer: dict[str, Any]) -> Lines:
    """Return the next recordings or checks; empty for a healthy machine."""
    wanted = () if answer["verdict"] == Verdict.NO_GAP else answer.get("next_experiment", ())
    return tuple(sentence(text) for text in wanted)


def sentence(text: str) -> str:
    """Return a text with a capital and a full stop."""
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "?", "!")) else ".")


def looked(part: dict[str, Any]) -> str:
    """Return the examined share of a recording, in words."""
    many = f", in {part['stretches']} stretches" if part["stretches"] > 1 else ""
    return f"{part['seconds'] / 60.0:.1f} of {part['of_seconds'] / 60.0:.1f} min examined{many}"
