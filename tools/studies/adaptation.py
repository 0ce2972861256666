"""Slow adaptation in service on reference machines, which share no code with the estimator: commissioned with cold oil,
then an hour of work in which the oil warms from 10 to 60 degC; the same hour with oil that stays cold. What an empty
bucket is shown to weigh and what is booked for loads, with adaptation and without, from the same recordings.

The hour is recorded in pieces of 46 s, every 150 s: some empty motion, a cycle with a known load, one with an empty
bucket. An empty bucket weighs what is shown last between lifting off the ground and dumping."""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from cylforce.commissioning.identification import identify
from cylforce.programs.common.readings import model_of, recorded_segments
from cylforce.programs.replay import Replayed, replay_through
from cylforce.service.core import Core
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.estimate import Status
from reference_machine.machine import draw
from reference_machine.recording import Recording

COLD, WARM = 10.0, 60.0
HOURS = {"warming": (COLD, WARM), "steady": (COLD + 2.0, COLD + 2.001)}
WAYS = {"on": True, "off": False}


def one_machine(work: tuple[int, int]) -> dict[str, Any]:
    """Errors as shares of rated payload: {hour: {on, off: {empty, loads}}}."""
    seed, pieces = work
    machine, found = draw(seed, friction="foreign"), {}
    with TemporaryDirectory() as folder:
        path = machine.run("commissioning", seed=0, oil_degc=COLD).write(folder)
        loaded = load(Path(folder) / "machine.toml")
        tares = identify(model_of(loaded), recorded_segments(loaded, path)).tares
        for number, (hour, degc) in enumerate(HOURS.items(), 1):
            recording = machine.run("warm_up", seed=number, degc=degc, pieces=pieces, name=hour)
            path = recording.write(folder)
            found[hour] = {
                way: scores(loaded, replayed(Core(loaded.service._replace(adapt=on), tares), loaded, path), recording)
                for way, on in WAYS.items()
            }
    return {"seed": seed, **found}


def replayed(core: Core, loaded: Loaded, path: Path) -> Replayed:
    """The recording through the service."""
    return replay_through(core, loaded, path, lambda _: None)


def scores(loaded: Loaded, run: Replayed, truth: Recording) -> dict[str, Any]:
    """What was shown and booked, less the truth, over rated payload; NaN where nothing was."""
    cycles = _cycles(truth)
    times = np.array([e.t_us * 1e-6 for e in run.estimates])
    shown = np.array([e.gross.value if e.gross.status is Status.OK else np.nan for e in run.estimates])
    empty = [_last(shown[(times >= begin) & (times < end)]) for begin, end, kg in cycles if kg == 0.0]
    booked: dict[int, float] = {}
    for booking in run.bookings:
        begun = [k for k, (begin, _, _) in enumerate(cycles) if begin <= booking.t_us * 1e-6]
        booked[begun[-1] if begun else -1] = booking.mass
    loads = [booked.get(k, np.nan) - kg for k, (_, _, kg) in enumerate(cycles) if kg > 0.0]
    rated = loaded.service.machine.rated_payload
    return {
        "empty": (np.array(empty) / rated).tolist(),
        "loads": (np.array(loads) / rated).tolist(),
        "drift_kg": run.service.drift.mass,
    }


def _cycles(truth: Recording) -> list[tuple[float, float, float]]:
    """(bucket free from, to [s], payload [kg]) of every cycle."""
    pieces = truth.header["pieces"]
    assert isinstance(pieces, list)
    return [
        (piece["begin_s"] + cycle["free_s"][0], piece["begin_s"] + cycle["free_s"][1], cycle["payload_kg"])
        for piece in pieces
        for cycle in piece["cycles"]
    ]


def _last(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known[-1]) if known.size else float("nan")


def summary(found: list[dict[str, Any]]) -> dict[str, float]:
    """Per hour, way and what is weighed: rms and p95 of the errors [% of rated], and the share that was not weighed."""
    figures: dict[str, float] = {}
    for hour in HOURS:
        for what in ("empty", "loads"):
            for way in WAYS:
                errors = 100.0 * np.concatenate([f[hour][way][what] for f in found])
                known = np.abs(errors[np.isfinite(errors)])
                name = f"{hour}.{what}.{way}"
                figures[f"{name}.rms_percent"] = float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
                figures[f"{name}.p95_percent"] = float(np.percentile(known, 95)) if known.size else float("nan")
                figures[f"{name}.not_weighed"] = 1.0 - known.size / errors.size
    return figures


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy adaptation", description=__doc__)
    parser.add_argument("--machines", type=int, default=6)
    parser.add_argument("--seed", type=int, default=400, help="of the first machine")
    parser.add_argument("--pieces", type=int, default=24, help="of the hour, that are recorded")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    work = [(options.seed + k, options.pieces) for k in range(options.machines)]
    with ProcessPoolExecutor(options.processes) as pool:
        runs = pool.map(one_machine, work)
        found = [*track(runs, "machines", len(work), console=Console(stderr=True))]
    figures = summary(found)
    table = Table(title=f"{len(work)} reference machines, seeds from {options.seed}: weight errors, % of rated payload")
    for column in ("hour", "weighed", "adaptation", "rms", "p95", "not weighed"):
        table.add_column(column, justify="left" if column in ("hour", "weighed", "adaptation") else "right")
    for name in dict.fromkeys(key.rpartition(".")[0] for key in figures):
        rms, p95, lost = (figures[f"{name}.{what}"] for what in ("rms_percent", "p95_percent", "not_weighed"))
        table.add_row(*name.split("."), f"{rms:.2f} %", f"{p95:.2f} %", f"{100 * lost:.0f} %")
    Console(highlight=False).print(table)
    if options.json:
        options.json.write_text(json.dumps({**figures, "seed": options.seed, "runs": found}, indent=1) + "\n")


if __name__ == "__main__":
    main()
