"""How large must a change be to be found? Changes planted into the evidence of a fleet's machines in order: what a
recording tells is linear in the quantities, so that a change by D adds information @ D to its pull. Each time the
machine's recordings are reordered: of a machine in order, one day is as good as another."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from cylforce.diagnosis.constants import CREDIBLE
from cylforce.fleet import fleet as module
from cylforce.fleet.causes import ChangeCause
from cylforce.fleet.changes import MachineChange, Shape, changes
from cylforce.fleet.fleet import Dated, Fleet, fleet
from cylforce.fleet.history import History
from cylforce.mechanics.machine import Machine
from cylforce.programs.fleet.analysis import OfType
from cylforce.signals.estimate import Array
from studies._fleets import CAUSES, MASS_SHAPE, RANGES, Faulty, drawn, places

SURE = (0.985, CREDIBLE, 0.8, 2.0 / 3.0, 0.5)  # probabilities from which a change is told
TIMES = tuple(2.0 ** (0.5 * k) for k in range(-8, 3))  # of the smallest size that the study draws
FLEETS = 20_000  # of ten changes each, drawn from those that were planted
UNITS = {"friction_level_change": (100.0, "%"), "pressure_offset": (1e-5, "bar"), "extra_mass": (1.0, "kg")}
Judge = Callable[[MachineChange, Faulty], bool]  # whether what is told is a fault, with its day and its cause
DEGREES = (float(np.degrees(1.0)), "deg")


class Planted(NamedTuple):
    """A change that was planted, None: none; what was told from each probability of SURE on: anything; with its day and
    its cause."""

    fault: Faulty | None
    told: tuple[bool, ...]
    right: tuple[bool, ...]


class Field(NamedTuple):
    """A fleet's machines as changes are looked for in them, those in order and, with their faults, the others; what may
    have changed."""

    machine: Machine
    histories: Sequence[History]
    changed: Sequence[tuple[History, Faulty]]
    found: Sequence[ChangeCause]


def field(kind: OfType, truth: Mapping[str, Faulty], recordings: Mapping[str, Sequence[Dated]]) -> Field:
    """Of the machines of a type."""
    seen: list[tuple[History, Sequence[ChangeCause]]] = []

    def keeping(history: History, found: Sequence[ChangeCause]) -> list[MachineChange]:
        seen.append((history, found))
        return changes(history, found)

    with patch.object(module, "changes", keeping):
        said: Fleet = fleet(kind.model, recordings)
    last = {name: each[0] for name, each in zip(said.machines, seen[-len(said.machines) :], strict=True)}
    in_order = [history for name, history in last.items() if name not in truth]
    return Field(kind.model.machine, in_order, [(last[name], fault) for name, fault in truth.items()], seen[-1][1])


def planted(of: Field, right: Judge, repeated: int, rng: np.random.Generator) -> list[Planted]:
    """In every machine, each time in another order of its recordings: nothing, then each cause in a size and a place as
    the study draws them."""
    found = []
    for _ in range(repeated):
        for history in of.histories:
            mixed = _reordered(history, rng)
            days = len(mixed.t)
            found.append(_asked(of, mixed, None, right))
            found += [_asked(of, mixed, drawn(of.machine, "", name, days, rng), right) for name in CAUSES]
    return found


def ladder(of: Field, right: Judge, rng: np.random.Generator) -> list[Planted]:
    """In every machine one change of each cause, place and size, with half of the recordings before it."""
    found = []
    for history in of.histories:
        mixed = _reordered(history, rng)
        for name in CAUSES:
            for at in places(of.machine, name):
                for times in TIMES:
                    fault = Faulty("", name, at, RANGES[name][0] * times, len(mixed.t) // 2)
                    found.append(_asked(of, mixed, fault, right, (CREDIBLE,)))
    return found


def _reordered(history: History, rng: np.random.Generator) -> History:
    order = rng.permutation(len(history.t))
    return replace(history, information=history.information[order], pull=history.pull[order])


def _asked(of: Field, history: History, fault: Faulty | None, right: Judge, from_: Sequence[float] = SURE) -> Planted:
    if fault is not None:
        on = np.arange(len(history.t)) >= fault.first
        moved = history.information @ _direction(of, fault)
        history = replace(history, pull=history.pull + on[:, None] * moved)
    return _found(of, history, fault, right, from_)


def _found(of: Field, history: History, fault: Faulty | None, right: Judge, from_: Sequence[float] = SURE) -> Planted:
    each = [_lasting(changes(history, of.found, sure)) for sure in from_]
    named = [fault is not None and any(right(a, fault) for a in altered) for altered in each]
    return Planted(fault, tuple(map(bool, each)), tuple(named))


def _lasting(altered: Sequence[MachineChange]) -> list[MachineChange]:
    return [a for a in altered if a.shape is not Shape.DAY]


def _direction(of: Field, fault: Faulty) -> Array:
    """By how much the quantities of a machine change (K,)."""
    at, ratio = fault.at.partition("_")[0], 1.0
    if fault.name == "pressure_offset" and fault.at.endswith("rod_pressure"):
        ratio = -next(c.area_rod / c.area_head for c in of.machine.cylinders if c.name == at)
    place = at if fault.name == "pressure_offset" else fault.at
    directions = next(c.directions for c in of.found if (c.name, c.at) == (fault.name, place))
    sizes = np.array(MASS_SHAPE if fault.name == "extra_mass" else (ratio,))
    return np.asarray(directions @ sizes * fault.size)


def shown(of: Field, right: Judge, repeated: int) -> dict[str, Any]:
    """Plant, print, and give the figures."""
    rng = np.random.default_rng(0)
    trials, steps = planted(of, right, repeated, rng), ladder(of, right, rng)
    console = Console(highlight=False, soft_wrap=True)
    order = [t for t in trials if t.fault is None]
    itself = [*(_asked(of, h, None, right) for h in of.histories), *(_found(of, *each, right) for each in of.changed)]
    heads = ("told from", *(name.replace("_", " ") for name in CAUSES), "of ten: mean", "9 or 10", "in order, told")
    table = Table(*heads, "this fleet: found", "told in order", title="as the study draws them")
    found = []
    for k, sure in enumerate(SURE):
        by_cause = {name: np.array([t.right[k] for t in trials if t.fault and t.fault.name == name]) for name in CAUSES}
        tens = _tens(by_cause, rng)
        row = {"sure": sure} | {name: float(own.mean()) for name, own in by_cause.items()}
        row |= {"of_ten": float(tens.mean()), "nine_or_ten": float(np.mean(tens >= 9))}
        row |= {"in_order_told": float(np.mean([t.told[k] for t in order]))}
        row |= {"own_found": sum(t.right[k] for t in itself if t.fault)}
        found.append(row | {"own_in_order_told": sum(t.told[k] for t in itself if t.fault is None)})
        table.add_row(*(f"{value:.4g}" for value in found[-1].values()))
    console.print(table)
    console.print(f"{len(order)} times no change, {len(trials) - len(order)} changes")
    sizes = Table(
        "cause", "place", "half are found from", "90 % from", title="half of the recordings before the change"
    )
    told = _sizes(steps)
    for each in told:
        scale, unit = UNITS.get(each["cause"], DEGREES)
        sizes.add_row(each["cause"], each["at"], *(f"{scale * each[name]:.3g} {unit}" for name in ("half", "most")))
    console.print(sizes)
    return {"told_from": found, "detectable": told}


def _tens(by_cause: Mapping[str, Array], rng: np.random.Generator) -> NDArray[np.intp]:
    """How many of ten changes are found in each of FLEETS fleets, each with every cause in turn, from any on."""
    tens = np.zeros(FLEETS, dtype=np.intp)
    begin = rng.integers(len(CAUSES), size=FLEETS)
    for k in range(10):
        for c, name in enumerate(CAUSES):
            own = (begin + k) % len(CAUSES) == c
            tens[own] += rng.choice(by_cause[name], size=int(own.sum()))
    return tens


def _sizes(steps: Sequence[Planted]) -> list[dict[str, Any]]:
    """From which size on half and nine of ten changes are found, between sizes that were planted."""
    found = []
    for name, at in dict.fromkeys((t.fault.name, t.fault.at) for t in steps if t.fault):
        own = [t for t in steps if t.fault and (t.fault.name, t.fault.at) == (name, at)]
        sizes = np.array([RANGES[name][0] * times for times in TIMES])
        share = np.array([np.mean([t.right[0] for t in own if t.fault and t.fault.size == size]) for size in sizes])
        rising = np.maximum.accumulate(share)
        half, most = (float(np.exp(np.interp(p, rising, np.log(sizes), np.nan, np.nan))) for p in (0.5, 0.9))
        found.append({"cause": name, "at": at, "half": half, "most": most, "shares": share.tolist()})
    return found
