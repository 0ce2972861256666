"""How good is `cylforce gap` on a folder of labelled machines, whoever made them? One row per recording, and a summary.

FOLDER holds `labels.json` and one folder per machine with `machine.toml`, `reference_static.parquet`,
`reference_moving.parquet` and the recordings that the labels list. Every recording is asked with both references and
with tares identified from them. Rows are written as they come; recordings that the table already has are skipped."""

import argparse
import csv
import json
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rich.console import Console
from rich.table import Table

from cylforce.files.atomic import RecordingError
from cylforce.programs.gap import Question, diagnose
from cylforce.programs.identify import How, run_identify
from cylforce.settings.machine_file import Loaded, load
from layers.intervals import wilson

REFERENCES = ("reference_static", "reference_moving")
SILENT = ("no_gap", "not_observable")
NAMING = ("explained", "partly_explained", "ambiguous")
ANOTHER_NAME = {"soil_contact_in_air": "soil_contact"}  # labels of the foreign machines, and the library's names
AT_THE_TEETH = {"bucket tip": "bucket", "payload": "bucket"}
VISIBLE = 2.5  # times the floor, at the joint where the effect leaves most
COLUMNS = (
    *("machine", "recording", "scenario", "rough", "in_order", "effect", "at", "nameable", "over_floor", "verdict"),
    *("first", "first_at", "confidence", "causes", "also", "evidence_first", "evidence_at", "seconds", "error"),
)


@dataclass(frozen=True)
class Labelled:
    """A recording of a machine and its label; `folder` is the machine's."""

    folder: Path
    label: dict[str, Any]

    @property
    def key(self) -> tuple[str, str]:
        """Machine and recording."""
        return self.folder.name, str(self.label["recording"])

    @property
    def truth(self) -> tuple[str, str]:
        """Name and place of the one effect, in the library's words; empty for a machine in order."""
        effects = self.label["effects"]
        if not effects:
            return "", ""
        name, (at, *_) = effects[0]["name"], effects[0]["at"]
        return ANOTHER_NAME.get(name, name), AT_THE_TEETH.get(at, at)

    @property
    def nameable(self) -> bool:
        """Whether the library has the effect."""
        return all(effect["nameable"] for effect in self.label["effects"])

    @property
    def over_floor(self) -> float:
        """What the effect leaves over the floor, at the joint where that is most; 1 in order."""
        return max((float(x) for e in self.label["effects"] for x in e["residual_over_floor"]), default=1.0)


def labelled(folder: Path) -> list[Labelled]:
    """All recordings but references."""
    labels = json.loads((folder / "labels.json").read_text())
    return [Labelled(folder / each["machine"], each) for each in labels if each["recording"] not in REFERENCES]


@lru_cache(maxsize=1)
def identified(folder: Path, into: Path) -> tuple[Loaded, Path]:
    """A machine, and its tares identified from both references."""
    loaded, out = load(folder / "machine.toml"), into / f"{folder.name}.toml"
    if not out.exists():
        run_identify(loaded, references(folder), out, How(refuse=False))
    return loaded, out


def references(folder: Path) -> tuple[Path, ...]:
    """The recordings of a machine while it was in order."""
    return tuple(folder / f"{name}.parquet" for name in REFERENCES)


def asked(each: Labelled, into: Path) -> dict[str, Any]:
    """One row of the table."""
    start, found = time.monotonic(), dict[str, Any]()
    try:
        loaded, tares = identified(each.folder, into)
        field = each.folder / f"{each.label['recording']}.parquet"
        found = diagnose(loaded, Question((field,), references(each.folder), tares)).answer
        error = ""
    except (RecordingError, ValueError) as refused:
        error = str(refused)
    effects, evidence = found.get("effects") or [{}], found.get("evidence") or [{}]
    name, at = each.truth
    label = (each.key[0], each.key[1], each.label["scenario"], int(each.label["rough"]), int(each.label["in_order"]))
    also = ";".join(f"{e['name']}@{e['at']}" for e in effects[0].get("confused_with", []))
    answer = (found.get("verdict", "refused"), effects[0].get("name", ""), effects[0].get("at", ""))
    rest = (effects[0].get("confidence", ""), sum(bool(e) for e in effects), also)
    most = (evidence[0].get("name", ""), evidence[0].get("at", ""))
    took = round(time.monotonic() - start, 1)
    row = (*label, name, at, int(each.nameable), each.over_floor, *answer, *rest, *most, took, error)
    return dict(zip(COLUMNS, row, strict=True))


def rows(table: Path) -> list[dict[str, str]]:
    """What a table holds so far."""
    if not table.exists():
        return []
    with table.open(newline="") as file:
        return list(csv.DictReader(file))


def ask_all(recordings: Sequence[Labelled], table: Path) -> Iterator[dict[str, Any]]:
    """Every recording that the table lacks; its row is in the table before the next one is asked."""
    done = {(row["machine"], row["recording"]) for row in rows(table)}
    with TemporaryDirectory() as into, table.open("a", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        if not done:
            writer.writeheader()
        for each in recordings:
            if each.key in done:
                continue
            row = asked(each, Path(into))
            writer.writerow(row)
            file.flush()
            yield row


def shares(found: Sequence[dict[str, str]]) -> dict[str, tuple[int, int]]:
    """Hits and cases of every figure."""
    known = [r for r in found if r["effect"] and r["nameable"] == "1" and float(r["over_floor"]) >= VISIBLE]
    foreign = [r for r in found if r["effect"] and r["nameable"] == "0" and float(r["over_floor"]) >= VISIBLE]
    alone = [r for r in known if r["verdict"] in NAMING[:2] and r["causes"] == "1"]
    cycles = [r for r in known if r["scenario"].startswith("dig_cycles")]
    empty = [r for r in found if r["in_order"] == "1" and r["recording"].startswith("empty")]
    work = [r for r in found if r["in_order"] == "1" and not r["recording"].startswith("empty")]
    return {
        "first right": (sum(map(right, known)), len(known)),
        "first right, digging cycles": (sum(map(right, cycles)), len(cycles)),
        "most evidence right": (sum((r["evidence_first"], r["evidence_at"]) == truth(r) for r in known), len(known)),
        "truth among the answers": (sum(in_set(r) for r in known), len(known)),
        "silent": (sum(r["verdict"] in SILENT for r in known), len(known)),
        "named alone": (len(alone), len(known)),
        "of these right": (sum(map(right, alone)), len(alone)),
        "not in the library: unknown": (sum(r["verdict"] == "unknown" for r in foreign), len(foreign)),
        "not in the library: named alone": (
            sum(r["verdict"] in NAMING[:2] and r["causes"] == "1" for r in foreign),
            len(foreign),
        ),
        "in order, empty: alarm": (sum(r["verdict"] not in SILENT for r in empty), len(empty)),
        "in order, empty: named": (sum(r["verdict"] in NAMING for r in empty), len(empty)),
        "in order, work or contact: named": (sum(r["verdict"] in NAMING for r in work), len(work)),
    }


def truth(row: dict[str, str]) -> tuple[str, str]:
    """Name and place of the true effect."""
    return row["effect"], row["at"]


def right(row: dict[str, str]) -> bool:
    """Whether the first effect is the true one."""
    return row["verdict"] in NAMING and (row["first"], row["first_at"]) == truth(row)


def in_set(row: dict[str, str]) -> bool:
    """Whether the true effect is the first or among what it is confused with."""
    return right(row) or (row["verdict"] in NAMING and "@".join(truth(row)) in row["also"].split(";"))


def show(found: Sequence[dict[str, str]], console: Console) -> None:
    """The summary."""
    table = Table(title=f"visible: residual over floor >= {VISIBLE}")
    for column in ("what", "share", "of", "95 % (Wilson)"):
        table.add_column(column, justify="left" if column == "what" else "right")
    for name, (hits, cases) in shares(found).items():
        low, high = wilson(hits, cases)
        value = f"{hits / cases:.0%}" if cases else "-"
        table.add_row(name, value, f"{hits} of {cases}", f"{low:.0%} to {high:.0%}")
    console.print(table)


def main() -> int:
    """Ask what is not yet in the table, and print the summary; exit code 2 where the folder lacks something."""
    parser = argparse.ArgumentParser(prog="accuracy labelled", description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--table", type=Path, default=Path("labelled.csv"), metavar="CSV")
    parser.add_argument("--only", nargs="+", default=[""], metavar="PREFIX", help="recordings whose name begins so")
    parser.add_argument("--summary", action="store_true", help="asks nothing: the summary of the table as it is")
    options = parser.parse_args()
    try:
        recordings = labelled(options.folder)
    except (OSError, ValueError, KeyError) as error:
        print(f"accuracy labelled: {options.folder}: needs labels.json: {error}", file=sys.stderr)
        return 2
    wanted = [each for each in recordings if each.key[1].startswith(tuple(options.only))]
    for row in () if options.summary else ask_all(wanted, options.table):
        words = (row[k] for k in ("machine", "recording", "effect", "at", "verdict", "first", "first_at", "seconds"))
        print(*words, flush=True)
    show(rows(options.table), Console(highlight=False))
    return 0


if __name__ == "__main__":
    sys.exit(main())
