"""What a step costs against the number of joints and columns: stick and bucket alone (two joints), excavator (three),
and one with a boom of two pieces (four), each with two laws of friction and with all. The machines move empty, with
adaptation on; the kinds in turn, processor time, the least of several rounds, and the median of what the step took over
a fixed piece of work on the same core in the same run, the yardstick of `tools/bench`."""

import argparse
import contextlib
import io
import json
from cmath import rect
from collections.abc import Sequence
from copy import deepcopy
from math import radians
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import tomlkit
from rich.console import Console
from rich.table import Table

from bench import recorded_events, step_us
from cylforce.commissioning.identification import identify
from cylforce.estimation.model import FRICTION, Model
from cylforce.programs.common.readings import recorded_segments
from cylforce.programs.sim import run_sim
from cylforce.service.core import Core
from cylforce.settings.machine_file import load
from cylforce.signals.events import Event

ROOT = Path(__file__).resolve().parents[2]
LAWS = (FRICTION[:2], FRICTION)
# The boom's two pieces: lengths [m], range of the joint between them [deg]; foot and eye of its cylinder, in the lower
# and in the upper piece [m].
LOWER, UPPER, RANGE = 3.0, 2.8, (-60.0, -5.0)
FOOT, EYE = complex(1.2, 0.75), complex(0.2, 0.95)


class Kind(NamedTuple):
    """A machine and its laws: joints, columns, the step's least time [us], and its time over the yardstick's."""

    joints: int
    columns: int
    step_us: float
    yardsticks: float


def two_piece_boom() -> str:
    """The excavator's machine file with a boom of two pieces."""
    machine: Any = tomlkit.parse((ROOT / "config/excavator_20t.toml").read_text(encoding="utf-8"))
    boom = machine["links"][0]
    upper = deepcopy(boom)
    boom |= {"length_m": LOWER, "mass_kg": 1000, "centre_m": [1.5, 0.3], "inertia_kg_m2": 1500}
    upper |= {"name": "upper", "length_m": UPPER, "mass_kg": 700, "centre_m": [1.3, 0.2], "inertia_kg_m2": 900}
    upper["angle_range_deg"] = list(RANGE)
    machine["links"].insert(1, upper)
    cylinder = deepcopy(machine["cylinders"][1])
    cylinder |= {"name": "upper", "length_range_m": lengths()}
    cylinder["linkage"]["foot"] = {"body": "boom", "at_m": [FOOT.real, FOOT.imag]}
    cylinder["linkage"]["eye"] = {"body": "upper", "at_m": [EYE.real, EYE.imag]}
    stick = machine["cylinders"][1]["linkage"]
    stick["foot"] = {"body": "upper", "at_m": [-0.15, 1.0]}
    machine["cylinders"].insert(1, cylinder)
    measure(machine)
    return tomlkit.dumps(machine)


def lengths() -> list[float]:
    """Shortest and longest length [m] of the cylinder of the upper piece, and a centimetre."""
    short, long = sorted(abs(LOWER + EYE * rect(1.0, radians(angle)) - FOOT) for angle in RANGE)
    return [round(short - 0.01, 3), round(long + 0.01, 3)]


def measure(machine: Any) -> None:  # noqa: ANN401 - a document
    """Nodes and sensors of the upper piece: copies of the stick's."""
    for node in [node for node in machine["nodes"] if node["name"].startswith("stick")]:
        other = deepcopy(node)
        other |= {"name": node["name"].replace("stick", "upper"), "node_id": node["node_id"] + 4}
        other["identity"]["serial"] += 4
        machine["nodes"].append(other)
    for sensor in [sensor for sensor in machine["sensors"] if sensor["node"].startswith("stick")]:
        other = deepcopy(sensor)
        other |= {key: sensor[key].replace("stick", "upper") for key in ("name", "at", "node")}
        if "range_deg" in other:
            other["range_deg"] = [RANGE[0] - 10.0, RANGE[1] + 10.0]
        machine["sensors"].append(other)


def cores(config: Path, folder: Path, seconds: float) -> list[tuple[Core, list[Event]]]:
    """With each set of laws the core of a machine that was identified from its motion, and the events of that."""
    loaded, log = load(config), folder / f"{config.stem}.log"
    with contextlib.redirect_stdout(io.StringIO()):
        run_sim(config, scenario="moves", duration=seconds, seed=1, log=log)
    service, segments, events = loaded.service, list(recorded_segments(loaded, log)), list(recorded_events(loaded, log))
    models = [Model(service.machine, service.filters, laws) for laws in LAWS]
    return [(Core(service, identify(model, segments).tares), events) for model in models]


def kinds(rounds: int, seconds: float) -> list[Kind]:
    """All machines with all laws."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        four = folder / "two_piece_boom.toml"
        four.write_text(two_piece_boom(), encoding="utf-8")
        files = [ROOT / "config/excavator_stick_bucket.toml", ROOT / "config/excavator_20t.toml", four]
        made = [each for file in files for each in cores(file, folder, seconds)]
    took = [[step_us(core, events) for core, events in made] for _ in range(rounds)]
    found = []
    for (core, _), same in zip(made, zip(*took, strict=True), strict=True):
        size = core.service.machine.size, len(core.model.filtered.regressor.names)
        found.append(Kind(*size, min(us for us, _ in same), median(us / yard for us, yard in same)))
    return found


def plot(found: Sequence[Kind], path: Path) -> None:
    """Time against columns, one line a number of joints."""
    from matplotlib.figure import Figure  # only here

    figure = Figure(figsize=(6.0, 3.5), layout="constrained")
    axes = figure.subplots()
    for joints in sorted({kind.joints for kind in found}):
        own = [kind for kind in found if kind.joints == joints]
        axes.plot([k.columns for k in own], [k.yardsticks for k in own], "o-", label=f"{joints} joints")
    axes.set(xlabel="columns", ylabel="one step, yardsticks", ylim=(0.0, None))
    axes.legend()
    axes.grid(alpha=0.3)
    figure.savefig(path)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy joints", description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=120.0, help="of motion")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw it, too")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there, too")
    options = parser.parse_args()
    found = kinds(options.rounds, options.seconds)
    text = Table(title="One step, processor time, least of the rounds")
    for words in ("joints", "columns", "us", "yardsticks"):
        text.add_column(words, justify="right")
    for kind in found:
        text.add_row(f"{kind.joints}", f"{kind.columns}", f"{kind.step_us:.0f}", f"{kind.yardsticks:.2f}")
    Console(highlight=False).print(text)
    if options.plot:
        plot(found, options.plot)
    if options.json:
        options.json.write_text(json.dumps([kind._asdict() for kind in found], indent=1) + "\n")


if __name__ == "__main__":
    main()
