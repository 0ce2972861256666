"""Identification on reference machines, which share no code with the estimator: five minutes of empty motion, no
known weight, data sheets with tolerances; what is left on another recording, the scale of the payload, the standard
errors."""

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

from cylforce.commissioning.identification import Identification, identify
from cylforce.estimation.filters import fours
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.observation import observe
from cylforce.programs.common.readings import calibrated, model_of, recorded_segments
from cylforce.programs.replay import replay_through
from cylforce.service.core import Core
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.estimate import Array
from reference_machine.machine import Machine, draw
from reference_machine.recording import Recording

KNOWN_KG = 1000.0
OWN_LAWS = ("coulomb", "viscous", "load_dependent", "directional")


def one_machine(work: tuple[int, str]) -> dict[str, Any]:
    """All that is measured on one machine."""
    seed, friction = work
    machine = draw(seed, friction=friction)
    with TemporaryDirectory() as name:
        folder = Path(name)
        commission = machine.run("commissioning", seed=0).write(folder)
        held_out = machine.run("commissioning", seed=1, duration_s=120.0, name="held_out")
        work_run = machine.run("cycles", seed=2)
        lift = machine.run("known_lift", seed=3, weight_kg=KNOWN_KG).write(folder)
        loaded = load(folder / "machine.toml")
        found = identify(model_of(loaded), recorded_segments(loaded, commission))
        tested, cycles = held_out.write(folder), work_run.write(folder)
        left, floor = residuals(loaded, found.model, found.tares, tested, held_out)
        scaled = calibrated(loaded, found, lift, KNOWN_KG)
        return {
            "seed": seed,
            "friction": friction,
            "laws": found.model.friction,
            "left_nm": left.tolist(),
            "floor_nm": floor.tolist(),
            "ratio": float(np.sqrt(np.mean((left / floor) ** 2))),
            **weights(loaded, found, cycles, work_run, ""),
            **weights(loaded, scaled, cycles, work_run, "_one_lift"),
        }


def residuals(loaded: Loaded, model: Model, tares: Tares, path: Path, truth: Recording) -> tuple[Array, Array]:
    """Rms torque (R,) that the tares leave on a recording, and that the machine's TRUE base parameters and friction
    leave there (the floor): the data sheet's geometry, all sensor errors and the same filters for both."""
    (values,) = recorded_segments(loaded, path)
    seen = observe(model, values)
    true = np.array([_true_parameter(truth, p.name) for p in model.parameters])
    left = seen.torque - seen.columns @ tares.values
    floor = seen.torque - seen.columns @ true - friction_torque(loaded, model, values, truth)
    return np.sqrt(np.nanmean(left**2, axis=0)), np.sqrt(np.nanmean(floor**2, axis=0))


def friction_torque(loaded: Loaded, model: Model, values: Array, truth: Recording) -> Array:
    """The true friction's torque (T, R) through the levers and filters of the estimator."""
    machine = loaded.service.machine
    channels = model.channels.read(values)
    n = machine.size
    force = np.stack([_friction_force(truth, c.name) for c in machine.cylinders], axis=1)
    channels[:, n : n + len(machine.cylinders)] = force[: len(channels)]
    moved = model.channels.between(fours(model.channels.smoothed(channels)))
    return model.filtered.run(moved.motion).torque[model.settle_steps :]


def _friction_force(truth: Recording, name: str) -> Array:
    """Friction of the cylinder and of the pin that it drives, as a force (T,) of the cylinder [N]."""
    return truth.truth[f"friction.{name}"] + truth.truth[f"pin_torque.{name}"] / truth.truth[f"lever.{name}"]


def _true_parameter(truth: Recording, name: str) -> float:
    link, _, symbol = name.partition(".")
    base = truth.header["base_parameters"]
    assert isinstance(base, dict)
    if symbol == "D_excess":
        return float(base[f"{link}.D"] - base[f"{link}.J"])
    return float(base.get(name, 0.0))


def weights(loaded: Loaded, found: Identification, path: Path, truth: Recording, suffix: str) -> dict[str, Any]:
    """Booked against true loads: the scale's error and each load's as a share of the rated payload.

    The scale is the slope through the origin: an empty bucket reads zero (that is what the tares are for), so a line
    with a free intercept would hide in that intercept what the heavier loads are wrong by. Its error times the rated
    payload is what a rated load is wrong by on average."""
    tares = found.tares._replace(common_error=0.0)  # the pressures of these machines have the right scale
    booked = replay_through(Core(loaded.service, tares), loaded, path, lambda _: None).bookings
    pieces = truth.header["pieces"]
    assert isinstance(pieces, list)
    cycles = [cycle for piece in pieces for cycle in piece["cycles"]]
    begin = [1e6 * cycle["free_s"][0] for cycle in cycles]
    pairs = []
    for booking in booked:
        before = [k for k, t in enumerate(begin) if t <= booking.t_us]
        if before:
            pairs.append((cycles[before[-1]]["payload_kg"], booking.mass, booking.standard_error))
    true, mass, error = np.array(pairs).T
    rated = loaded.service.machine.rated_payload
    return {
        f"scale_error{suffix}": float(abs(true @ mass / (true @ true) - 1.0)),
        f"errors{suffix}": ((mass - true) / rated).tolist(),
        f"z{suffix}": ((mass - true) / error).tolist(),
        f"booked{suffix}": [len(pairs), len(cycles)],
    }


def covered(seed: int) -> list[bool]:
    """Whether each parameter's 95 % interval contains the truth, where the model family is right: exact geometry,
    massless linkages, friction of our own laws, and of the sensors' errors those that are no bias (noise, resolution,
    jitter). The intervals are the fit's own: what the tares add for friction under loads that the empty machine never
    reaches is for a family that is wrong."""
    parts = ("noise", "quantisation", "jitter")
    machine: Machine = draw(seed, friction="own", sensors=parts, geometry=False, linkage_masses=False)
    with TemporaryDirectory() as name:
        recording = machine.run("commissioning", seed=0)
        path = recording.write(name)
        loaded = load(Path(name) / "machine.toml")
        model = Model(loaded.service.machine, loaded.service.filters, OWN_LAWS[:3])
        found = identify(model, recorded_segments(loaded, path))
    true = {p.name: _true_parameter(recording, p.name) for p in found.model.parameters} | _true_friction(recording)
    error = np.sqrt(np.diag(found.fit.covariance))
    identified = [k for k, p in enumerate(found.model.parameters) if p.name not in found.not_identified]
    names = [found.model.parameters[k].name for k in identified]
    return [
        abs(found.tares.values[k] - true[name]) < 1.96 * error[k] for k, name in zip(identified, names, strict=True)
    ]


def _true_friction(recording: Recording) -> dict[str, float]:
    laws = recording.header["friction"]
    assert isinstance(laws, dict)
    found = {}
    for name, law in laws.items():
        found[f"{name}.coulomb"] = (law["coulomb_extend"] + law["coulomb_retract"]) / 2.0
        found[f"{name}.viscous"] = law["viscous"]
        found[f"{name}.load_dependent"] = law["load"]
    return found


def summary(found: list[dict[str, Any]], inside: list[bool]) -> dict[str, float]:
    """The keys that are promised, and some beside."""

    def p95(key: str, friction: str | None = None) -> float:
        return float(np.percentile([f[key] for f in found if friction in (None, f["friction"])], 95))

    loads = np.abs(np.concatenate([f["errors"] for f in found]))
    lifted = np.abs(np.concatenate([f["errors_one_lift"] for f in found]))
    return {
        "residual_over_floor_own_p95": p95("ratio", "own"),
        "residual_over_floor_foreign_p95": p95("ratio", "foreign"),
        "scale_error_p95": p95("scale_error"),
        "scale_error_one_lift_p95": p95("scale_error_one_lift"),
        "load_error_p95": float(np.percentile(loads, 95)),
        "load_error_one_lift_p95": float(np.percentile(lifted, 95)),
        "error_over_standard_error_rms": float(np.sqrt(np.mean(np.concatenate([f["z"] for f in found]) ** 2))),
        "booked": sum(f["booked"][0] for f in found) / sum(f["booked"][1] for f in found),
        "coverage": float(np.mean(inside)) if inside else float("nan"),
        "intervals": len(inside),
        "machines": len(found),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy identification", description=__doc__)
    parser.add_argument("--machines", type=int, default=30, help="half own friction laws, half foreign")
    parser.add_argument("--seed", type=int, default=100, help="of the first machine")
    parser.add_argument("--coverage", type=int, help="machines whose intervals are counted; default: half of them")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    half, screen = (options.machines + 1) // 2, Console(stderr=True)
    counted = half if options.coverage is None else options.coverage
    seeds, others = (range(options.seed, options.seed + size) for size in (half, counted))
    work = [(seed, friction) for seed in seeds for friction in ("own", "foreign")][: options.machines]
    with ProcessPoolExecutor(2) as pool:
        runs = pool.map(one_machine, work)
        found = [*track(runs, "machines", len(work), console=screen)]
        inside = [hit for hits in track(pool.map(covered, others), "coverage", counted, console=screen) for hit in hits]
    figures = summary(found, inside)
    table = Table(title=f"{len(work)} reference machines, seeds from {options.seed}")
    table.add_column("what")
    table.add_column("figure", justify="right")
    for name, value in figures.items():
        table.add_row(name, f"{value:.4g}")
    Console(highlight=False).print(table)
    if options.json:
        options.json.write_text(json.dumps({**figures, "seed": options.seed, "runs": found}, indent=1) + "\n")


if __name__ == "__main__":
    main()
