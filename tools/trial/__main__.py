"""Withheld trial of `cylforce gap`: effects hidden in recordings, diagnosed blind, scored.

tools/withheld_trial --cases 60 --seed 3 --json OUT                     reference machines; call it again to go on
tools/withheld_trial --source FOLDER --json OUT                         labelled machines, whoever made them
tools/withheld_trial --cases 60 --seed 3 --development --write FOLDER   cases with their labels, to develop with
"""

import argparse
import csv
import json
import shlex
import sys
from pathlib import Path

from rich.console import Console
from rich.progress import track

from trial.asking import Asked, of_folder, of_machines, run
from trial.cases import simulated, write
from trial.diagnosis import COMMAND, Diagnosis
from trial.field import Site
from trial.knowledge import Knowledge
from trial.orders import PER_MACHINE, Order, order
from trial.run import Record, Trial
from trial.summary import OWN, listed, result, show

WIDTH = 140  # of the tables, at least
ROOT = Path(__file__).resolve().parents[2]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="withheld_trial", description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("--cases", type=int, default=60, metavar="N")
    add("--seed", type=int, default=0, metavar="S", help="fresh machines and effects")
    add("--part", default="1/1", metavar="K/M", help="the K-th of M parts of the cases")
    add("--development", action="store_true", help="machines for development, never scored")
    add("--source", type=Path, metavar="FOLDER", help="labelled machines instead: labels.json, a folder each")
    add("--only", nargs="+", default=[""], metavar="PREFIX", help="with --source: recordings whose name begins so")
    add("--knowledge", type=Knowledge, choices=list(Knowledge), default=Knowledge.REFERENCES, help="of the machine")
    add("--stratum", nargs="+", default=[], metavar="WORD", help="cases of a kind, effect, motion: all words hold")
    add("--summary", action="store_true", help="asks nothing: the tables of what has been asked")
    add("--json", type=Path, metavar="OUT", help="all figures")
    add("--csv", type=Path, metavar="OUT", help="a line per case: what was hidden, what was answered")
    add("--table", type=Path, metavar="FILE", help="where results are appended, a line each")
    add("--workers", type=int, default=2, metavar="N")
    add("--diagnosis", type=shlex.split, default=COMMAND, metavar="COMMAND", help="default: cylforce gap")
    add("--no-oracle", action="store_true", help="do not run the diagnosis that is given the effect's name")
    add("--write", type=Path, metavar="FOLDER", help="only write the cases, with their labels")
    return parser.parse_args()


def _orders(asked: argparse.Namespace) -> list[Order]:
    part, parts = (int(x) for x in asked.part.split("/"))
    ends = [asked.cases * k // parts // PER_MACHINE * PER_MACHINE for k in range(parts)] + [asked.cases]
    first, last = ends[part - 1 : part + 1]
    return [order(asked.seed, k, development=asked.development) for k in range(first, last)]


def write_all(orders: list[Order], folder: Path) -> None:
    """FOLDER/case000/... for the diagnosis, FOLDER/case000.label.json for the developer."""
    site: Site | None = None
    for wanted in track(orders, "writing"):
        if site is None or site.seed != wanted.machine:
            site = Site(wanted.machine, wanted.friction)
        case, _ = simulated(site, wanted)
        write(case, folder / f"case{wanted.number:03d}")
        (folder / f"case{wanted.number:03d}.label.json").write_text(json.dumps(case.label, indent=1) + "\n")


def _asked(asked: argparse.Namespace, trial: Trial) -> Asked:
    if asked.source is None:
        print(f"seed {asked.seed}", flush=True)
        return of_machines(trial, _orders(asked))
    try:
        return of_folder(trial, asked.source, tuple(asked.only))
    except (OSError, ValueError, KeyError) as error:
        print(f"withheld_trial: {asked.source}: needs labels.json: {error}", file=sys.stderr)
        raise SystemExit(2) from error


def _name(asked: argparse.Namespace) -> str:
    """Of the table of results."""
    own = asked.source.resolve().name if asked.source else f"{asked.seed}{'_development' * asked.development}"
    return own if asked.knowledge is Knowledge.REFERENCES else f"{own}_{asked.knowledge}"


def main() -> int:
    """The program."""
    asked = _arguments()
    if asked.write and not asked.development:
        print("withheld_trial: --write needs --development: labels of scored cases are not written", file=sys.stderr)
        return 2
    if asked.write:
        write_all(_orders(asked), asked.write)
        return 0
    table = asked.table or ROOT / ".cache" / f"withheld_trial_{_name(asked)}.jsonl"
    table.parent.mkdir(parents=True, exist_ok=True)
    trial = Trial(
        table, diagnosis=Diagnosis(tuple(asked.diagnosis)), oracle=not asked.no_oracle, knowledge=asked.knowledge
    )
    try:
        trial.done()  # refuses a table that cannot be scored before any case is run
        cases = _asked(asked, trial).stratum(asked.stratum)
    except ValueError as error:
        print(f"withheld_trial: {error}", file=sys.stderr)
        return 2
    missing = [] if asked.summary else run(trial, cases, asked.workers)
    _told(asked, [r for r in trial.done() if not asked.stratum or r["case"] in cases.orders])
    if missing:
        print(f"withheld_trial: {len(missing)} cases are missing: call it again", file=sys.stderr)
    return 1 if missing else 0


def _told(asked: argparse.Namespace, done: list[Record]) -> None:
    """Tables and files of what has been asked so far."""
    records, source = sorted(done, key=lambda r: r["case"]), _name(asked) if asked.source else OWN
    show(records, Console(width=max(Console().width, WIDTH)), source)
    if asked.csv:
        with asked.csv.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows(listed(records))
    if asked.json:
        asked.json.write_text(json.dumps(result(records, source), indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
