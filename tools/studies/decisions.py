"""Which layer that decides generalises best? Layers of a diagnosis compared on evidence that is computed once.

Of every case what was searched is kept in a cache folder, and the rows of its recordings (some 50 MB a case), so that
other hypotheses are searched in half the time: of the labelled machines in FOLDER, and of reference machines from the
development generator of the withheld trial. A layer turns them into probabilities of "no gap", of every effect at its
place, and of "unknown". Everyday differences are learnt on the other source than the one that is scored, the
calibration on other machines than the one that is scored."""

import argparse
import json
import pickle
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from cylforce.diagnosis.answer.calibration import Outcomes, calibrated
from cylforce.diagnosis.answer.learnt import AT_WORK
from cylforce.diagnosis.columns.floor import noise_floor
from cylforce.diagnosis.columns.problem import Problem, looked_at
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.diagnosis.inference.asking import Asking, noisy
from cylforce.diagnosis.inference.discrepancy import Sums
from cylforce.diagnosis.inference.idle import idle
from cylforce.diagnosis.inference.in_order import InOrder
from cylforce.diagnosis.inference.posterior import (
    NOTHING,
    UNKNOWN,
    Asked,
    Belief,
    believed,
    largest_evidence,
)
from cylforce.diagnosis.inference.search import asked, examined
from cylforce.diagnosis.numbers import EVERYDAY, IN_ORDER, ODD
from cylforce.estimation.model import Model
from cylforce.programs.common.gap_question import Question
from cylforce.programs.common.recorded import chosen
from cylforce.programs.common.row_cache import KeepingViewer, RowCache
from cylforce.programs.gap import ALWAYS, viewed_by
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.estimate import Array
from layers.everyday import learnt
from layers.intervals import wilson
from layers.logistic import fitted
from trial.cases import simulated, write
from trial.field import Site
from trial.judged import CERTAIN, DIGGING, VISIBLE
from trial.orders import PER_MACHINE, order
from trial.repertoire import PLAIN
from trial.run import Truth
from trial.source import Labelled, labelled, references

CACHE = Path.home() / ".cache/cylforce/decisions"
SEED = 2026  # of the trial's development cases
ALONE = 0.8  # the probability from which on one cause is named alone
ODD_ONE = 2  # the outcome "nothing of the library"
MOST_BYTES = 40_000_000_000  # of rows: all cases', so that a search of other hypotheses starts from them
ROOMS = ("signals", "mechanics", "effects", "estimation", "diagnosis/columns")  # whose code makes rows
POWERS = tuple(float(x) for x in np.geomspace(1e-3, 1.0, 31))  # of the calibration, that are tried
LEAST = 1e-3  # the probability of the truth that the log score counts at least
FOREIGN, REFERENCE, RANDOM = "foreign", "reference", "random"  # sources
REPERTOIRES = {REFERENCE: PLAIN, RANDOM: None}  # of reference machines: ample recordings, or drawn for each machine


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
    sizes = [e.get("sigmas", label.get("sigmas", 0.0)) or 0.0 for e in label["effects"]]
    work = label.get("scenario") == DIGGING
    return Truthful(effects, label["kind"] != "foreign", bool(sizes) and min(sizes) >= CERTAIN, work)


def _write_labels(own: Path, labels: dict[str, Truthful]) -> None:
    (own / "labels.json").write_text(json.dumps({k: v._asdict() for k, v in labels.items()}, indent=1) + "\n")


def read_labels(own: Path) -> dict[str, Truthful]:
    """The labels of a machine that was stored."""
    found = json.loads((own / "labels.json").read_text())
    return {k: Truthful(tuple((n, a) for n, a in v.pop("effects")), **v) for k, v in found.items()}


def viewed(loaded: Loaded, case: Case) -> tuple[Viewer, Array | None, list[Any], list[Any]]:
    """Model and tares as `cylforce gap` takes them, how well these are known, references and field."""
    clean, faulty = (chosen(loaded, paths, case.loads).stretches for paths in (case.reference, case.field))
    clean = idle(Model(loaded.service.machine, loaded.service.filters, ALWAYS), clean)
    own = viewed_by(loaded, Question(case.field, case.reference), clean)
    return own.viewer, own.known, clean, faulty


def in_order(work: tuple[Case, Path]) -> tuple[InOrder, Sums]:
    """A machine and a recording of it in order; kept in the cache folder."""
    case, cache = work
    file = cache / "order" / f"{case.source}_{case.machine}_{case.name}.pickle"
    if not file.exists():
        viewer, known, clean, faulty = viewed(load(case.file), case)
        wanted = asked(viewer.model.machine)
        known = np.sqrt(np.diag(viewer.model.prior.covariance)) if known is None else known
        seen = [looked_at(viewer, group, wanted) for group in (clean, faulty)]
        problem = Problem(viewer.model, known, wanted, seen[0], seen[1], tares=viewer.tares)
        floor = noise_floor(problem)
        put = Asking(viewer, problem, floor, noisy(viewer, problem, floor, np.random.default_rng(1)))
        pair = put.machine({}), put.sums(problem.faulty, put.noisy.faulty)
        _pickled(file, pair)
    found: tuple[InOrder, Sums] = pickle.loads(file.read_bytes())  # written by this program
    return found


def _pickled(file: Path, value: object) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.with_suffix(".part").write_bytes(pickle.dumps(value))
    file.with_suffix(".part").rename(file)


class Row(NamedTuple):
    """A case with what was searched of it."""

    case: Case
    asked: Asked
    working: bool

    @property
    def truth(self) -> Truthful:
        """The truth."""
        return self.case.truth


def searched(work: tuple[Case, dict[str, float], Path]) -> Row:
    """All hypotheses of a case; kept in the cache folder."""
    case, everyday, cache = work
    file = cache / "asked" / f"{case.source}_{case.machine}_{case.name}.pickle"
    if not file.exists():
        loaded = load(case.file)
        viewer, known, clean, faulty = viewed(loaded, case)
        names = frozenset(path.name for path in (*case.field, *case.reference))
        rows = RowCache(cache.parent / "rows", MOST_BYTES)
        viewer = KeepingViewer(viewer.model, viewer.tares, rows, names, loaded.sha256, ROOMS)
        found = examined(viewer, faulty, clean, np.random.default_rng(1), known=known, everyday=everyday)
        _pickled(file, (found.asked, found.working))
    return Row(case, *pickle.loads(file.read_bytes()))


@dataclass(frozen=True)
class Scored:
    """A case, and the answer of a layer."""

    row: Row
    answer: Belief

    @property
    def right(self) -> bool:
        """Whether the likeliest answer is true: for a pair one of both, for what no library has "unknown"."""
        return self.answer.first in self.true

    @property
    def true(self) -> set[tuple[str, str]]:
        """All answers that are true."""
        truth = self.row.truth
        if not truth.effects:
            return {NOTHING}
        return set(truth.effects) if truth.nameable else {UNKNOWN, *truth.effects}

    @property
    def alone(self) -> bool:
        """Whether one effect is named alone."""
        name = self.answer.first[0]
        return name not in {NOTHING[0], UNKNOWN[0]} and self.answer.probability >= ALONE

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
        "in 90 % set": _share(known, lambda c: bool(c.true & set(c.answer.credible))),
        "its size": f"{np.mean(sizes):.1f}" if sizes else "-",
        "named alone": _share(known, lambda c: c.alone),
        "of these right": _share(alone, lambda c: c.right),
        "in order, named": _share(order_, lambda c: c.alone),
        "in order, no gap": _share(order_, lambda c: c.right),
        "not in library, wrongly named": _share(foreign, lambda c: c.alone and not c.right),
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
    """The answers of every layer; the calibration is fitted on other machines than the one it is used for."""
    beliefs = [believed(r.asked) for r in rows]
    found = {
        "largest evidence": [Scored(r, largest_evidence(r.asked)) for r in rows],
        "probability model": [Scored(r, b) for r, b in zip(rows, beliefs, strict=True)],
    }
    pairs = list(zip(rows, beliefs, strict=True))
    found["with calibration"] = _calibrated(pairs, lambda r: r.case.place)
    if len({r.case.source for r in rows}) > 1:
        found["calibrated by other sources"] = _calibrated(pairs, lambda r: r.case.source)
    return found


def _calibrated(pairs: Sequence[tuple[Row, Belief]], group: Callable[[Row], object]) -> list[Scored]:
    """Each group of cases with the calibration that the others teach."""
    found = []
    for own in dict.fromkeys(group(r) for r, _ in pairs):
        others = [r for r, _ in pairs if group(r) != own]
        by = {working: calibration(others, working) for working in {r.working for r in others}}
        found += [
            Scored(r, calibrated(b, by[r.working]) if r.working in by else b) for r, b in pairs if group(r) == own
        ]
    return found


def without_their_effect(rows: Sequence[Row]) -> list[Scored]:
    """Visible single effects, each asked as if it were not in the library, with the calibration of other machines."""
    each = [r for r in rows if r.truth.visible and len(r.truth.effects) == 1 and not r.truth.work]
    found = []
    for place in dict.fromkeys(r.case.place for r in each):
        by = calibration([r for r in rows if r.case.place != place])
        own = [r for r in map(left_out, (r for r in each if r.case.place == place)) if r]
        found += [Scored(r, calibrated(believed(r.asked), by)) for r in own]
    return found


def calibration(rows: Sequence[Row], working: bool = False) -> Outcomes:
    """Fitted on all cases in the air (or all of which is said that the machine was `working`), however faint their
    effect is, and, ODD times, on those with one without its hypotheses; machines in order, with an effect, and with
    one that the library lacks count together as their prior probabilities say, not as often as somebody simulated them;
    then the power with the best log score."""
    own = [r for r in rows if (r.working if working else not r.truth.work)]
    cases = [Scored(r, believed(r.asked)) for r in own]
    less = [Scored(r, believed(r.asked)) for r in map(left_out, own) if r]
    told = [_outcome(c) for c in cases] + [ODD_ONE] * len(less)
    weight = np.concatenate([np.ones(len(cases)), np.full(len(less), ODD)])
    weight *= _as_often([*(c.row.truth for c in cases), *(c.row.truth for c in less)], weight)
    features = np.array([c.answer.features for c in (*cases, *less)])

    def by(power: float) -> Outcomes:
        return plain._replace(tempered=power)

    plain = fitted(features, np.array(told), weight, 1.0)

    def score(power: float) -> float:
        each = [Scored(c.row, calibrated(c.answer, by(power))).probability for c in cases]
        return float(np.sum(weight[: len(each)] * np.log(np.maximum(each, LEAST))))

    return by(max(POWERS, key=score))


def _as_often(truths: Sequence[Truthful], weight: Array) -> Array:
    """By what the `weight` (N,) of each case is multiplied so that each kind of truth weighs as its prior says."""
    kinds = np.array([0 if not t.effects else 1 if t.nameable else 2 for t in truths])
    share = np.array([IN_ORDER, 1.0 - IN_ORDER - ODD, ODD])
    whole = np.bincount(kinds, weight, minlength=len(share))
    share = np.where(whole > 0.0, share, 0.0)
    return np.asarray((share / share.sum() * weight.sum() / np.where(whole > 0.0, whole, 1.0))[kinds])


def _outcome(case: Scored) -> int:
    """Which of the calibration's outcomes is true: no gap, the first effect, nothing of the library, another effect."""
    effects = [k for k in case.answer.of if k not in (NOTHING, UNKNOWN)]
    first = max(effects, key=lambda k: case.answer.of[k])
    if not case.row.truth.effects:
        return 0
    if first in case.row.truth.effects:
        return 1
    return 3 if case.row.truth.nameable else ODD_ONE


def left_out(row: Row) -> Row | None:
    """A case as if its effects were not in the library: without their hypotheses. None where that is no question."""
    names, told = {name for name, _ in row.truth.effects}, row.asked
    if not names or not row.truth.nameable:
        return None
    kept = tuple(h for h in told.hypotheses if not names & {told.forms[p].name for p in h.which})
    happened = tuple(h for h in told.happened if h.key[0] not in names)
    truth = row.truth._replace(nameable=False)
    found = Row(row.case._replace(truth=truth), replace(told, hypotheses=kept, happened=happened), row.working)
    return found if any(h.which for h in kept) else None


HEAD = '''"""What was learnt from labelled cases, by `tools/accuracy decisions --write`: data."""

from cylforce.diagnosis.answer.calibration import Outcomes

'''
NO_WORK = "AT_WORK: Outcomes | None = None\n"


def written(air: Outcomes, work: Outcomes | None) -> str:
    """The module that the diagnosis reads."""
    return HEAD + _written("CALIBRATION", air) + "\n" + (_written("AT_WORK", work) if work else NO_WORK)


def _written(name: str, by: Outcomes) -> str:
    weights = "".join(f"        {tuple(round(x, 3) for x in each)},\n" for each in by.weights)
    scales = "".join(f"    {tuple(round(x, 3) for x in each)},\n" for each in (by.mean, by.scale))
    own = f"{scales}    (\n{weights}    ),\n    {by.tempered:.4g},\n)\n"
    return f"{name}: Outcomes | None = Outcomes(\n" + own


def main() -> int:
    """Store what is missing, search, score, print."""
    parser = argparse.ArgumentParser(prog="accuracy decisions", description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="labelled machines (labels.json)")
    parser.add_argument("--reference-machines", type=int, default=6)
    parser.add_argument("--random-machines", type=int, default=0, help="with references, motions, noise at random")
    parser.add_argument("--air", action="store_true", help="only recordings in the air; what work teaches is kept")
    parser.add_argument("--learn", action="store_true", help="learn everyday differences from the other source")
    parser.add_argument("--cache", type=Path, default=CACHE)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--write", type=Path, help="write what was learnt: the diagnosis' learnt.py")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    try:
        cases = cases_labelled(options.folder)
    except (OSError, ValueError, KeyError) as error:
        print(f"accuracy decisions: {options.folder}: needs labels.json and its recordings: {error}", file=sys.stderr)
        return 2
    counts = ((REFERENCE, options.reference_machines), (RANDOM, options.random_machines))
    wanted = [(source, place, options.cache) for source, count in counts for place in range(count)]
    with ProcessPoolExecutor(options.processes) as pool:
        cases += [case for each in pool.map(cases_reference, wanted) for case in each]
    cases = [c for c in cases if not (options.air and c.truth.work)]
    plain = [c for c in cases if not c.truth.effects and not c.truth.work]
    cache = options.cache / ("learnt" if options.learn else "usual")
    with ProcessPoolExecutor(options.processes) as pool:
        usual = dict[str, dict[str, float]](dict.fromkeys((FOREIGN, REFERENCE, RANDOM), EVERYDAY))
        if options.learn:
            told = pool.map(in_order, [(c, options.cache) for c in plain])
            pairs = list(zip(plain, told, strict=True))
            others = [[pair for c, pair in pairs if c.source != source] for source in usual]
            usual = dict(zip(usual, pool.map(learnt, others), strict=True))
        rows = list(pool.map(searched, [(c, usual[c.source], cache) for c in cases]))
    answers = layers(rows)
    less = without_their_effect(rows)
    report: dict[str, dict[str, dict[str, str]]] = {
        source: {name: figures([s for s in all_of if s.row.case.source == source]) for name, all_of in answers.items()}
        for source in dict.fromkeys(c.source for c in cases)
    }
    for source, by_layer in report.items():
        own = _share([s for s in less if s.row.case.source == source], lambda c: c.alone)
        for name, each in by_layer.items():
            each["left out of the library, named"] = own if name == "with calibration" else "-"
    show(report, Console(highlight=False))
    if options.write:
        busy = not options.air and any(r.working for r in rows)
        work = calibration(rows, working=True) if busy else AT_WORK if options.air else None
        options.write.write_text(written(calibration(rows), work))
    if options.json:
        cases_ = {name: [_record(s) for s in all_of] for name, all_of in answers.items()}
        options.json.write_text(json.dumps({"figures": report, "cases": cases_}, indent=1) + "\n")
    return 0


def _record(scored: Scored) -> dict[str, Any]:
    row, answer = scored.row, scored.answer
    best = sorted(answer.of.items(), key=lambda item: -item[1])[:5]
    return {
        "source": row.case.source,
        "machine": row.case.machine,
        "case": row.case.name,
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
