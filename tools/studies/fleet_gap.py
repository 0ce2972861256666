"""`cylforce gap` on machines of a simulated fleet: by what is stated beforehand, and with `--usual` by what is usual in
the fleet. Machines that changed are asked with the last recording, those in order, too; references are the first
recordings. What is named falsely, what is missed?"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

from cylforce.programs.common.gap_question import Question
from cylforce.programs.common.statistics_cache import StatisticsCache
from cylforce.programs.fleet.run import Wanted, run_fleet
from cylforce.programs.fleet.workers import Where
from cylforce.programs.gap import diagnose
from cylforce.settings.machine_file import load
from studies._fleets import MACHINE_FILE, Faulty, Size, add_size, name_of, size_of, write_fleet
from studies.fleet import alike, place_of

WAYS = ("stated", "usual")


class Asked(NamedTuple):
    """A machine's diagnosis in one way: what it says, and what is true (None: in order)."""

    machine: str
    way: str
    verdict: str
    named: tuple[tuple[str, str], ...]
    possible: tuple[tuple[str, str], ...]
    truth: Faulty | None

    @property
    def right(self) -> bool:
        """Whether the true cause is named."""
        return self.truth is not None and any(_is(each, self.truth) for each in self.named)

    @property
    def held(self) -> bool:
        """Whether it is named, or in the set of causes."""
        return self.right or (self.truth is not None and any(_is(each, self.truth) for each in self.possible))

    @property
    def false(self) -> int:
        """How many names are not true."""
        return sum(self.truth is None or not _is(each, self.truth) for each in self.named)


def _is(named: tuple[str, str], fault: Faulty) -> bool:
    """Whether a name is the truth. Zeros of a cylinder's two pressures look alike."""
    name, at = named
    at = at.partition("_")[0] if name == "pressure_offset" else at
    return name in alike(fault) and at == place_of(fault)


def asked(
    folder: Path, machine: str, truth: Faulty | None, references: int, usual: Path, kept: StatisticsCache
) -> list[Asked]:
    """Both ways."""
    days = sorted((folder / machine).iterdir())
    found = []
    for way, file in zip(WAYS, (None, usual), strict=True):
        question = Question((days[-1],), tuple(days[:references]), usual=file)
        answer = diagnose(load(MACHINE_FILE), question, cache=kept).answer
        named, possible = (
            tuple((each["name"], each["at"]) for each in answer.get(key, ())) for key in ("effects", "set")
        )
        found.append(Asked(machine, way, answer["verdict"], named, possible, truth))
    return found


def scored(found: Sequence[Asked]) -> dict[str, int]:
    """Counts of one way."""
    changed, in_order = ([a for a in found if (a.truth is not None) is is_changed] for is_changed in (True, False))
    return {
        "changed": len(changed),
        "named rightly": sum(a.right for a in changed),
        "named rightly or in the set": sum(a.held for a in changed),
        "missed: no gap": sum(a.verdict == "no_gap" for a in changed),
        "false names beside": sum(a.false for a in changed),
        "in order": len(in_order),
        "in order: something named": sum(bool(a.named) for a in in_order),
        "in order: false names": sum(a.false for a in in_order),
        "in order: no gap": sum(a.verdict == "no_gap" for a in in_order),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy fleet_gap", description=__doc__)
    add_size(parser)
    parser.add_argument("--in-order", type=int, default=10, help="so many machines in order are asked, too")
    parser.add_argument("--references", type=int, default=3, help="recordings, each machine's first; before any change")
    options = parser.parse_args()
    size, console = size_of(options), Console(highlight=False, soft_wrap=True)
    found: list[Asked] = []
    with TemporaryDirectory() as scratch:
        folder, usual = options.folder or Path(scratch) / "data", Path(scratch) / "usual.toml"
        truth = write_fleet(folder, size, options.seed, max(options.workers, 1))
        wanted = Wanted((str(folder),), Path(scratch) / "results.parquet", usual, cache=options.cache)
        run_fleet(wanted, Where(None, options.workers), say=_silent)
        rows = StatisticsCache(Path(scratch) / "statistics")
        for machine in (*truth, *_some_in_order(truth, size, options.in_order)):
            for each in asked(folder, machine, truth.get(machine), options.references, usual, rows):
                console.print(_words(each), markup=False)
                found.append(each)
    _show(found, console)
    if options.json:
        figures = {way: scored([a for a in found if a.way == way]) for way in WAYS}
        options.json.write_text(json.dumps(figures | {"seed": options.seed}, indent=1) + "\n")


def _silent(sentence: str) -> None:
    """Say nothing."""


def _some_in_order(truth: dict[str, Faulty], size: Size, count: int) -> list[str]:
    """Evenly over the fleet."""
    names = [name for name in map(name_of, range(size.machines)) if name not in truth]
    return names[:: max(len(names) // max(count, 1), 1)][:count]


def _words(each: Asked) -> str:
    true = f"{each.truth.name}@{each.truth.at} {each.truth.size:.4g}" if each.truth else "in order"
    named = ", ".join(f"{name}@{at}" for name, at in each.named) or "nothing"
    return f"{each.machine} ({true}), {each.way}: {each.verdict}, names {named}"


def _show(found: Sequence[Asked], console: Console) -> None:
    table = Table("what", *WAYS)
    columns = [scored([a for a in found if a.way == way]) for way in WAYS]
    for name in columns[0]:
        table.add_row(name, *(str(column[name]) for column in columns))
    console.print(table)


if __name__ == "__main__":
    main()
