"""Content of the report of a gap in words and numbers, in the reader's units: pure."""

from typing import Any, NamedTuple

import numpy as np

from cylforce.diagnosis import Diagnosis
from cylforce.diagnosis.explain import smallest_detectable
from cylforce.diagnosis.search import NO_GAP, UNKNOWN
from cylforce.effects.library import Proposal
from cylforce.mechanics.machine import Machine
from cylforce.programs.reports.units import interval, shown
from cylforce.programs.wording.fault_words import fault, place
from cylforce.programs.wording.plain import percent
from cylforce.signals.kinds import Kind

FORMS = {"width": "m/s", "way": "m", "turning": "N m"}  # shape parameters with a meaning for the reader, with SI unit
LEAST_TOLD = 0.01  # probability of a rival that is listed


class CauseLine(NamedTuple):
    """Named cause in the table.

    effect:     name of the effect
    at:         its location
    size:       its size with unit
    interval:   90 % interval of the size
    form:       shape parameters
    confidence: its probability
    shows:      where the effect is visible
    """

    effect: str
    at: str
    size: str
    interval: str
    form: str
    confidence: str
    shows: str


class Rival(NamedTuple):
    """Cause that is possible instead of the named one.

    named:       the named cause
    rival:       the other one
    probability: its probability
    close:       whether it may be confused with the named one
    confirm:     check that confirms it
    """

    named: str
    rival: str
    probability: str
    close: bool
    confirm: str


class Least(NamedTuple):
    """Smallest detectable sizes of one effect.

    effect:    its name
    plausible: range of its plausible sizes
    places:    location, size, and whether the size is implausibly large
    """

    effect: str
    plausible: str
    places: tuple[tuple[str, str, bool], ...]


def lines(machine: Machine, found: Diagnosis, answer: dict[str, Any]) -> tuple[CauseLine, ...]:
    """Return the named causes."""
    return tuple(
        _line(machine, named.cause.proposal, effect)
        for named, effect in zip(found.named, answer["effects"], strict=True)
    )


def _line(machine: Machine, proposal: Proposal, effect: dict[str, Any]) -> CauseLine:
    size, unit = effect["parameters"]["size"], unit_of(machine, proposal)
    form = [
        f"{name} {shown(effect['shape'][name], si)}"
        for name, si in FORMS.items()
        if isinstance(effect["shape"].get(name), float)  # a whole number is a direction
    ]
    return CauseLine(
        effect["name"].replace("_", " "),
        place(machine, effect["at"]),
        shown(size["value"], unit),
        interval(size["low"], size["high"], unit),
        ", ".join([*([effect["when"]] if effect["when"] else []), *form]),
        percent(effect["confidence"]),
        proposal.about.shows,
    )


def unit_of(machine: Machine, proposal: Proposal) -> str:
    """Return the SI unit of an effect's size; a joint's angle may be measured as a cylinder's length."""
    unit = proposal.about.unit
    if unit != "rad (m)":
        return unit
    return "m" if machine.signals[proposal.where].kind is Kind.CYLINDER_LENGTH else "rad"


def rivals(machine: Machine, found: Diagnosis) -> tuple[Rival, ...]:
    """Return the other possible causes, the most probable first."""
    evidence, rows = found.evidence, []
    about = {(p.name, p.at): p.about for p in evidence.found.question.machine.layout.proposals}
    for n in found.named[:1]:
        close = set(n.rivals)
        for key, probability in sorted(evidence.posterior.items(), key=lambda item: -item[1]):
            if key in (n.cause.key, NO_GAP, UNKNOWN) or key not in about or probability < LEAST_TOLD:
                continue
            names = [fault(machine, *each) for each in (n.cause.key, key)]
            rows.append(Rival(names[0], names[1], f"{100 * probability:.0f} %", key in close, about[key].confirm))
    return tuple(rows)


def least(found: Diagnosis) -> tuple[Least, ...]:
    """Return the smallest detectable size (5 sigma) of every effect at every location."""
    best: dict[str, list[tuple[float, Proposal]]] = {}
    question, sizes = found.evidence.found.question, smallest_detectable(found.evidence.found)
    for proposal in {(p.name, p.at): p for p in question.machine.layout.proposals}.values():
        key = proposal.name, proposal.at
        if key in sizes and proposal.name != UNKNOWN[0]:
            best.setdefault(proposal.name, []).append((sizes[key], proposal))
    machine = question.machine.regressors.model.machine
    return tuple(_least(machine, name, each) for name, each in best.items())


def _least(machine: Machine, name: str, found: list[tuple[float, Proposal]]) -> Least:
    about, unit = found[0][1].about, unit_of(machine, found[0][1])
    places = tuple(
        (p.at, shown(size, unit_of(machine, p)) if np.isfinite(size) else "never", bool(size > about.high / 2.0))
        for size, p in found
    )
    return Least(name.replace("_", " "), interval(about.low, about.high, unit), places)
