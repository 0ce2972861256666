"""What the report of a gap says in words and numbers, in the reader's units: pure."""

from typing import Any, NamedTuple

import numpy as np

from cylforce.diagnosis.answer.verdict import Judged, Search
from cylforce.diagnosis.inference.posterior import UNKNOWN
from cylforce.effects.library import Proposal
from cylforce.mechanics.machine import Machine
from cylforce.programs.reports.units import interval, shown
from cylforce.programs.wording.fault_words import fault, place
from cylforce.signals.kinds import Kind

FORMS = {"width": "m/s", "way": "m", "turning": "N m"}  # numbers of an effect's form that say something, with SI unit
LEAST_TOLD = 0.01  # probability of a rival that is listed


class CauseLine(NamedTuple):
    """A cause that is named, for the table."""

    effect: str
    at: str
    size: str
    interval: str
    form: str
    confidence: str
    shows: str


class Rival(NamedTuple):
    """What might be the cause instead: how probable it is, and how to confirm it."""

    named: str
    rival: str
    probability: str
    close: bool
    confirm: str


class Least(NamedTuple):
    """Smallest detectable sizes of one effect, (place, size, whether implausibly large) each."""

    effect: str
    plausible: str
    places: tuple[tuple[str, str, bool], ...]


def lines(machine: Machine, judged: Judged, answer: dict[str, Any]) -> tuple[CauseLine, ...]:
    """The named causes."""
    return tuple(
        _line(machine, named.cause.proposal, effect)
        for named, effect in zip(judged.named, answer["effects"], strict=True)
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
        f"{100 * effect['confidence']:.0f} %",
        proposal.about.shows,
    )


def unit_of(machine: Machine, proposal: Proposal) -> str:
    """SI unit of an effect's size; a joint's angle may be measured as a cylinder's length."""
    unit = proposal.about.unit
    if unit != "rad (m)":
        return unit
    return "m" if machine.signals[proposal.where].kind is Kind.CYLINDER_LENGTH else "rad"


def rivals(machine: Machine, search: Search, judged: Judged) -> tuple[Rival, ...]:
    """What else it may be, the most probable first."""
    found = []
    for n in judged.named[:1]:
        close = {r.key for r in n.confused}
        for r in search.first:
            if r.key == n.cause.key or not r.known or r.probability < LEAST_TOLD:
                continue
            names = [fault(machine, *key) for key in (n.cause.key, r.key)]
            confirm = r.proposal.about.confirm
            found.append(Rival(names[0], names[1], f"{100 * r.probability:.0f} %", r.key in close, confirm))
    return tuple(found)


def least(search: Search) -> tuple[Least, ...]:
    """Smallest detectable size (5 sigma) of every effect at every place."""
    best: dict[str, list[tuple[float, Proposal]]] = {}
    for proposal in {(p.name, p.at): p for p in search.original.proposals}.values():
        if (proposal.name, proposal.at) in search.least and proposal.name != UNKNOWN[0]:
            best.setdefault(proposal.name, []).append((search.least[proposal.name, proposal.at], proposal))
    machine = search.original.model.machine
    return tuple(_least(machine, name, found) for name, found in best.items())


def _least(machine: Machine, name: str, found: list[tuple[float, Proposal]]) -> Least:
    about, unit = found[0][1].about, unit_of(machine, found[0][1])
    places = tuple(
        (p.at, shown(size, unit_of(machine, p)) if np.isfinite(size) else "never", bool(size > about.high / 2.0))
        for size, p in found
    )
    return Least(name.replace("_", " "), interval(about.low, about.high, unit), places)
