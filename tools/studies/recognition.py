"""Is an identified file of another machine of the same type noticed, and is the right one ever doubted? The limits of
service/recognition.py come from this table.

Other machine: every simulated machine moves empty with the identified file of every other one (masses within 10 % of
the data sheet, own friction). Right machine: simulated machines empty and digging, reference machines whose oil warms
from 10 to 60 degC after they were identified cold, machines of another simulator from the shared folder, empty, digging
and in contact. Without adaptation, which would follow friction and zeros."""

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from cylforce.commissioning.identification import identify
from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.observation import unusable
from cylforce.estimation.regressor import Rows
from cylforce.estimation.residual import residual
from cylforce.programs.common.play import prepare
from cylforce.programs.common.readings import model_of, recorded_segments
from cylforce.service.recognition import BLOCKS, Recognizer, RecognizerConstants
from cylforce.service.residual import residual_of_arrays
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.estimate import Array
from reference_machine.machine import draw
from studies.unexplained import ROOT, SHARED

MOVES_S = 120.0


class Course(NamedTuple):
    """Along samples: whether another machine is seen (T,), and the largest judgement in units of what is left of a
    machine in order (0: never judged)."""

    another: NDArray[np.bool_]
    largest: float


def recognised(model: Model, tares: Tares, values: Array) -> Course:
    """Recognition along gapless samples (T, S), without adaptation."""
    moved = model.channels.run(values)
    rows, recognizer = model.filtered.run(moved.motion), Recognizer.start(RecognizerConstants(model, tares))
    usable, nothing = np.logical_not(unusable(model, moved)), np.zeros(len(model.machine.rows))
    another, largest = [], 0.0
    for k in range(model.settle_steps, len(rows.torque)):
        instant = Rows(rows.columns[k], rows.torque[k])
        before = recognizer.blocks
        left = residual_of_arrays(residual(model, tares, instant, nothing), rows.columns.shape[-1], 0)
        left.rows = numbers(instant.columns.ravel())
        recognizer.update(left, numbers(usable[k]))
        if recognizer.blocks > max(before, BLOCKS - 1):
            largest = max(largest, recognizer.mean_square)
        another.append(recognizer.another)
    return Course(np.array(another, dtype=bool), largest)


class Case(NamedTuple):
    """A kind of case, whether the file is of the machine that moves, and what to follow."""

    kind: str
    right: bool
    model: Model
    tares: Tares
    segments: list[Array]


def cases(options: argparse.Namespace) -> Iterator[Case]:
    """All."""
    yield from simulated(load(ROOT / "config" / "excavator_20t.toml"), range(1, options.machines + 1))
    for seed in range(400, 400 + options.machines // 3):
        yield from warming(seed)
    for path in sorted(SHARED.glob("foreign_machines/machine_*/machine.toml")):
        yield from foreign(path)


def simulated(loaded: Loaded, seeds: range) -> Iterator[Case]:
    """Every machine with every file."""
    tares = {seed: identify(model_of(loaded), [run(loaded, "moves", seed, MOVES_S)]).tares for seed in seeds}
    for seed in seeds:
        moves, cycles = run(loaded, "moves", seed, MOVES_S / 2.0), run(loaded, "cycles", seed, 4)
        for file in seeds:
            model = Model(loaded.service.machine, loaded.service.filters, tares[file].friction)
            yield Case("simulator, empty", seed == file, model, tares[file], [moves])
            yield Case("simulator, digging", seed == file, model, tares[file], [cycles])


def run(loaded: Loaded, scenario: str, seed: int, amount: float) -> Array:
    """Samples (T, S) of a simulated machine."""
    return np.concatenate([record.values for record in prepare(loaded, scenario, seed, 0.1, amount=amount).records])


def warming(seed: int) -> Iterator[Case]:
    """A reference machine that is identified cold and then warms."""
    machine = draw(seed, friction="foreign")
    with TemporaryDirectory() as folder:
        path = machine.run("commissioning", seed=0, oil_degc=10.0).write(Path(folder))
        loaded = load(Path(folder) / "machine.toml")
        found = identify(model_of(loaded), recorded_segments(loaded, path))
        work = machine.run("warm_up", seed=1, degc=(10.0, 60.0), pieces=8, name="warm").write(Path(folder))
        for values in recorded_segments(loaded, work):
            yield Case("reference machine, oil warms", True, found.model, found.tares, [values])


def foreign(path: Path) -> Iterator[Case]:
    """A machine of another simulator with its own file."""
    loaded = load(path)
    names = ("reference_static", "reference_moving")
    found = identify(
        model_of(loaded), (v for n in names for v in recorded_segments(loaded, path.with_name(f"{n}.parquet")))
    )
    for name in ("empty", "digging", "contact"):
        segments = [*recorded_segments(loaded, path.with_name(f"{name}_in_order.parquet"))]
        yield Case(f"other simulator, {name}", True, found.model, found.tares, segments)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy recognition", description=__doc__)
    parser.add_argument("--machines", type=int, default=6)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found: dict[str, list[tuple[bool, float]]] = {}
    for case in cases(options):
        courses = [recognised(case.model, case.tares, values) for values in case.segments]
        noticed, largest = any(bool(c.another.any()) for c in courses), max(c.largest for c in courses)
        kind = f"{case.kind}, {'its own file' if case.right else 'the file of another machine'}"
        found.setdefault(kind, []).append((noticed, largest))
        print(f"{kind}: {noticed} {largest:.1f}", file=sys.stderr)
    table = Table(title="NOT_THIS_MACHINE")
    for column in ("recordings", "number", "judged", "noticed", "largest judgement, median", "largest"):
        table.add_column(column, justify="left" if column == "recordings" else "right")
    figures: dict[str, Any] = {}
    for kind, each in found.items():
        sizes = [size for _, size in each if size > 0.0]
        figures[kind] = {"number": len(each), "judged": len(sizes), "noticed": sum(noticed for noticed, _ in each)}
        figures[kind] |= {"median": float(np.median(sizes)) if sizes else None, "largest": max(sizes, default=None)}
        table.add_row(kind, *("" if v is None else f"{v:.4g}" for v in figures[kind].values()))
    Console(highlight=False).print(table)
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
