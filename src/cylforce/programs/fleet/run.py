"""`cylforce fleet`: every recording is read once, then the fleet is analysed; written as table, usual spread
and pages.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console

from cylforce.fleet.changes import Shape
from cylforce.programs.common.progress import Watch, silent
from cylforce.programs.common.usual_file import UsualOfType, write_usual
from cylforce.programs.fleet.analysis import Analysis, OfType, Ordered, analysed
from cylforce.programs.fleet.booking import bookings
from cylforce.programs.fleet.gathering import FLUSH_S, FleetReading, Gathered
from cylforce.programs.fleet.kept import KeptResults
from cylforce.programs.fleet.result import FleetChange, FleetResult
from cylforce.programs.fleet.rows import course_rows, write_rows
from cylforce.programs.fleet.store import found_in, namesakes
from cylforce.programs.fleet.task import FAILED, WORK, Booked
from cylforce.programs.fleet.words import told
from cylforce.programs.fleet.workers import Say, Where

MOST_TOLD = 20  # recordings that are reported on the terminal; all are in the table


class Wanted(NamedTuple):
    """Inputs and outputs of a run.

    recordings: addresses of the recordings
    output:     table to be written
    usual:      file of the usual spread to be written; None: none
    report:     page to be written; None: none
    cache:      folder of results of earlier runs; None: nothing is kept
    weights:    whether weights of working recordings are booked
    flush_s:    time after which the results so far can be read [s]
    """

    recordings: tuple[str, ...]
    output: Path
    usual: Path | None = None
    report: Path | None = None
    cache: Path | None = None
    weights: bool = True
    flush_s: float = FLUSH_S


def run_fleet(wanted: Wanted, where: Where, watch: Watch = silent, say: Say = print) -> FleetResult:
    """Read all recordings, and write the outputs. Raises RecordingError with a sentence."""
    watch("listing recordings", None)
    found = found_in(wanted.recordings)
    kept = KeptResults(wanted.cache)

    def flush(so_far: Sequence[Gathered]) -> None:
        write_rows(wanted.output, [_facts(each) for each in so_far])

    gathered = FleetReading(found, kept, where, watch, say, flush, wanted.flush_s).gathered()
    watch("what changed, what is usual", None)
    analysis = analysed(gathered)
    changed = tuple(_changes(analysis))
    rows = _rows(gathered, analysis, changed)
    write_rows(wanted.output, list(rows.values()))
    if wanted.weights and _booked(rows, bookings(gathered, kept, where, watch, say)):
        write_rows(wanted.output, list(rows.values()))
    if wanted.usual is not None:
        write_usual(wanted.usual, {each.name: _usual(each) for each in analysis.types}, wanted.recordings)
    result = FleetResult(gathered, analysis, changed, tuple(rows.values()), tuple(namesakes(found)))
    if wanted.report is not None:
        from cylforce.programs.fleet.page import write_pages

        watch("drawing the pages", None)
        write_pages(wanted.report, result, wanted.usual)
    return result


def _usual(each: OfType) -> UsualOfType:
    left_out = tuple(name for name, said in each.fleet.machines.items() if said.lasting)
    return UsualOfType(each.fleet.known, each.fleet.usual, left_out)


def _changes(analysis: Analysis) -> list[FleetChange]:
    """Return all changes, the lasting ones first, then single days; the most probable first."""
    found = []
    for kind in analysis.types:
        for name, ordered in kind.machines.items():
            latest = _latest(ordered, len(kind.told(name).course.own))
            for altered in kind.told(name).altered:
                date, before = _date(latest, altered.first), _date(latest, altered.first - 1)
                words = f"{name}: {told(altered, date, before)}"
                found.append(FleetChange(name, altered, date, before, words))
    return sorted(found, key=lambda c: (c.altered.shape is Shape.DAY, -c.altered.probability, c.machine))


def _latest(ordered: Ordered, count: int) -> Sequence[Gathered]:
    """Return the recordings that were analysed together."""
    return ordered.recordings[-count:] if count else ()


def _date(recordings: Sequence[Gathered], k: int) -> str:
    if not 0 <= k < len(recordings):
        return ""
    made = recordings[k].made
    return made.removesuffix("T00:00:00").replace("T", " ") or recordings[k].stored.name


def _facts(each: Gathered) -> dict[str, Any]:
    stored = each.stored
    kind = each.loaded.service.machine.name if each.loaded is not None else ""
    known = {"machine": stored.machine, "recording": stored.name, "made": each.made, "type": kind}
    return known | each.outcome.facts | {"address": stored.address}


def _rows(
    gathered: Sequence[Gathered], analysis: Analysis, changed: Sequence[FleetChange]
) -> dict[str, dict[str, Any]]:
    """Return the rows of the table by address."""
    rows = {each.stored.address: _facts(each) for each in gathered}
    for address, note in analysis.notes.items():
        rows[address]["reason"] = "; ".join(text for text in (rows[address]["reason"], note) if text)
    for kind in analysis.types:
        for name, ordered in kind.machines.items():
            _add_course(rows, kind, name, ordered)
    for change in changed:
        row = next(r for r in rows.values() if (r["machine"], _day(r)) == (change.machine, change.date))
        row["change"] = "; ".join(text for text in (row.get("change"), change.words) if text)
        row["change_probability"] = max(change.altered.probability, row.get("change_probability") or 0.0)
    return rows


def _booked(rows: dict[str, dict[str, Any]], weights: Mapping[str, Booked]) -> bool:
    """Add weights to the rows; whether there are any."""
    for address, each in weights.items():
        rows[address] |= {"booked_kg": list(each.kg), "booked_error_kg": list(each.errors)}
        if each.reason:
            rows[address]["reason"] += f"; weights: {each.reason}"
    return bool(weights)


def _day(row: Mapping[str, Any]) -> str:
    return str(row["made"]).removesuffix("T00:00:00").replace("T", " ") or str(row["recording"])


def _add_course(rows: dict[str, dict[str, Any]], kind: OfType, name: str, ordered: Ordered) -> None:
    course = kind.told(name).course
    joints = [kind.model.machine.links[j].name for j in kind.model.machine.rows]
    latest, said = _latest(ordered, len(course.own)), course_rows(kind.fleet.quantities, course)
    usual = kind.fleet.usual.mean[: len(kind.fleet.quantities)]
    names = [f"{what}:{joint}" for joint in joints for what in ("left_nm", "past_nm", "type_nm")]
    for own, expected, each, columns in zip(course.own, course.expected, latest, said, strict=True):
        left = each.evidence.residual(np.array([own, expected, usual]))
        rows[each.stored.address] |= columns | dict(zip(names, left.ravel().tolist(), strict=True))


def show_fleet(result: FleetResult, wanted: Wanted, console: Console) -> None:
    """Print the result for an owner: machines that changed, and recordings that could not be read."""
    machines = sorted({each.stored.machine for each in result.gathered})
    failed = [row for row in result.rows if row["state"] == FAILED]
    console.print(f"{len(machines)} machines, {len(result.gathered)} recordings, {len(failed)} of them not usable")
    for note in result.notes:
        console.print(note, markup=False)
    lasting = [c for c in result.changes if c.altered.shape is not Shape.DAY]
    for change in (*lasting, *(c for c in result.changes if c.altered.shape is Shape.DAY)):
        console.print(change.words, markup=False)
    if not lasting:
        console.print("no machine changed lastingly")
    remarks = [row for row in result.rows if row["reason"] and row["state"] != WORK]
    for row in remarks[:MOST_TOLD]:
        console.print(f"{row['machine']} {row['recording']}: {row['state']}: {row['reason']}", markup=False)
    memory = max((float(row.get("memory_mb") or 0.0) for row in result.rows), default=0.0)
    took = float(np.sum([row.get("took_s") or 0.0 for row in result.rows]))
    console.print(f"{took:.0f} s of work on recordings in all runs, at most {memory:.0f} MB in a process")
    console.print(f"table: {wanted.output}", markup=False)
