"""Closed loop: a machine of the trial with a hidden effect, a first recording, then up to two recommended motions.

Only effects that the first recording shows are counted: they add 2.5 noise floors at a joint.

How many machines are decided, rightly or wrongly, and does a right answer stay right? Machine and effect are the same
in all recordings. A motion is what `cylforce checkup` recommends: joint angles over time, which the pumps and valves of
the reference machine carry out with their errors."""

import argparse
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.stats import beta

from cylforce.mechanics.machine import Machine
from cylforce.programs.checkup import Checked, End, concluded
from cylforce.programs.common.gap_question import Question
from cylforce.programs.experiments.catalogue import RecommendedMotion
from cylforce.programs.gap import diagnose
from cylforce.settings.machine_file import Loaded, load
from cylforce.simulation.trajectory import follow
from reference_machine.plan import RATE
from trial.cases import drawn
from trial.effects.fault import Fault, Stretch
from trial.field import Piece, Site, faulty
from trial.judged import VISIBLE
from trial.motion import stage
from trial.orders import Order, order
from trial.repertoire import LOAD_KG
from trial.repertoire import drawn as drawn_repertoire
from trial.sigmas import Floor, Rows, compared

Array = NDArray[np.float64]
MOTIONS = 2  # that are recommended after the first recording
OIL_DEGC = 45.0  # of the recommended motions, some minutes after the first recording
RUN = 700  # number of the first recommended motion's run: none of the trial's own
ENDS = 0.05, 0.95  # of an interval


@dataclass(frozen=True)
class ClosedLoop:
    """A machine after its first recording and after the recommended motions.

    case:         number
    effect:       name and place of the hidden effect; "no_gap" of a healthy machine
    floors:       torque that the effect adds in the first recording, at the joint where it adds most, over the residual
                  of the clean machine (both by the simulation); 0 of a healthy machine
    before:       first cause after the first recording
    after:        first cause at the end
    right_before: whether the first cause is right after the first recording
    right_after:  whether it is right at the end
    decided:      whether the check-up decided: one cause, one joint name, or a healthy machine
    right:        whether what it decided is true
    motions:      how many were recorded
    """

    case: int
    effect: str
    floors: float
    before: str
    after: str
    right_before: bool
    right_after: bool
    decided: bool
    right: bool
    motions: int


def piece(site: Site, machine: Machine, motion: RecommendedMotion, number: int) -> Piece:
    """Return a motion as the machine carries it out: lengths of its cylinders by the machine file's geometry."""
    rows = round(motion.scene.duration * RATE)
    course = follow(motion.scene, np.arange(rows) / RATE)
    load_kg = LOAD_KG if motion.load_kg else 0.0
    slope = (float(np.degrees(motion.pitch)), 0.0)
    run = RUN + number
    made = stage(site.machine, "strokes", rows / RATE, run, slope=slope, degc=OIL_DEGC, load_kg=load_kg, slew=False)
    (plan,) = made.plans
    kept = min(plan.rows, rows)
    working = site.machine.geometry.working
    lengths = np.clip(machine.geometry(course.theta).length[:kept], *working.T)
    plan = replace(plan, lengths=_as_long(lengths, plan.rows), slew=_as_long(course.turn[:kept, None], plan.rows)[:, 0])
    name = f"step_{number}{'_loaded' if load_kg else ''}"
    stretch = Stretch(name, motion.worked_s, plan.rows / RATE, made.pitch, made.roll, load_kg)
    return Piece(stretch, site.machine, made, plan)


def _as_long(course: Array, rows: int) -> Array:
    """Return a course (T, ...) of so many rows; it stays where it ends."""
    return np.concatenate([course, np.repeat(course[-1:], max(rows - len(course), 0), axis=0)])[:rows]


def written(site: Site, folder: Path, name: str, values: Array, begins_s: float = 0.0) -> Path:
    """Write a recording."""
    path = folder / f"{name}.parquet"
    t_s = begins_s + np.arange(len(values)) / RATE
    pq.write_table(pa.table(dict(zip(("t_s", *site.signals), (t_s, *values.T), strict=True))), path)
    return path


@dataclass(frozen=True)
class Case:
    """A machine with hidden effects, and its first recording.

    wanted: its order
    site:   where the machine is recorded
    pieces: of the first recording
    faults: the hidden effects; none of a healthy machine
    """

    wanted: Order
    site: Site
    pieces: tuple[Piece, ...]
    faults: tuple[Fault, ...]

    @classmethod
    def of(cls, wanted: Order) -> "Case":
        """Return the case of an order."""
        site = Site(wanted.machine, wanted.friction)
        pieces = tuple(site.showing(wanted.names))
        faults, _ = drawn(wanted, pieces, np.random.default_rng([*wanted.seed, 11]))
        return cls(wanted, site, pieces, tuple(faults))

    def values(self, piece: Piece, faults: Sequence[Fault]) -> Array:
        """Return the readings (T, S) of a recording with effects; the noise is the same with and without them."""
        noise = (self.site.seed, self.wanted.number)
        return np.asarray(self.site.shown(piece.values(faulty(piece, list(faults)), noise)))

    @property
    def floors(self) -> float:
        """Torque that the effects add, rms, over the clean machine's residual, at the worst joint."""
        if not self.faults:
            return 0.0
        with TemporaryDirectory() as name:
            path = Path(name) / "machine.toml"
            path.write_text(self.site.data_sheet)
            floor = Floor(load(path), LOAD_KG)

        def rows(faults: Sequence[Fault]) -> list[Rows]:
            return [floor.rows(p.stretch.name, self.values(p, faults), p.quiet) for p in self.pieces]

        quiet = {p.stretch.name: p.quiet for p in self.site.reference_pieces}
        references = [floor.rows(n, self.site.shown(v), quiet[n]) for n, v in self.site.references.items()]
        return compared(floor, references, rows(()), rows(self.faults)).added


def closed_loop(wanted: Order, floors: float) -> ClosedLoop:
    """Diagnose a machine, and record what is recommended, until it is decided or MOTIONS are recorded.

    floors: of its effects in the first recording (`Case.floors`)
    """
    case = Case.of(wanted)
    site = case.site
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "machine.toml").write_text(site.data_sheet)
        loaded = load(folder / "machine.toml")
        references = tuple(written(site, folder, n, site.shown(v)) for n, v in site.references.items())

        def recorded(each: Piece) -> Path:
            return written(site, folder, each.stretch.name, case.values(each, case.faults), each.stretch.begin_s)

        field = [recorded(each) for each in case.pieces]
        first = checked = _all_of(loaded, field, references)
        count = 0
        while checked.end is End.OPEN and checked.next is not None and count < MOTIONS:
            field.append(recorded(piece(site, loaded.service.machine, checked.next, count)))
            count += 1
            checked = _all_of(loaded, field, references)
    truth = {(f.name, f.at) for f in case.faults} or {("no_gap", "")}
    return ClosedLoop(
        wanted.number,
        ", ".join(_named(key) for key in sorted(truth)),
        floors,
        _named(_first(first)),
        _named(_first(checked)),
        _first(first) in truth,
        _first(checked) in truth,
        checked.end in (End.CERTAIN, End.HEALTHY, End.INSEPARABLE),
        _is_right(checked, truth),
        count,
    )


def _all_of(loaded: Loaded, field: Sequence[Path], references: tuple[Path, ...]) -> Checked:
    """Return what all recordings together say, as the last step of a check-up."""
    loads = {path.name: LOAD_KG for path in (*field, *references) if "loaded" in path.name}
    question = Question(tuple(field), references, loads=loads)
    return concluded(loaded.service.machine, question, diagnose(loaded, question))[1]


def _first(checked: Checked) -> tuple[str, str]:
    causes = checked.steps[-1].causes
    return causes[0][0] if causes else ("not_observable", "")


def _named(key: tuple[str, str]) -> str:
    return f"{key[0]}@{key[1]}" if key[1] else key[0]


def _is_right(checked: Checked, truth: set[tuple[str, str]]) -> bool:
    """Return whether what is decided is true; a joint name is right if it holds the effect."""
    if checked.end is End.INSEPARABLE:
        return bool(truth & set(checked.inseparable))
    if checked.end is End.HEALTHY:
        return truth == {("no_gap", "")}
    return checked.end is End.CERTAIN and _first(checked) in truth


def interval(hits: int, cases: int) -> str:
    """Return a share with its 90 % interval (Clopper-Pearson)."""
    if not cases:
        return "-"
    low = beta.ppf(ENDS[0], hits, cases - hits + 1) if hits else 0.0
    high = beta.ppf(ENDS[1], hits + 1, cases - hits) if hits < cases else 1.0
    return f"{hits} of {cases} ({low:.0%} to {high:.0%})"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy checkup", description=__doc__)
    parser.add_argument("--cases", type=int, default=8)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--faulty", action="store_true", help="no healthy machines")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    orders, levels = list[Order](), list[float]()
    number = options.first
    while len(orders) < options.cases:
        each, number = order(options.seed, number, development=True), number + 1
        kinds = ("known",) if options.faulty else ("known", "none")
        if each.kind not in kinds or each.two_links or not drawn_repertoire(each.machine).references:
            continue
        plain = replace(each, clutter=False)
        floors = Case.of(plain).floors
        if each.kind == "none" or floors >= VISIBLE:
            orders.append(plain)
            levels.append(floors)
    with ProcessPoolExecutor(options.workers) as pool:
        found = []
        for outcome in pool.map(closed_loop, orders, levels):
            print(outcome, flush=True)
            found.append(outcome)
    console = Console(highlight=False, width=140)
    table = Table(title=f"closed loop, seed {options.seed}")
    for column in ("case", "hidden", "floors", "first cause", "at the end", "motions", "decided", "right"):
        table.add_column(column)
    for o in found:
        cells = (o.case, o.effect, f"{o.floors:.1f}", o.before, o.after, o.motions, o.decided, o.right)
        table.add_row(*map(str, cells))
    console.print(table)
    decided = [each for each in found if each.decided]
    lost = [each for each in found if each.right_before and each.decided and not each.right]
    console.print(f"decided and right: {interval(sum(e.right for e in decided), len(found))}")
    console.print(f"decided and wrong: {interval(sum(not e.right for e in decided), len(found))}")
    console.print(f"first cause right before: {interval(sum(e.right_before for e in found), len(found))}")
    console.print(f"first cause right after: {interval(sum(e.right_after for e in found), len(found))}")
    console.print(f"right before and wrong after: {interval(len(lost), sum(e.right_before for e in found))}")
    if options.json:
        options.json.write_text(json.dumps([asdict(each) for each in found], indent=1) + "\n")


if __name__ == "__main__":
    main()
