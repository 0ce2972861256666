"""Do 95 % confidence intervals contain the truth? Excavators of our own simulator, each identified from five minutes of
empty moves, where the model family is right: Coulomb and viscous friction, exact geometry. The sensors' noise,
resolution and lags (drawn anew for each machine) are in the recordings and must be carried by the intervals; tolerances
of pins and bores are not.

Beside them the intervals of the textbook formula for white noise, from the same fit: no correction for noise in the
columns, for correlated residuals or for few blocks. Only identified parameters count: the others keep the data sheet's
value and tolerance."""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy import stats

from cylforce.commissioning.explained import row_noise
from cylforce.commissioning.identification import identify
from cylforce.effects.loads.slew import slew_parameters
from cylforce.estimation.blocks import chosen, stacked_triangle
from cylforce.estimation.model import Model
from cylforce.estimation.observation import observed_factors
from cylforce.mechanics.machine import base_parameters
from cylforce.settings.machine_file import load
from cylforce.signals.kinds import Kind
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import Sensors, run, sensors
from cylforce.simulation.simulator import Truth, draw_truth

ROOT = Path(__file__).resolve().parents[2]
LAWS = ("coulomb", "viscous", "delay")
PRESSURES = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE)
LAGS = {True: (0.0015, 0.006), False: (0.003, 0.010)}  # s: of pressures, of angles
GROUPS = {"J": "inertia J", "X": "first moments X, Z", "Z": "first moments X, Z", "coulomb": "Coulomb friction"}
GROUPS |= {"viscous": "viscous friction", "delay": "delay"}
NORMAL = float(stats.norm.ppf(0.975))
WANTED = (0.90, 0.98)

Array = NDArray[np.float64]


def one_machine(work: tuple[Path, int, float]) -> list[dict[str, Any]]:
    """Of every identified parameter: its error in standard errors, ours and the white-noise formula's."""
    config, seed, seconds = work
    service = load(config).service
    machine, model = service.machine, Model(service.machine, service.filters, LAWS)
    truth = draw_truth(machine, np.random.default_rng((seed, 0)), 0.1)
    truth = truth._replace(friction=truth.friction[:2])  # Coulomb and viscous, no Stribeck
    made, delay = with_lags(model, sensors(machine, service.nodes), np.random.default_rng((seed, 4)))
    scene, rng = moves(machine, np.random.default_rng((seed, 1)), seconds), np.random.default_rng((seed, 2))
    values = np.concatenate([r.values for r in run(machine, truth, made, [scene], dt=model.channels.dt, rng=rng)])
    found, true = identify(model, [values]), true_parameters(model, truth, delay)
    simple, white = white_noise_formula(found.model, values)
    error = np.sqrt(np.diag(found.tares.covariance))
    identified = [(k, name) for k, name in enumerate(found.tares.names) if name not in found.not_identified]
    return [
        {
            "machine": seed,
            "parameter": name,
            "z": float((found.tares.values[k] - true[name]) / error[k]),
            "z_white": float((simple[k] - true[name]) / white[k]),
            "relative_error": float(error[k] / abs(true[name])),
        }
        for k, name in identified
    ]


def with_lags(model: Model, made: Sensors, rng: np.random.Generator) -> tuple[Sensors, float]:
    """Sensors of one make each: a lag of all pressures, one of all angles; and by how much the angles are later [s]."""
    pressure, angle = (float(rng.uniform(*LAGS[is_pressure])) for is_pressure in (True, False))
    lag = [pressure if s.kind in PRESSURES else angle for s in model.machine.signals]
    return made._replace(lag=np.array(lag)), angle - pressure


def true_parameters(model: Model, truth: Truth, delay: float) -> dict[str, float]:
    """By name."""
    machine, links = model.machine, [link.name for link in model.machine.links]
    true = {f"{c.name}.delay": delay for c in machine.cylinders}
    for name, base, slew in zip(
        links, base_parameters(truth.links).reshape(-1, 3), slew_parameters(truth.links), strict=True
    ):
        true |= dict(
            zip((f"{name}.{symbol}" for symbol in ("J", "X", "Z", "D_excess", "E")), (*base, *slew), strict=True)
        )
    for cause in truth.friction:
        true |= {f"{c.name}.{cause.name}": float(v) for c, v in zip(machine.cylinders, cause.value, strict=True)}
    return true


def white_noise_formula(model: Model, values: Array) -> tuple[Array, Array]:
    """Least squares with the data sheet as prior, s^2 (A'A)^-1: values and standard errors (P,)."""
    blocks = chosen(observed_factors(model, [values]), list(range(len(model.parameters))))
    triangle = stacked_triangle(blocks, 1.0 / row_noise(blocks, model.prior) * np.ones_like(blocks.samples))
    spread = np.sqrt(np.diag(model.prior.covariance))
    columns, right = triangle[:, :-1] * spread, triangle[:, -1]
    prior = np.linalg.inv(model.prior.covariance / np.outer(spread, spread))
    covariance = np.linalg.inv(columns.T @ columns + prior)
    found = covariance @ (columns.T @ right + prior @ (model.prior.mean / spread))
    return found * spread, np.sqrt(np.diag(covariance)) * spread


def covered(z: Array) -> dict[str, float]:
    """Share of intervals that contain the truth, with its own exact 95 % bounds (Clopper and Pearson)."""
    hits, size = int(np.count_nonzero(np.abs(z) < NORMAL)), len(z)
    low = float(stats.beta.ppf(0.025, hits, size - hits + 1)) if hits else 0.0
    high = float(stats.beta.ppf(0.975, hits + 1, size - hits)) if hits < size else 1.0
    return {
        "intervals": size,
        "coverage": hits / size,
        "low": low,
        "high": high,
        "z_rms": float(np.sqrt(np.mean(z**2))),
    }


def summary(found: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Coverage by group of parameters, over all, and over all by the white-noise formula."""
    groups = np.array([GROUPS[f["parameter"].split(".")[1]] for f in found])
    z, white = (np.array([f[key] for f in found]) for key in ("z", "z_white"))
    by_group = {group: covered(z[groups == group]) for group in dict.fromkeys(groups)}
    return by_group | {"all": covered(z), "all, white-noise formula": covered(white)}


def main() -> int:
    """Measure and print; 1 when the coverage is not what was promised."""
    parser = argparse.ArgumentParser(
        prog="accuracy coverage", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--machines", type=int, default=40)
    parser.add_argument("--seed", type=int, default=5000, help="of the first machine")
    parser.add_argument("--seconds", type=float, default=300.0, help="of empty moves")
    parser.add_argument("--machine-file", type=Path, default=ROOT / "config/excavator_20t.toml")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    work = [(options.machine_file, options.seed + k, options.seconds) for k in range(options.machines)]
    with ProcessPoolExecutor(2) as pool:
        found = [each for machine in pool.map(one_machine, work) for each in machine]
    figures = summary(found)
    table = Table(
        title=f"95 % intervals of {options.machines} machines, {options.seconds:.0f} s, seeds from {options.seed}"
    )
    for column in ("parameters", "intervals", "contain the truth", "bounds", "rms of z"):
        table.add_column(column, justify="left" if column == "parameters" else "right")
    for name, c in figures.items():
        bounds = f"{100 * c['low']:.1f} to {100 * c['high']:.1f} %"
        table.add_row(name, str(c["intervals"]), f"{100 * c['coverage']:.1f} %", bounds, f"{c['z_rms']:.2f}")
    Console(highlight=False).print(table)
    if options.json:
        options.json.write_text(
            json.dumps({"coverage": figures, "seed": options.seed, "intervals": found}, indent=1) + "\n"
        )
    return 0 if WANTED[0] <= figures["all"]["coverage"] <= WANTED[1] else 1


if __name__ == "__main__":
    raise SystemExit(main())
