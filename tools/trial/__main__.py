"""Withheld trial of `cylforce gap`: effects hidden in recordings of reference machines, diagnosed blind, scored.

tools/withheld_trial --cases 60 --seed 3 --json OUT                     scored; when stopped, call it again to go on
tools/withheld_trial --cases 60 --seed 3 --development --write FOLDER   cases with their labels, to develop with
"""

import argparse
import csv
import json
import shlex
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from itertools import groupby
from pathlib import Path

from rich.console import Console
from rich.progress import track

from trial.cases import simulated, write
from trial.diagnosis import COMMAND, Diagnosis
from trial.field import Lengths, Site
from trial.orders import PER_MACHINE, Order, order
from trial.run import Trial, run_machine
from trial.summary import listed, result, show

ROOT = Path(__file__).resolve().parents[2]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="withheld_trial", description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", type=int, default=60, metavar="N")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="fresh machines and effects")
    parser.add_argument("--part", default="1/1", metavar="K/M", help="the K-th of M parts of the cases")
    parser.add_argument("--development", action="store_true", help="machines for development, never scored")
    parser.add_argument("--json", type=Path, metavar="OUT", help="all figures")
    parser.add_argument("--csv", type=Path, metavar="OUT", help="a line per case: what was hidden, what was answered")
    parser.add_argument("--table", type=Path, metavar="FILE", help="where results are appended, a line each")
    parser.add_argument("--workers", type=int, default=2, metavar="N")
    parser.add_argument(
        "--diagnosis", type=shlex.split, default=COMMAND, metavar="COMMAND", help="default: cylforce gap"
    )
    parser.add_argument(
        "--no-oracle", action="store_true", help="do not run the diagnosis that is given the effect's name"
    )
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="only write the cases, with their labels")
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
            site = Site(wanted.machine, wanted.friction, Lengths())
        case, _ = simulated(site, wanted)
        write(case, folder / f"case{wanted.number:03d}")
        (folder / f"case{wanted.number:03d}.label.json").write_text(json.dumps(case.label, indent=1) + "\n")


def run(trial: Trial, orders: list[Order], workers: int) -> None:
    """The cases that the table lacks, machine by machine."""
    known = {r["case"]: r["order"] for r in trial.done()}
    if any(known[o.number] != json.loads(json.dumps(asdict(o))) for o in orders if o.number in known):
        raise SystemExit(f"withheld_trial: {trial.table} holds other cases: give another --table or remove it")
    left = [o for o in orders if o.number not in known]
    machines = [list(group) for _, group in groupby(left, key=lambda o: o.machine)]
    with ProcessPoolExecutor(workers) as pool:
        futures = [pool.submit(run_machine, trial, group) for group in machines]
        for done in track(as_completed(futures), f"{len(left)} cases", total=len(futures)):
            if error := done.exception():
                print(f"withheld_trial: a machine's cases stopped: {error!r}", file=sys.stderr)


def main() -> int:
    """The program."""
    asked = _arguments()
    if asked.write:
        if not asked.development:
            print(
                "withheld_trial: --write needs --development: labels of scored cases are not written", file=sys.stderr
            )
            return 2
        write_all(_orders(asked), asked.write)
        return 0
    table = asked.table or ROOT / ".cache" / f"withheld_trial_{asked.seed}{'_development' * asked.development}.jsonl"
    table.parent.mkdir(parents=True, exist_ok=True)
    trial = Trial(table, diagnosis=Diagnosis(tuple(asked.diagnosis)), oracle=not asked.no_oracle)
    run(trial, _orders(asked), asked.workers)
    records = sorted(trial.done(), key=lambda r: r["case"])
    show(records, Console())
    missing = len({o.number for o in _orders(asked)} - {r["case"] for r in records})
    if missing:
        print(f"withheld_trial: {missing} cases are missing: call it again", file=sys.stderr)
    if asked.csv:
        with asked.csv.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows(listed(records))
    if asked.json:
        asked.json.write_text(json.dumps(result(records), indent=1) + "\n")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
