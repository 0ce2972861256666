"""A simulated fleet: are the machines found that changed, with day and cause, and no others? How long does it take, by
number of recordings and of workers?"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rich.console import Console
from rich.table import Table

from cylforce.fleet.changes import MachineChange, Shape
from cylforce.programs.fleet.analysis import dated
from cylforce.programs.fleet.result import FleetChange, FleetResult
from cylforce.programs.fleet.run import Wanted, run_fleet
from cylforce.programs.fleet.task import FAILED
from cylforce.programs.fleet.workers import Where
from studies._fleet_planted import field, shown
from studies._fleet_times import Timed, plot, timed, timed_in
from studies._fleets import Faulty, Size, add_size, day_of, size_of, write_fleet


def scored(truth: dict[str, Faulty], result: FleetResult, size: Size) -> dict[str, Any]:
    """How many changes are found, within one recording of their day, with their cause in the set; how many machines in
    order are reported."""
    lasting = [c for c in result.changes if c.altered.shape is not Shape.DAY]
    by_machine = {name: [c for c in lasting if c.machine == name] for name in {c.machine for c in lasting}}
    days = [day_of(k) for k in range(size.days)]
    found = {name: by_machine.get(name, []) for name in truth}
    return {
        "changed": len(truth),
        "found": sum(bool(each) for each in found.values()),
        "with_day": sum(any(_near(c, truth[name], days) for c in each) for name, each in found.items()),
        "with_day_and_cause": sum(
            any(_near(c, truth[name], days) and _right(c, truth[name]) for c in each) for name, each in found.items()
        ),
        "first_right": sum(bool(each) and _named(each[0], truth[name]) for name, each in found.items()),
        "in_order": size.machines - len(truth),
        "in_order_reported": len(set(by_machine) - set(truth)),
        "more_than_one_change": sum(len(each) > 1 for each in found.values()),
        "single_days": len(result.changes) - len(lasting),
        "failed": sum(row["state"] == FAILED for row in result.rows),
    }


def _near(change: FleetChange, fault: Faulty, days: Sequence[str]) -> bool:
    return abs(days.index(change.date) - fault.first) <= 1


def place_of(fault: Faulty) -> str:
    """Where the fleet tells a fault: zeros at the cylinder."""
    return fault.at.partition("_")[0] if fault.name == "pressure_offset" else fault.at


def alike(fault: Faulty) -> set[str]:
    """Names of a fault that mean the same."""
    return {fault.name, "coulomb_friction"} if fault.name == "friction_level_change" else {fault.name}


def _named(change: FleetChange, fault: Faulty) -> bool:
    return change.altered.name in alike(fault) and change.altered.at == place_of(fault)


def _right(change: FleetChange, fault: Faulty) -> bool:
    return _has(change.altered, fault)


def _has(altered: MachineChange, fault: Faulty) -> bool:
    return any(blame.name in alike(fault) and blame.at == place_of(fault) for blame in altered.causes)


def _near_and_has(altered: MachineChange, fault: Faulty) -> bool:
    return abs(altered.first - fault.first) <= 1 and _has(altered, fault)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy fleet", description=__doc__)
    add_size(parser)
    parser.add_argument(
        "--times",
        type=int,
        nargs="*",
        default=[],
        help="time only, so many machines; what a file of --json says of others is kept",
    )
    parser.add_argument("--by", type=int, nargs="+", default=[1, 2], help="numbers of workers; 0: in one process")
    parser.add_argument("--rivals", action="store_true", help="also find changes with the library ruptures")
    parser.add_argument(
        "--planted", type=int, default=0, metavar="N", help="also plant changes into each machine in order, N times"
    )
    parser.add_argument("--plot", type=Path, help="draw the times there (SVG)")
    options = parser.parse_args()
    size = size_of(options)
    with TemporaryDirectory() as scratch:
        folder = options.folder or Path(scratch) / "data"
        truth = write_fleet(folder, size, options.seed, max(options.workers, 1))
        if options.times:
            figures = _timed(folder, options)
        else:
            figures = _found(folder, truth, size, options, options.cache or Path(scratch) / "cache")
    if options.json:
        options.json.write_text(json.dumps(figures | {"seed": options.seed}, indent=1) + "\n")


def _found(
    folder: Path, truth: dict[str, Faulty], size: Size, options: argparse.Namespace, cache: Path
) -> dict[str, Any]:
    """What is found of a fleet, and how long that takes."""
    times = None if cache.exists() else timed_in(folder, cache, options.workers)
    with TemporaryDirectory() as scratch:
        wanted = Wanted((str(folder),), Path(scratch) / "results.parquet", cache=cache)
        result = run_fleet(wanted, Where(None, options.workers), say=lambda text: print(text, file=sys.stderr))
    figures = scored(truth, result, size) | ({} if times is None else times._asdict())
    _show(figures, truth, result)
    if options.planted:
        figures |= _planted(result, truth, options.planted)
    return figures | _rivals(result, truth) if options.rivals else figures


def _planted(result: FleetResult, truth: dict[str, Faulty], repeated: int) -> dict[str, Any]:
    """How large a change must be, by the machines in order of this fleet."""
    (kind,) = result.analysis.types
    recordings = {name: dated(ordered) for name, ordered in kind.machines.items()}
    return shown(field(kind, truth, recordings), _near_and_has, repeated)


def _rivals(result: FleetResult, truth: dict[str, Faulty]) -> dict[str, Any]:
    """The same courses, given to another library."""
    from studies._fleet_rivals import Rival, rivals

    found = rivals(result.analysis.types[0].fleet, truth)
    table = Table(*Rival._fields, title="ruptures on the same courses")
    for each in found:
        table.add_row(each.way, *(f"{value:.4g}" for value in each[1:]))
    Console(highlight=False).print(table)
    return {"rivals": [each._asdict() for each in found]}


def _timed(folder: Path, options: argparse.Namespace) -> dict[str, Any]:
    """Time and memory by number of recordings and workers."""
    before = json.loads(options.json.read_text()) if options.json and options.json.exists() else {}
    known = {(each["recordings"], each["workers"]): Timed(**each) for each in before.get("times", ())}
    for machines in options.times:
        for workers in options.by:
            each = timed(folder, machines, workers)
            known[each.recordings, each.workers] = each
    times = [known[key] for key in sorted(known)]
    table = Table(
        *(name.replace("_", " ") for name in Timed._fields),
        title=f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores",
    )
    for each in times:
        table.add_row(*(f"{value:.4g}" for value in each))
    Console(highlight=False, soft_wrap=True).print(table)
    if options.plot:
        plot(times, options.plot)
    return {"times": [each._asdict() for each in times]}


def _show(figures: dict[str, Any], truth: dict[str, Faulty], result: FleetResult) -> None:
    console = Console(highlight=False, soft_wrap=True)
    for fault in truth.values():
        console.print(f"true: {fault.machine} {fault.name}@{fault.at} {fault.size:.4g} since {day_of(fault.first)}")
    for change in result.changes:
        console.print(change.words, markup=False)
    table = Table("what", "figure")
    for name, value in figures.items():
        table.add_row(name, f"{value:.4g}")
    console.print(table)


if __name__ == "__main__":
    main()
