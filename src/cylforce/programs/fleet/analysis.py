"""Analysis of a fleet from the evidence of its recordings: types, order in time, contradictions, changes."""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from typing import NamedTuple

from cylforce.estimation.model import Model
from cylforce.fleet.coordinates import coordinates, followed_model
from cylforce.fleet.fleet import Dated, Fleet, MachineResult, fleet
from cylforce.programs.fleet.gathering import ABSOLUTE_S, Gathered
from cylforce.programs.fleet.task import DOUBTFUL, OK
from cylforce.signals.parallel import ParallelMap

DAY_S = 86400.0


class Ordered(NamedTuple):
    """Recordings of a machine with evidence, in order of time.

    machine:    its name
    recordings: the recordings
    dated:      whether they have dates
    """

    machine: str
    recordings: tuple[Gathered, ...]
    dated: bool


class OfType(NamedTuple):
    """Machines of one type.

    name:     of the type in the machine file
    model:    model of the first machine file
    machines: recordings by name of the machine
    fleet:    result of the analysis
    """

    name: str
    model: Model
    machines: Mapping[str, Ordered]
    fleet: Fleet

    def told(self, machine: str) -> MachineResult:
        """Return the result of a machine."""
        return self.fleet.machines[machine]


class Analysis(NamedTuple):
    """Analysis of all types.

    types: the types
    notes: sentences by address of a recording: why it is not used, or its cure
    """

    types: tuple[OfType, ...]
    notes: Mapping[str, str]


def analysed(gathered: Sequence[Gathered]) -> Analysis:
    """Return the analysis of the fleet of each type."""
    notes: dict[str, str] = {}
    groups: dict[str, dict[str, list[Gathered]]] = {}
    parts = _Parts()
    first = _most(gathered, parts)
    for each in gathered:
        if each.loaded is None:
            continue
        kind = each.machine_file.service.machine.name
        model = first[kind]
        if parts.of(each) != parts.of(model):
            notes[each.stored.address] = (
                f"its machine file has other parts than that of {model.stored.machine}, which is of the type {kind!r}, "
                "too: give one of them another name in [machine]"
            )
            continue
        if each.outcome.told is None or each.outcome.facts["state"] not in (OK, DOUBTFUL):
            continue
        groups.setdefault(kind, {}).setdefault(each.stored.machine, []).append(each)
    with ThreadPoolExecutor(os.cpu_count()) as threads:  # numpy's arithmetic on large arrays runs beside other threads
        types = _types(groups, first, notes, lambda work, each: list(threads.map(work, each)))
    return Analysis(tuple(types), notes)


def _most(gathered: Sequence[Gathered], parts: "_Parts") -> dict[str, Gathered]:
    """Return the first recording of each type, by name, among those with its most frequent parts."""
    found: dict[str, dict[tuple[str, ...], list[Gathered]]] = {}
    for each in gathered:
        if each.loaded is not None:
            kind = each.machine_file.service.machine.name
            found.setdefault(kind, {}).setdefault(parts.of(each), []).append(each)
    return {kind: max(alike.values(), key=len)[0] for kind, alike in found.items()}


def _types(
    groups: Mapping[str, Mapping[str, list[Gathered]]],
    first: Mapping[str, Gathered],
    notes: dict[str, str],
    beside: ParallelMap,
) -> list[OfType]:
    types = []
    for kind, machines in sorted(groups.items()):
        model_of_type = followed_model(first[kind].machine_file.service)
        ordered = {name: _ordered(name, each, notes) for name, each in sorted(machines.items())}
        recordings = {name: dated(each) for name, each in ordered.items()}
        types.append(OfType(kind, model_of_type, ordered, fleet(model_of_type, recordings, beside)))
    return types


class _Parts(dict[str, tuple[str, ...]]):
    """Cache of the names of a machine's parts, by hash of the machine file, which many recordings share."""

    def of(self, each: Gathered) -> tuple[str, ...]:
        loaded = each.machine_file
        if loaded.sha256 not in self:
            self[loaded.sha256] = tuple(c.name for c in coordinates(followed_model(loaded.service)))
        return self[loaded.sha256]


def _ordered(name: str, recordings: Sequence[Gathered], notes: dict[str, str]) -> Ordered:
    """Return the recordings in order of time; among dated recordings one without a date is excluded."""
    dated = [each for each in recordings if each.made]
    if not dated:
        return Ordered(name, tuple(sorted(recordings, key=lambda each: each.stored.name)), dated=False)
    for each in recordings:
        if not each.made:
            notes[each.stored.address] = "has no date in its name, as the others of the machine have: write it there"
    ordered = sorted(dated, key=lambda each: (each.made, each.stored.name))
    latest = 0.0
    for each in ordered:
        begins = float(each.outcome.facts.get("begins_s", 0.0))
        if ABSOLUTE_S < begins < latest:
            notes[each.stored.address] = (
                f"its clock says {datetime.fromtimestamp(begins).date()}, which is before the recording before it: the "  # noqa: DTZ006
                "date in its name counts; set the clock"
            )
        latest = max(latest, begins if begins > ABSOLUTE_S else 0.0)
    return Ordered(name, tuple(ordered), dated=True)


def dated(ordered: Ordered) -> list[Dated]:
    """Return recordings with their times [d]; without dates one a day."""
    found = []
    for k, each in enumerate(ordered.recordings):
        t = datetime.fromisoformat(each.made).timestamp() / DAY_S if ordered.dated else float(k)
        found.append(Dated(t, each.evidence))
    return found
