"""Which layer that decides generalises best? Layers of a diagnosis compared on evidence that is computed once.

Of every case the sufficient statistics (layers.statistics) are kept in a cache folder: of the labelled machines in
FOLDER, and of reference machines from the development generator of the withheld trial. A layer turns them into
probabilities of "no gap", of every effect at its place, and of "unknown". What a layer learns - everyday differences,
the calibration - it learns on other machines than the one it is scored on (leave one machine out)."""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from cylforce.settings.machine_file import load
from layers.answers import Answer, Asked, calibrated, largest_evidence, selected
from layers.bayes import Machine, learnt
from layers.discrepancy import Sums, moments, sums
from layers.intervals import wilson
from layers.statistics import Machine as Stored
from layers.statistics import Statistics, made_of, one_way, read_scene, read_statistics
from trial.cases import simulated, write
from trial.field import Site
from trial.judged import CERTAIN, VISIBLE
from trial.orders import PER_MACHINE, order
from trial.repertoire import PLAIN
from trial.run import Truth
from trial.source import Labelled, labelled, references

CACHE = Path.home() / ".cache/cylforce/decisions"
SEED = 2026  # of the trial's development cases
ALONE = 0.8  # the probability from which on one cause is named alone
LEAST = 1e-3  # the probability of the truth that the log score counts at least
FOREIGN, REFERENCE = "foreign", "reference"


class Truthful(NamedTuple):
    """The truth of a case: names and places, whether the library has them, whether they are visible, whether the
    machine worked (digging, contact) rather than moved in the air."""

    effects: tuple[tuple[str, str], ...]
    nameable: bool
    visible: bool
    work: bool


def store_labelled(folder: Path, cache: Path) -> None:
    """Statistics and labels of labelled machines, those that are not there yet."""
    machines: dict[Path, list[Labelled]] = {}
    for each in labelled(folder):
        machines.setdefault(each.folder, []).append(each)
    for machine, recordings in machines.items():
        own = cache / FOREIGN / machine.name
        if not (own / "labels.json").exists():
            fields = {each.key[1]: (machine / f"{each.key[1]}.parquet",) for each in recordings}
            Stored(load(machine / "machine.toml"), references(machine), {}).stored(own, fields)
            _write_labels(own, {each.key[1]: _of_labelled(each) for each in recordings})


def _of_labelled(each: Labelled) -> Truthful:
    work = each.label["scenario"].startswith(("dig", "contact"))
    effects = (each.truth,) if each.label["effects"] else ()
    return Truthful(effects, each.nameable, each.over_floor >= VISIBLE, work)


def store_reference(place: int, cache: Path) -> None:
    """The same of one reference machine of the trial's development generator, cases with enough motion only."""
    own, labels = cache / REFERENCE / f"machine_{place}", {}
    if (own / "labels.json").exists():
        return
    numbers = range(PER_MACHINE * place, PER_MACHINE * (place + 1))
    orders = [o for n in numbers if not (o := order(SEED, n, development=True)).poor and not o.two_links]
    site = Site(orders[0].machine, orders[0].friction, repertoire=PLAIN)
    with TemporaryDirectory() as name:
        fields, inputs, folder = dict[str, tuple[Path, ...]](), dict[str, Any](), Path(name)
        for each in orders:
            case, twin = simulated(site, each)
            folder = Path(name) / f"case_{each.number}"
            write(case, folder)
            label = json.loads(json.dumps(Truth(case, twin, folder).sized(site)))
            inputs = json.loads((folder / "case.json").read_text())
            fields[folder.name] = tuple(folder / file for file in inputs["field"])
            labels[folder.name] = _of_trial(label)
        clean = tuple(folder / file for file in inputs["reference"])
        Stored(load(folder / "machine.toml"), clean, inputs["loads_kg"]).stored(own, fields)
    _write_labels(own, labels)


def _of_trial(label: dict[str, Any]) -> Truthful:
    effects = tuple((e["name"], e["at"]) for e in label["effects"])
    sizes = [e.get("sigmas", label.get("sigmas", 0.0)) or 0.0 for e in label["effects"]]
    return Truthful(effects, label["kind"] != "foreign", bool(sizes) and min(sizes) >= CERTAIN, work=False)


def _write_labels(own: Path, labels: dict[str, Truthful]) -> None:
    (own / "labels.json").write_text(json.dumps({k: v._asdict() for k, v in labels.items()}, indent=1) + "\n")


def read_labels(own: Path) -> dict[str, Truthful]:
    """The labels of a machine that was stored."""
    found = json.loads((own / "labels.json").read_text())
    return {k: Truthful(tuple((n, a) for n, a in v.pop("effects")), **v) for k, v in found.items()}


def machine(own: Path) -> Machine:
    """A machine that was stored, with everyday differences not learnt yet."""
    scene, made = one_way(read_scene(own))
    files = sorted(own.glob("reference_*.npz"))
    return Machine(scene, tuple(sums(scene, [made_of(read_statistics(file), made)]) for file in files), {})


def recorded(own: Path, case: str) -> Statistics:
    """A case that was stored."""
    return made_of(read_statistics(own / f"{case}.npz"), one_way(read_scene(own))[1])


class Row(NamedTuple):
    """A case with what was searched of it: source and machine, its name, the truth, and the question."""

    source: str
    machine: str
    case: str
    truth: Truthful
    asked: Asked


def searched(work: tuple[Path, dict[str, float]]) -> list[Row]:
    """All cases of one machine."""
    own, everyday = work
    known, found = machine(own).with_everyday(everyday), []
    for case, truth in read_labels(own).items():
        each = recorded(own, case)
        together = sums(known.scene, [each])
        asked = Asked.of(known.asked(together), moments(known.scene, each))
        found.append(Row(own.parent.name, own.name, case, truth, asked))
    return found


@cache
def in_order(own: Path) -> list[tuple[Machine, Sums]]:
    """A machine and its recordings in order, in the air."""
    known, labels = machine(own), read_labels(own)
    cases = [case for case, truth in labels.items() if not truth.effects and not truth.work]
    return [(known, sums(known.scene, [recorded(own, case)])) for case in cases]


@dataclass(frozen=True)
class Scored:
    """A case, and the answer of a layer."""

    row: Row
    answer: Answer

    @property
    def right(self) -> bool:
        """Whether the likeliest answer is true: for a pair one of both, for what no library has "unknown"."""
        return self.answer.first in self.true

    @property
    def true(self) -> set[tuple[str, str]]:
        """All answers that are true."""
        truth = self.row.truth
        if not truth.effects:
            return {("", "")}
        return set(truth.effects) if truth.nameable else {("unknown", "")}

    @property
    def alone(self) -> bool:
        """Whether one effect is named alone."""
        name = self.answer.first[0]
        return name not in {"", "unknown"} and self.answer.probability >= ALONE

    @property
    def probability(self) -> float:
        """What the layer gives the truth."""
        return sum(self.answer.of.get(key, 0.0) for key in self.true)


def figures(cases: Sequence[Scored]) -> dict[str, str]:
    """One line of the table."""
    air = [c for c in cases if not c.row.truth.work]
    known = [c for c in air if c.row.truth.effects and c.row.truth.nameable and c.row.truth.visible]
    work = [c for c in cases if c.row.truth.work and c.row.truth.effects and c.row.truth.visible]
    order_, foreign = ([c for c in air if not c.row.truth.effects], [c for c in air if not c.row.truth.nameable])
    busy = [c for c in cases if c.row.truth.work and not c.row.truth.effects]
    alone = [c for c in known if c.alone]
    sizes = [len(c.answer.credible) for c in known]
    base = float(np.mean([c.right for c in air])) if air else 0.0
    brier = float(np.mean([(c.answer.probability - c.right) ** 2 for c in air])) if air else 0.0
    return {
        "first right": _share(known, lambda c: c.right),
        "in 90 % set": _share(known, lambda c: bool(c.true & c.answer.credible)),
        "its size": f"{np.mean(sizes):.1f}" if sizes else "-",
        "named alone": _share(known, lambda c: c.alone),
        "of these right": _share(alone, lambda c: c.right),
        "in order, named": _share(order_, lambda c: c.alone),
        "in order, no gap": _share(order_, lambda c: c.right),
        "not in library, named": _share(foreign, lambda c: c.alone),
        "unknown": _share(foreign, lambda c: c.right),
        "work: first right": _share(work, lambda c: c.right),
        "work in order, named": _share(busy, lambda c: c.alone),
        "log score": f"{np.mean([np.log(max(c.probability, LEAST)) for c in air]):.2f}" if air else "-",
        "Brier (base rate)": f"{brier:.3f} ({base * (1.0 - base):.3f})",
    }


def _share(cases: Sequence[Scored], holds: Callable[[Scored], bool]) -> str:
    hits, count = sum(holds(c) for c in cases), len(cases)
    low, high = wilson(hits, count)
    return f"{hits} of {count} ({100 * low:.0f} to {100 * high:.0f} %)"


def layers(rows: Sequence[Row]) -> dict[str, list[Scored]]:
    """The answers of every layer."""
    found = {
        "largest evidence": [Scored(r, largest_evidence(r.asked)) for r in rows],
        "Bayesian selection": [Scored(r, selected(r.asked)) for r in rows],
    }
    told = [(s.answer, s.right, (s.row.source, s.row.machine)) for s in found["Bayesian selection"]]
    again = calibrated(told, [not r.truth.work for r in rows])
    found["with calibration"] = [Scored(r, a) for r, a in zip(rows, again, strict=True)]
    return found


def main() -> int:
    """Store what is missing, search, score, print."""
    parser = argparse.ArgumentParser(prog="accuracy decisions", description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="labelled machines (labels.json)")
    parser.add_argument("--reference-machines", type=int, default=6)
    parser.add_argument("--cache", type=Path, default=CACHE)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    try:
        store_labelled(options.folder, options.cache)
    except (OSError, ValueError, KeyError) as error:
        print(f"accuracy decisions: {options.folder}: needs labels.json and its recordings: {error}", file=sys.stderr)
        return 2
    for place in range(options.reference_machines):
        store_reference(place, options.cache)
    stored = [own.parent for source in (FOREIGN, REFERENCE) for own in (options.cache / source).glob("*/labels.json")]
    work = [(own, learnt([pair for o in stored if o != own for pair in in_order(o)])) for own in sorted(stored)]
    with ProcessPoolExecutor(options.processes) as pool:
        rows = [row for part in pool.map(searched, work) for row in part]
    answers = layers(rows)
    report = {
        source: {name: figures([s for s in all_of if s.row.source == source]) for name, all_of in answers.items()}
        for source in (FOREIGN, REFERENCE)
    }
    show(report, Console(highlight=False))
    if options.json:
        each = {name: [_record(s) for s in all_of] for name, all_of in answers.items()}
        options.json.write_text(json.dumps({"figures": report, "cases": each}, indent=1) + "\n")
    return 0


def _record(scored: Scored) -> dict[str, Any]:
    row, answer = scored.row, scored.answer
    best = sorted(answer.of.items(), key=lambda item: -item[1])[:5]
    return {
        "source": row.source,
        "machine": row.machine,
        "case": row.case,
        **row.truth._asdict(),
        "right": scored.right,
        "answers": [["@".join(key), round(p, 4)] for key, p in best],
        "features": [round(x, 4) for x in answer.features],
    }


def show(report: dict[str, dict[str, dict[str, str]]], console: Console) -> None:
    """One table per source."""
    for source, by_layer in report.items():
        table = Table(title=f"source: {source} machines")
        table.add_column("what")
        for name in by_layer:
            table.add_column(name, justify="right")
        for what in next(iter(by_layer.values())):
            table.add_row(what, *(each[what] for each in by_layer.values()))
        console.print(table)


if __name__ == "__main__":
    sys.exit(main())
