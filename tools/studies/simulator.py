"""Payload and tip force on our own simulated excavator: machines whose masses are 10 % off the machine file, identified
from two minutes of empty moves, then ten digging cycles each; all through event logs, faster than real time."""

import argparse
import contextlib
import io
import json
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from cylforce.files.truth import read_truth
from cylforce.programs.common.score import score_cycles, score_force
from cylforce.programs.identify import run_identify
from cylforce.programs.replay import run_replay
from cylforce.programs.sim import run_sim
from cylforce.settings.machine_file import load

ROOT = Path(__file__).resolve().parents[2]
CYCLES = 10


def one_machine(work: tuple[Path, int]) -> dict[str, Any]:
    """Errors [kg] of all cycles, their standard errors, and the force's score."""
    config, seed = work
    loaded = load(config)
    with TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        moves, cycles, truth = (Path(folder) / name for name in ("moves.log", "cycles.log", "truth.csv"))
        tares = Path(folder) / "identified.toml"
        run_sim(config, scenario="moves", seed=seed, log=moves)
        run_identify(loaded, [moves], tares)
        run_sim(config, scenario="cycles", cycles=CYCLES, seed=seed, log=cycles, truth=truth)
        found, wanted = run_replay(loaded, cycles, tares), read_truth(truth)
    scores = score_cycles(wanted, found.bookings)
    booked = [s for s in scores if s.estimated_kg is not None]
    return {
        "machine": seed,
        "cycles": len(scores),
        "errors_kg": [s.estimated_kg - s.true_kg for s in booked if s.estimated_kg is not None],
        "standard_errors_kg": [s.standard_error_kg for s in booked],
        "force": score_force(wanted, found.estimates)._asdict(),
    }


def table_rows(found: list[dict[str, Any]], rated: float) -> Iterator[tuple[str, str]]:
    """What was measured, in words."""
    errors = np.concatenate([f["errors_kg"] for f in found])
    spread = np.concatenate([f["standard_errors_kg"] for f in found])
    total = sum(f["cycles"] for f in found)
    yield "cycles booked", f"{errors.size} of {total}"
    yield (
        "payload error, rms",
        f"{np.sqrt(np.mean(errors**2)):.1f} kg = {100 * np.sqrt(np.mean(errors**2)) / rated:.2f} %",
    )
    yield (
        "payload error, largest",
        f"{np.abs(errors).max():.1f} kg = {100 * np.abs(errors).max() / rated:.2f} % of rated",
    )
    yield "error over standard error, rms", f"{np.sqrt(np.mean((errors / spread) ** 2)):.2f}"
    for key, name, scale, unit in (
        ("p95_relative", "tip force, error vector, p95", 100.0, "% of the force"),
        ("p95_magnitude", "tip force, magnitude, p95", 100.0, "%"),
        ("p95_direction_deg", "tip force, direction, p95", 1.0, "deg"),
        ("rms_n", "tip force, error vector, rms", 1.0, "N"),
    ):
        values = [scale * f["force"][key] for f in found]
        yield name, f"{np.mean(values):.3g} {unit} (worst machine {max(values):.3g})"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy simulator", description=__doc__)
    parser.add_argument("--machines", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1000, help="of the first machine")
    parser.add_argument("--machine-file", type=Path, default=ROOT / "config/excavator_20t.toml")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    work = [(options.machine_file, options.seed + k) for k in range(options.machines)]
    with ProcessPoolExecutor(2) as pool:
        found = list(pool.map(one_machine, work))
    rated = load(options.machine_file).service.machine.rated_payload
    table = Table(title=f"{options.machines} simulated machines, seeds from {options.seed} (our own simulator)")
    table.add_column("what")
    table.add_column("figure", justify="right")
    for row in table_rows(found, rated):
        table.add_row(*row)
    Console(highlight=False).print(table)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
