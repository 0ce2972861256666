"""How much of each joint's torque identification explains, on machines in order and with a machine file or wiring that
is wrong in one place. The limits of commissioning/explained.py come from this table.

In order: simulated machines, reference machines, and, where the folder shared beside the repository is there, machines
of another simulator and a real crane. Wrong in one place: a simulated and a reference machine, 25 mistakes each."""

import argparse
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from crane.geometry import crane
from crane.machine_file import text
from cylforce.commissioning.explained import DOUBTFUL, FAR, LITTLE, NOTHING, Quality, quality, row_noise
from cylforce.commissioning.identification import identify
from cylforce.estimation.batch import least_squares
from cylforce.estimation.blocks import chosen
from cylforce.estimation.model import Model
from cylforce.estimation.observation import observed_factors
from cylforce.mechanics.linkages import FourBar, Triangle
from cylforce.mechanics.machine import Cylinder, Machine
from cylforce.programs.common.play import prepare
from cylforce.programs.common.readings import model_of, recorded_segments
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind
from reference_machine.machine import draw

ROOT = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("CYLFORCE_SHARED", ROOT.parent / "shared")) / "data"
SECONDS = 100.0
PRESSURES = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE)


class Case(NamedTuple):
    """A machine file as the estimator has it, and what was recorded."""

    machine: str
    mistake: str
    model: Model
    segments: list[Array]


def simulated(path: Path, seed: int) -> Case:
    """A simulated machine in order."""
    loaded = load(path)
    play = prepare(loaded, "moves", seed, 0.1, amount=SECONDS)
    values = np.concatenate([record.values for record in play.records])
    return Case(f"simulator, {path.stem}, {seed}", "", model_of(loaded), [values])


def reference(seed: int, seconds: float = 300.0) -> Case:
    """A reference machine in order."""
    with TemporaryDirectory() as folder:
        machine = draw(seed, friction="foreign")
        path = machine.run("commissioning", seed=0, duration_s=seconds).write(Path(folder))
        loaded = load(Path(folder) / "machine.toml")
        return Case(f"reference machine {seed}", "", model_of(loaded), list(recorded_segments(loaded, path)))


def foreign() -> Iterator[Case]:
    """Machines of another simulator, from the shared folder."""
    for path in sorted(SHARED.glob("foreign_machines/machine_*/machine.toml")):
        names = ("reference_static", "reference_moving")
        yield _recorded(path.parent.name, load(path), [path.with_name(f"{name}.parquet") for name in names])


def real_crane() -> Iterator[Case]:
    """The real crane, run by run, from the shared folder."""
    folder = SHARED / "hmf_crane"
    if not folder.is_dir():
        return
    with TemporaryDirectory() as work:
        path = Path(work) / "crane.toml"
        path.write_text(text(crane(folder)))
        for run in sorted(folder.glob("*.csv")):
            yield _recorded(f"crane, {run.stem}", load(path), [run])


def _recorded(name: str, loaded: Loaded, paths: list[Path]) -> Case:
    return Case(name, "", model_of(loaded), [v for path in paths for v in recorded_segments(loaded, path)])


def mistakes(good: Case) -> Iterator[Case]:
    """The same with one mistake each."""
    yield from _pins(good)
    yield from _cylinders(good)
    yield from _angles(good)
    machine = good.model.machine
    for j, link in enumerate(machine.links[:-1]):
        links = (*machine.links[:j], replace(link, length=1.2 * link.length), *machine.links[j + 1 :])
        yield _with(good, f"{link.name} length 20 % too large", replace(machine, links=links))


def _pins(good: Case) -> Iterator[Case]:
    for c, cylinder in enumerate(good.model.machine.cylinders):
        linkage = cylinder.linkage
        if not isinstance(linkage, Triangle | FourBar):
            continue
        body, at = linkage.foot
        for axis, place in (("z", at.conjugate()), ("x", -at.conjugate())):
            changed = replace(cylinder, linkage=replace(linkage, foot=(body, place)))
            yield _with(good, f"{cylinder.name} foot, sign of {axis}", _cylinder(good.model.machine, c, changed))


def _cylinders(good: Case) -> Iterator[Case]:
    machine = good.model.machine
    for c, cylinder in enumerate(machine.cylinders):
        rod = cylinder.area_head - cylinder.area_rod
        head = 1.44 * cylinder.area_head
        changed = replace(cylinder, area_head=head, area_rod=head - rod)
        yield _with(good, f"{cylinder.name} bore 20 % too large", _cylinder(machine, c, changed))
        where = [k for k, s in enumerate(machine.signals) if s.kind in PRESSURES and s.index == c]
        yield _swapped(good, f"{cylinder.name} head and rod side exchanged", where[0], where[1])
    heads = [k for k, s in enumerate(machine.signals) if s.kind is Kind.HEAD_PRESSURE]
    for a, b in combinations(heads, 2):
        yield _swapped(good, f"{machine.signals[a].name} on {machine.cylinders[machine.signals[b].index].name}", a, b)


def _angles(good: Case) -> Iterator[Case]:
    machine = good.model.machine
    for k, signal in enumerate(machine.signals):
        if signal.kind is Kind.JOINT_ANGLE:
            link = machine.links[signal.index]
            yield _changed(good, f"{signal.name} counted the other way", k, -1.0, link.angle_low + link.angle_high)
            yield _changed(good, f"{signal.name} 20 deg too large", k, 1.0, np.radians(20.0))


def _with(good: Case, mistake: str, machine: Machine) -> Case:
    return good._replace(mistake=mistake, model=Model(machine, good.model.filters, good.model.friction))


def _cylinder(machine: Machine, c: int, changed: Cylinder) -> Machine:
    return replace(machine, cylinders=(*machine.cylinders[:c], changed, *machine.cylinders[c + 1 :]))


def _swapped(good: Case, mistake: str, a: int, b: int) -> Case:
    order = list(range(len(good.model.machine.signals)))
    order[a], order[b] = b, a
    return good._replace(mistake=mistake, segments=[values[:, order] for values in good.segments])


def _changed(good: Case, mistake: str, k: int, factor: float, offset: float) -> Case:
    segments = [values.copy() for values in good.segments]
    for values in segments:
        values[:, k] = offset + factor * values[:, k]
    return good._replace(mistake=mistake, segments=segments)


def judged(case: Case) -> dict[str, Any]:
    """Quality of a fit of all laws, and what identification says."""
    found: Quality | None = None
    try:
        model = case.model
        fitted = chosen(observed_factors(model, case.segments), list(range(len(model.parameters))))
        fit = least_squares(fitted, row_noise(fitted, model.prior), model.prior)
        found = quality(model, fitted, fit.values, fit.covariance)
        warnings = identify(model, case.segments).warnings
        verdict = "warned" if warnings else "accepted"
        said = "; ".join(warnings)
    except ValueError as error:
        verdict, said = "refused", str(error)
    shares = [] if found is None else [None if np.isnan(x) else float(x) for x in found.explained]
    distance = None if found is None else found.distance
    return {
        "machine": case.machine,
        "mistake": case.mistake,
        "explained": shares,
        "distance": distance,
        "verdict": verdict,
        "said": said,
    }


def cases(options: argparse.Namespace) -> Iterator[Case]:
    """All, the machines in order first."""
    excavator = ROOT / "config" / "excavator_20t.toml"
    for seed in range(1, options.machines + 1):
        for path in (excavator, excavator.with_name("excavator_stick_bucket.toml")):
            yield simulated(path, seed)
    for seed in range(options.machines):
        yield reference(seed)
    yield from foreign()
    yield from real_crane()
    for good in (simulated(excavator, 1), reference(0)) if options.mistakes else ():
        yield from mistakes(good)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy unexplained", description=__doc__)
    parser.add_argument("--machines", type=int, default=6)
    parser.add_argument("--mistakes", action=argparse.BooleanOptionalAction, default=True)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    limit = f"{LITTLE:.0%} ({DOUBTFUL:.0%} if a correction fits)"
    table = Table(title=f"warned below {limit} or above a distance of {FAR:g}, refused below {NOTHING:.0%}")
    for column in ("machine", "mistake", "explained", "distance", "verdict", "said"):
        table.add_column(column, overflow="fold")
    found = []
    for case in cases(options):
        one = judged(case)
        found.append(one)
        shares = ", ".join("not seen" if x is None else f"{100.0 * x:.2f}" for x in one["explained"])
        distance = "" if one["distance"] is None else f"{one['distance']:.1f}"
        table.add_row(one["machine"], one["mistake"], shares, distance, one["verdict"], one["said"])
        print(f"{one['machine']} {one['mistake']}: {one['verdict']}", file=sys.stderr)
    Console(highlight=False).print(table)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
