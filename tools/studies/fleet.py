"""A simulated fleet: are the machines found that changed, with day and cause, and no others? How long does it take, by
number of recordings and of workers?"""

import argparse
import json
import shutil
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rich.console import Console
from rich.table import Table

from cylforce.fleet.changes import Shape
from cylforce.programs.fleet.result import FleetChange, FleetResult
from cylforce.programs.fleet.run import Wanted, run_fleet
from cylforce.programs.fleet.task import FAILED
from cylforce.programs.fleet.workers import Where
from studies._fleets import Faulty, Size, day_of, name_of, write_fleet


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


def _place(fault: Faulty) -> str:
    """Where the fleet tells a fault: zeros at the cylinder."""
    return fault.at.partition("_")[0] if fault.name == "pressure_offset" else fault.at


def _named(change: FleetChange, fault: Faulty) -> bool:
    alike = {fault.name, "coulomb_friction"} if fault.name == "friction_level_change" else {fault.name}
    return change.altered.name in alike and change.altered.at == _place(fault)


def _right(change: FleetChange, fault: Faulty) -> bool:
    alike = {fault.name, "coulomb_friction"} if fault.name == "friction_level_change" else {fault.name}
    return any(blame.name in alike and blame.at == _place(fault) for blame in change.altered.causes)


def timed(folder: Path, machines: int, size: Size, workers: int) -> dict[str, Any]:
    """Time and memory of a first and of a second run on some of the machines, then with one new recording."""
    with TemporaryDirectory() as name:
        base = Path(name)
        (base / "data").mkdir()
        shutil.copy(folder / "machine.toml", base / "data")
        for k in range(machines):
            (base / "data" / name_of(k)).symlink_to(folder / name_of(k))
        wanted = Wanted((str(base / "data"),), base / "results.parquet", cache=base / "cache")
        before = time.monotonic()
        result = run_fleet(wanted, Where(None, workers), say=_silent)
        first = time.monotonic() - before
        before = time.monotonic()
        run_fleet(wanted, Where(None, workers), say=_silent)
        again = time.monotonic() - before
    memory = max(float(row.get("memory_mb") or 0.0) for row in result.rows)
    return {
        "recordings": machines * size.days,
        "workers": workers,
        "first_s": first,
        "processor_s": sum(float(row.get("took_s") or 0.0) for row in result.rows),
        "again_s": again,
        "memory_mb": memory,
    }


def _silent(sentence: str) -> None:
    """Say nothing."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy fleet", description=__doc__)
    parser.add_argument("--machines", type=int, default=100)
    parser.add_argument("--days", type=int, default=10, help="recordings of each machine, a week apart")
    parser.add_argument("--seconds", type=float, default=180.0, help="length of a recording")
    parser.add_argument("--changing", type=int, default=10, help="machines that change")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--folder", type=Path, help="keep the recordings there; what is there is not made again")
    parser.add_argument("--cache", type=Path, help="keep results there")
    parser.add_argument(
        "--times", type=int, nargs="*", default=[], help="also time so many machines, with 1 and 2 workers"
    )
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    size = Size(options.machines, options.days, options.seconds, options.changing)
    with TemporaryDirectory() as scratch:
        folder = options.folder or Path(scratch) / "data"
        truth = write_fleet(folder, size, options.seed, max(options.workers, 1))
        wanted = Wanted(
            (str(folder),), Path(scratch) / "results.parquet", cache=options.cache or Path(scratch) / "cache"
        )
        before = time.monotonic()
        result = run_fleet(wanted, Where(None, options.workers), say=lambda text: print(text, file=sys.stderr))
        seconds = time.monotonic() - before
        figures = scored(truth, result, size) | {"seconds": seconds}
        times = [timed(folder, n, size, workers) for n in options.times for workers in (1, 2)]
    _show(figures, times, truth, result)
    if options.json:
        options.json.write_text(json.dumps(figures | {"times": times, "seed": options.seed}, indent=1) + "\n")


def _show(
    figures: dict[str, Any], times: Sequence[dict[str, Any]], truth: dict[str, Faulty], result: FleetResult
) -> None:
    console = Console(highlight=False, soft_wrap=True)
    for fault in truth.values():
        console.print(f"true: {fault.machine} {fault.name}@{fault.at} {fault.size:.4g} since {day_of(fault.first)}")
    for change in result.changes:
        console.print(change.words, markup=False)
    table = Table("what", "figure")
    for name, value in figures.items():
        table.add_row(name, f"{value:.4g}")
    console.print(table)
    if times:
        table = Table(*times[0])
        for each in times:
            table.add_row(*(f"{value:.4g}" for value in each.values()))
        console.print(table)


if __name__ == "__main__":
    main()
