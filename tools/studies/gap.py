"""How long a diagnosis takes and how much memory, for recordings of growing length: the machine in order, and the same
with an angle sensor off its zero, each so many minutes at 100 Hz (`--form parquet`, `csv`, or `log`: candump text with
all frames). Every diagnosis is a process of its own; memory is its greatest resident one, interpreter and libraries
included."""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
CONFIG = ROOT / "config" / "excavator_20t.toml"
os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")  # before numpy

FAULT = ("angle_offset", "stick_angle", 0.02)  # rad
MASS_ERROR = 0.1
KEYS = ("seconds", "cpu_seconds", "peak_mb", "looked_at_min", "verdict")


def simulated(folder: Path, minutes: float, seed: int, form: str) -> tuple[Path, Path]:
    """A recording of the machine in order, and one of it with the fault."""
    import numpy as np

    from cylforce.core.scenario import moves
    from cylforce.core.sensing import run, sensors
    from cylforce.core.simulated_effects import imposed
    from cylforce.core.simulator import draw_truth
    from cylforce.edges.settings import load
    from cylforce.programs.sim import Play, write_files

    loaded = load(CONFIG)
    service, machine = loaded.service, loaded.service.machine
    made, found = sensors(machine, service.nodes), []
    for k, effects in enumerate(((), (imposed(machine, *FAULT),))):
        path = folder / f"{('order', 'field')[k]}.{form}"
        truth = draw_truth(machine, np.random.default_rng((seed, 0)), MASS_ERROR)._replace(effects=effects)
        scene, noise = moves(machine, np.random.default_rng((seed, 1, k)), 60.0 * minutes), (seed, 2, k)
        records = run(machine, truth, made, [scene], dt=1.0 / service.filters.rate_hz, rng=np.random.default_rng(noise))
        play = Play(loaded, seed, truth, made, {}, records)
        write_files(play, None, *((path, None) if form == "log" else (None, path)))
        found.append(path)
    return found[0], found[1]


def diagnosed(order: Path, field: Path) -> dict[str, Any]:
    """What this process spends on the diagnosis."""
    begin, used = perf_counter(), process_time()
    from cylforce.edges.settings import load
    from cylforce.programs.gap import Question, diagnose

    answer = diagnose(load(CONFIG), Question((field,), (order,))).answer
    (line,) = [x for x in Path("/proc/self/status").read_text().splitlines() if x.startswith("VmHWM")]
    return {
        "seconds": perf_counter() - begin,
        "cpu_seconds": process_time() - used,
        "peak_mb": int(line.split()[1]) / 1024.0,
        "looked_at_min": answer["looked_at"][0]["seconds"] / 60.0,
        "verdict": " ".join([answer["verdict"], *(f"{e['name']}@{e['at']}" for e in answer["effects"])]),
    }


def of_length(minutes: float, options: argparse.Namespace) -> dict[str, Any]:
    """The same in a process of its own, on recordings of that length."""
    with TemporaryDirectory() as folder:
        files = simulated(Path(folder), minutes, options.seed, options.form)
        told = subprocess.check_output([sys.executable, __file__, "--diagnose", *map(str, files)])
    return {"minutes": minutes, **json.loads(told)}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, nargs="+", default=[6.0, 30.0, 60.0])
    parser.add_argument("--form", choices=("parquet", "csv", "log"), default="parquet")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--diagnose", type=Path, nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.diagnose:
        print(json.dumps(diagnosed(*options.diagnose)))
        return
    from rich.console import Console
    from rich.table import Table

    found = [of_length(minutes, options) for minutes in options.minutes]
    table = Table(title=f"{options.form}, seed {options.seed}, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for column in ("minutes", *KEYS):
        table.add_column(column, justify="left" if column == "verdict" else "right")
    for row in found:
        table.add_row(*(f"{v:.4g}" if isinstance(v, float) else v for v in row.values()))
    Console(highlight=False).print(table)
    if options.json:
        options.json.write_text(
            json.dumps({"seed": options.seed, "form": options.form, "rows": found}, indent=1) + "\n"
        )


if __name__ == "__main__":
    main()
