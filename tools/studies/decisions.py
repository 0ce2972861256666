"""How often the diagnosis is right: its evidence is computed once for each case and kept, then scored.

Cases are the labelled machines in FOLDER, and reference machines from the development generator of the withheld trial.
Of every case the answer is kept in a cache folder as JSON: posterior, credible set, names, gap. Delete the folder to
compute anew."""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from cylforce.diagnosis.decide import Verdict
from cylforce.diagnosis.search import NO_GAP, UNKNOWN
from cylforce.programs.common.gap_question import Question
from cylforce.programs.gap import diagnose
from cylforce.settings.machine_file import load
from layers.intervals import wilson
from trial.cases import simulated, write
from trial.field import Site
from trial.judged import DIGGING, VISIBLE
from trial.orders import PER_MACHINE, order
from trial.repertoire import PLAIN
from trial.run import Truth
from trial.source import Labelled, labelled, references

CACHE = Path.home() / ".cache/cylforce/decisions"
SEED = 2026  # of the trial's development cases
LEAST = 1e-3  # the probability of the truth that the log score counts at least
FOREIGN, REFERENCE, RANDOM = "foreign", "reference", "random"  # sources
REPERTOIRES = {REFERENCE: PLAIN, RANDOM: None}  # of reference machines: ample recordings, or drawn for each machine
NAMES = (Verdict.EXPLAINED, Verdict.PARTLY)


class Truthful(NamedTuple):
    """The truth of a case: names and places, whether the library has them, whether they are visible, whether the
    machine worked (digging, contact) rather than moved in the air."""

    effects: tuple[tuple[str, str], ...]
    nameable: bool
    visible: bool
    work: bool


class Case(NamedTuple):
    """A case as it is asked: its source and machine, its name, field, references, loads [kg], the truth."""

    source: str
    machine: str
    name: str
    file: Path
    field: tuple[Path, ...]
    reference: tuple[Path, ...]
    loads: dict[str, float]
    truth: Truthful

    @property
    def place(self) -> tuple[str, str]:
        """Source and machine."""
        return self.source, self.machine


def cases_labelled(folder: Path) -> list[Case]:
    """Every recording of labelled machines but the references."""
    found = []
    for each in labelled(folder):
        field = (each.folder / f"{each.key[1]}.parquet",)
        file = each.folder / "machine.toml"
        found.append(Case(FOREIGN, *each.key, file, field, references(each.folder), {}, _of_labelled(each)))
    return found


def _of_labelled(each: Labelled) -> Truthful:
    work = each.label["scenario"].startswith(("dig", "contact"))
    effects = (each.truth,) if each.label["effects"] else ()
    return Truthful(effects, each.nameable, each.over_floor >= VISIBLE, work)


def cases_reference(work: tuple[str, int, Path]) -> list[Case]:
    """Cases of one reference machine of the trial's development generator, those with enough motion; simulated once.
    Its source says whether references, motions, noise and forms are those of every machine or drawn at random."""
    source, place, cache = work
    own = cache / source / f"machine_{place}"
    if not (own / "labels.json").exists():
        _simulate(source, place, own)
    labels, found = read_labels(own), []
    for name, truth in labels.items():
        inputs = json.loads((own / name / "case.json").read_text())
        if not inputs["reference"]:
            continue  # compared with its data sheet: another question, which nothing is calibrated for
        field, clean = (tuple(own / name / file for file in inputs[k]) for k in ("field", "reference"))
        file = own / name / "machine.toml"
        found.append(Case(source, own.name, name, file, field, clean, inputs["loads_kg"], truth))
    return found


def _simulate(source: str, place: int, own: Path) -> None:
    numbers, labels = range(PER_MACHINE * place, PER_MACHINE * (place + 1)), {}
    orders = [o for n in numbers if not (o := order(SEED, n, development=True)).poor and not o.two_links]
    site = Site(orders[0].machine, orders[0].friction, repertoire=REPERTOIRES[source])
    for each in orders:
        case, twin = simulated(site, each)
        folder = own / f"case_{each.number}"
        write(case, folder)
        labels[folder.name] = _of_trial(json.loads(json.dumps(Truth(case, twin, folder).sized(site))))
    _write_labels(own, labels)


def _of_trial(label: dict[str, Any]) -> Truthful:
    effects = tuple((e["name"], e["at"]) for e in label["effects"])
    sizes = [e["over_floor"] for e in label["effects"]]
    work = label.get("scenario") == DIGGING
    return Truthful(effects, label["kind"] != "foreign", bool(sizes) and min(sizes) >= VISIBLE, work)


def _write_labels(own: Path, labels: dict[str, Truthful]) -> None:
    (own / "labels.json").write_text(json.dumps({k: v._asdict() for k, v in labels.items()}, indent=1) + "\n")


def read_labels(own: Path) -> dict[str, Truthful]:
    """The labels of a machine that was stored."""
    found = json.loads((own / "labels.json").read_text())
    return {k: Truthful(tuple((n, a) for n, a in v.pop("effects")), **v) for k, v in found.items()}


@dataclass(frozen=True)
class Scored:
    """The answer of a case.

    case:      the case
    posterior: probability by NAME@AT
    credible:  the credible set
    named:     the causes that are named alone
    verdict:   the verdict
    floors:    the gap at the worst joint, in noise floors
    """

    case: Case
    posterior: dict[str, float]
    credible: list[str]
    named: list[str]
    verdict: str
    floors: float

    @property
    def truth(self) -> str:
        """The main effect of the truth as NAME@AT; no gap of a healthy machine, unknown of what the library lacks."""
        truth = self.case.truth
        if not truth.effects:
            return "@".join(NO_GAP)
        return "@".join(truth.effects[0] if truth.nameable else UNKNOWN)

    @property
    def first(self) -> str:
        """The likeliest answer."""
        return max(self.posterior, key=lambda key: self.posterior[key], default="")

    @property
    def log(self) -> float:
        """Log score: log probability of the truth."""
        return float(np.log(max(self.posterior.get(self.truth, 0.0), LEAST)))

    @property
    def brier(self) -> float:
        """Brier score of the likeliest answer being right."""
        return (self.posterior.get(self.first, 0.0) - float(self.first == self.truth)) ** 2


def answered(work: tuple[Case, Path]) -> Scored:
    """The answer of a case, kept in a cache folder."""
    case, cache = work
    file = cache / "answers" / f"{case.source}_{case.machine}_{case.name}.json"
    if not file.exists():
        question = Question(case.field, case.reference, loads=case.loads)
        found = diagnose(load(case.file), question).answer
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(_kept(found), indent=1) + "\n")
    return Scored(case, **json.loads(file.read_text()))


def _kept(answer: dict[str, Any]) -> dict[str, Any]:
    known = answer.get("probabilities", {"no_gap": 0.0, "unknown": 0.0, "effects": []})
    posterior = {"@".join(NO_GAP): known["no_gap"], "@".join(UNKNOWN): known["unknown"]}
    posterior |= {f"{e['name']}@{e['at']}": e["probability"] for e in known["effects"]}
    alone = answer["effects"] if answer["verdict"] in NAMES else []
    joints = answer.get("gap", {}).get("joints", {})
    return {
        "posterior": posterior,
        "credible": [f"{e['name']}@{e['at']}" for e in answer.get("set", [])],
        "named": [f"{e['name']}@{e['at']}" for e in alone],
        "verdict": answer["verdict"],
        "floors": max((j["fixed"] / max(j["floor"], 1e-9) for j in joints.values()), default=0.0),
    }


def figures(cases: Sequence[Scored]) -> dict[str, str]:
    """Figures of one source, shares with their 95 % bounds."""
    seen = [c for c in cases if c.case.truth.visible and c.case.truth.nameable]
    healthy = [c for c in cases if not c.case.truth.effects]
    foreign = [c for c in cases if c.case.truth.effects and not c.case.truth.nameable]
    alone = [c for c in seen if c.named]
    size = np.mean([len(c.credible) for c in seen]) if seen else np.nan
    return {
        "visible effects: first right": _share(seen, lambda c: c.first == c.truth),
        f"in the 90 % set (mean size {size:.1f})": _share(seen, lambda c: c.truth in c.credible),
        "named alone": _share(seen, lambda c: bool(c.named)),
        "of these right": _share(alone, lambda c: c.named[0] == c.truth),
        "healthy: named or unknown": _share(healthy, lambda c: bool(c.named) or c.verdict == Verdict.UNKNOWN),
        "not in the library: named alone": _share(foreign, lambda c: bool(c.named)),
        "log score": f"{np.mean([c.log for c in (*seen, *healthy)]):.2f}" if seen or healthy else "-",
        "Brier score": f"{np.mean([c.brier for c in (*seen, *healthy)]):.3f}" if seen or healthy else "-",
    }


def _share(cases: Sequence[Scored], holds: Callable[[Scored], bool]) -> str:
    count = sum(map(holds, cases))
    low, high = wilson(count, len(cases)) if cases else (0.0, 1.0)
    return f"{count} of {len(cases)} ({100 * low:.0f} to {100 * high:.0f} %)"


def main() -> int:
    """Compute what is missing, and print a table for each source, in the air and at work."""
    parser = argparse.ArgumentParser(prog="tools/accuracy decisions", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", help="labelled machines")
    parser.add_argument("--reference-machines", type=int, default=0, help="of the development generator")
    parser.add_argument("--random-machines", type=int, default=0, help="with recordings drawn at random")
    parser.add_argument("--cache", type=Path, default=CACHE, help="folder (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=2, help="processes (default: %(default)s)")
    parser.add_argument("--json", type=Path, help="write all answers and figures there")
    options = parser.parse_args()
    work = [(REFERENCE, k, options.cache) for k in range(options.reference_machines)]
    work += [(RANDOM, k, options.cache) for k in range(options.random_machines)]
    with ProcessPoolExecutor(options.workers) as pool:
        cases = [] if options.folder is None else cases_labelled(options.folder)
        cases += [case for found in pool.map(cases_reference, work) for case in found]
        scored = list(pool.map(answered, [(case, options.cache) for case in cases]))
    report, console = dict[str, dict[str, str]](), Console(highlight=False)
    for source in dict.fromkeys(c.case.source for c in scored):
        for title, busy in (("in the air", False), ("at work", True)):
            own = [c for c in scored if c.case.source == source and c.case.truth.work == busy]
            if own:
                report[f"{source} machines, {title}"] = figures(own)
    for title, each in report.items():
        table = Table(title=title)
        table.add_column("what")
        table.add_column("figure", justify="right")
        for what, figure in each.items():
            table.add_row(what, figure)
        console.print(table)
    if options.json:
        answers = [
            {"source": c.case.source, "machine": c.case.machine, "case": c.case.name, "truth": c.truth} | _kept_again(c)
            for c in scored
        ]
        options.json.write_text(json.dumps({"figures": report, "cases": answers}, indent=1) + "\n")
    return 0


def _kept_again(scored: Scored) -> dict[str, Any]:
    names = ("posterior", "credible", "named", "verdict", "floors")
    return {name: getattr(scored, name) for name in names}


if __name__ == "__main__":
    sys.exit(main())
