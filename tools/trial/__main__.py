"""Withheld trial of `cylforce gap`: effects hidden in recordings of reference machines, diagnosed blind, scored.

tools/withheld_trial --cases 60 --seed 3 --development --write FOLDER   cases with their labels, to develop with
"""

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from rich.progress import track

from trial.cases import simulated, write
from trial.field import Lengths, Site
from trial.orders import Order, order


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="withheld_trial", description=__doc__.partition("\n")[0])
    parser.add_argument("--cases", type=int, default=60, metavar="N")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="fresh machines and effects")
    parser.add_argument("--part", default="1/1", metavar="K/M", help="the K-th of M parts of the cases")
    parser.add_argument("--development", action="store_true", help="machines for development, never scored")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="only write the cases, with their labels")
    return parser.parse_args()


def _orders(asked: argparse.Namespace) -> list[Order]:
    part, parts = (int(x) for x in asked.part.split("/"))
    first, last = (asked.cases * k // parts for k in (part - 1, part))
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


def main() -> int:
    """The program."""
    asked = _arguments()
    if asked.write:
        if not asked.development:
            print("withheld_trial: labels are only written with --development", file=sys.stderr)
            return 1
        write_all(_orders(asked), asked.write)
        return 0
    print("withheld_trial: only --write is there yet", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
