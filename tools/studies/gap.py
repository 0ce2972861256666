"""How long a diagnosis takes and how much memory, for recordings of growing length at 100 Hz (`--form parquet`, `csv`,
or `log`: candump text with all frames). So many minutes of the machine in order, and as many of it with an angle sensor
off its zero: half of them empty, half with a known load, in sessions of three minutes with a pause between. Every
diagnosis is a process of its own; memory is its greatest resident one, interpreter and libraries included."""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from itertools import product
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Any

import numpy as np

from cylforce.effects.imposed import imposed
from cylforce.programs.common.gap_question import Question
from cylforce.programs.common.play import Play
from cylforce.programs.gap import diagnose
from cylforce.programs.sim import write_files
from cylforce.settings.machine_file import Loaded, load
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import Record, Sensors, run, sensors
from cylforce.simulation.simulator import Truth, draw_truth

ROOT = Path(__file__).resolve().parents[2]
CONFIG = ROOT / "config" / "excavator_20t.toml"
FAULT = ("angle_offset", "stick_angle", 0.02)  # rad
LOADS = (0.0, 1000.0)  # kg
MASS_ERROR = 0.1
SESSION_S, PAUSE_S = 180.0, 20.0
COLUMNS = ("minutes", "seconds", "cpu_seconds", "peak_mb", "looked_at_min", "verdict")


def simulated(folder: Path, minutes: float, seed: int, form: str) -> list[Path]:
    """Recordings of the machine in order, empty and loaded, and of it with the fault."""
    loaded, found = load(CONFIG), []
    machine = loaded.service.machine
    made = sensors(machine, loaded.service.nodes)
    for k, (name, kg) in enumerate(product(("order", "field"), LOADS)):
        effects = (imposed(machine, *FAULT),) if name == "field" else ()
        truth = draw_truth(machine, np.random.default_rng((seed, 0)), MASS_ERROR)._replace(effects=effects)
        path = folder / f"{name}_{kg:.0f}.{form}"
        play = Play(loaded, seed, truth, made, {}, sessions(loaded, truth, made, kg, 30.0 * minutes, (seed, k)))
        write_files(play, None, *((path, None) if form == "log" else (None, path)))
        found.append(path)
    return found


def sessions(
    loaded: Loaded, truth: Truth, made: Sensors, kg: float, seconds: float, seed: tuple[int, int]
) -> Iterator[Record]:
    """So many seconds of moves with a load."""
    machine, dt = loaded.service.machine, 1.0 / loaded.service.filters.rate_hz
    for k in range(ceil(seconds / SESSION_S)):
        length = min(SESSION_S, seconds - k * SESSION_S)
        scene = moves(machine, np.random.default_rng((*seed, k)), length, payload=kg, turning=True)
        for record in run(machine, truth, made, [scene], dt=dt, rng=np.random.default_rng((*seed, k, 1))):
            yield record._replace(t=record.t + k * (SESSION_S + PAUSE_S))


def diagnosed(files: list[Path]) -> dict[str, Any]:
    """What this process spends on the diagnosis."""
    begin, used = perf_counter(), process_time()
    loads = {path.name: kg for path, kg in zip(files, 2 * LOADS, strict=True)}
    answer = diagnose(load(CONFIG), Question(tuple(files[2:]), tuple(files[:2]), None, loads)).answer
    (line,) = [x for x in Path("/proc/self/status").read_text().splitlines() if x.startswith("VmHWM")]
    return {
        "seconds": perf_counter() - begin,
        "cpu_seconds": process_time() - used,
        "peak_mb": int(line.split()[1]) / 1024.0,
        "looked_at_min": sum(each["seconds"] for each in answer["looked_at"][:2]) / 60.0,
        "verdict": " ".join([answer["verdict"], *(f"{e['name']}@{e['at']}" for e in answer["effects"])]),
    }


def of_length(minutes: float, options: argparse.Namespace) -> dict[str, Any]:
    """The same in a process of its own, on recordings of that length."""
    with TemporaryDirectory() as folder:
        files = simulated(Path(folder), minutes, options.seed, options.form)
        figures = subprocess.check_output([sys.executable, "-m", "studies.gap", "--diagnose", *map(str, files)])
    return {"minutes": minutes, **json.loads(figures)}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy gap", description=__doc__)
    parser.add_argument("--minutes", type=float, nargs="+", default=[6.0, 30.0, 60.0])
    parser.add_argument("--form", choices=("parquet", "csv", "log"), default="parquet")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--diagnose", type=Path, nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.diagnose:
        print(json.dumps(diagnosed(options.diagnose)))
        return
    from rich.console import Console
    from rich.table import Table

    found = [of_length(minutes, options) for minutes in options.minutes]
    table = Table(title=f"{options.form}, seed {options.seed}, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for column in COLUMNS:
        table.add_column(column, justify="left" if column == "verdict" else "right")
    for row in found:
        table.add_row(*(f"{row[name]:.4g}" if isinstance(row[name], float) else row[name] for name in COLUMNS))
    Console(highlight=False).print(table)
    if options.json:
        options.json.write_text(
            json.dumps({"seed": options.seed, "form": options.form, "rows": found}, indent=1) + "\n"
        )


if __name__ == "__main__":
    main()
