"""What the report of a gap says in words and numbers, in the reader's units: pure."""

from typing import Any, NamedTuple

import numpy as np

from cylforce.diagnosis.posterior import UNKNOWN
from cylforce.diagnosis.verdict import Judged, Search, Verdict
from cylforce.effects.library import Proposal
from cylforce.mechanics.machine import Machine
from cylforce.programs.reports.findings import Card
from cylforce.programs.reports.units import interval, shown
from cylforce.signals.kinds import Kind

SURE = 0.9  # confidence from which on a repair may be based on the name; chosen
CLOSED = 0.9  # of the gap's energy
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
    """What might be the cause instead: its evidence relative to that of the one named, and how to confirm it."""

    named: str
    rival: str
    relative: str
    close: bool
    confirm: str


class Least(NamedTuple):
    """Smallest detectable sizes of one effect, (place, size, whether implausibly large) each."""

    effect: str
    plausible: str
    places: tuple[tuple[str, str, bool], ...]


def cards(answer: dict[str, Any]) -> tuple[Card, ...]:
    """The numbers that are read first."""
    gap, ends, effects = answer["gap"], answer["end_quantities"], answer["effects"]
    good = answer["verdict"] in (Verdict.EXPLAINED, Verdict.NO_GAP)
    found = [Card("Verdict", answer["verdict"].replace("_", " "), _causes(len(effects)), good)]
    if effects:
        sure, closure = effects[0]["confidence"], effects[0]["closure"]
        found.append(Card("Confidence", f"{100 * sure:.0f} %", "that the first cause is right", sure >= SURE))
        found.append(_closed(closure))
    left = f"of {gap['fixed']:.0f} N m; floor {gap['floor']:.0f} N m"
    found.append(Card("Residual torque", f"{gap['after']:.0f} N m", left, gap["after"] < 1.5 * gap["floor"]))
    for title, key, unit in (("Weight error", "payload_kg", "kg"), ("Force error", "tip_force_n", "N")):
        before, after = (ends[key][k] for k in ("before", "after"))
        found.append(Card(title, shown(after, unit), f"before: {shown(before, unit)}", after <= before))
    return tuple(found)


def _closed(closure: dict[str, float | None]) -> Card:
    value, low, high = (closure[k] for k in ("value", "low", "high"))
    if value is None or low is None or high is None:
        return Card("Gap closed", "--", "too uncertain for a figure: see the torque", good=False)
    return Card("Gap closed", f"{100 * value:.0f} %", f"90 %: {100 * low:.0f} to {100 * high:.0f} %", value >= CLOSED)


def _causes(count: int) -> str:
    return "no cause is named" if not count else "one cause" if count == 1 else f"{count} causes"


def lines(machine: Machine, judged: Judged, answer: dict[str, Any]) -> tuple[CauseLine, ...]:
    """The named causes."""
    return tuple(
        _line(machine, named.cause.proposal, effect)
        for named, effect in zip(judged.named, answer["effects"], strict=True)
    )


def _line(machine: Machine, proposal: Proposal, effect: dict[str, Any]) -> CauseLine:
    size, unit = effect["parameters"]["size"], unit_of(machine, proposal)
    form = [f"{name} {shown(effect['shape'][name], si)}" for name, si in FORMS.items() if name in effect["shape"]]
    return CauseLine(
        effect["name"].replace("_", " "),
        effect["at"],
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


def rivals(search: Search, judged: Judged) -> tuple[Rival, ...]:
    """What else it may be, the most probable first."""
    found = []
    for n in judged.named[:1]:
        close = {r.key for r in n.confused}
        for r in search.first:
            if r.key == n.cause.key or not r.known or r.probability < LEAST_TOLD:
                continue
            names = [" at ".join(key).replace("_", " ") for key in (n.cause.key, r.key)]
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
