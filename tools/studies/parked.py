"""Forty minutes parked after half a minute of motion: how far do the parameters of a recursion with forgetting drift
while there is nothing but the sensors' noise? Our recursion (forgetting only what a row shows), shown every row, and
shown those that the service lets it see (none at rest), beside exponential forgetting in UD form (Bierman 1977,
Thornton 1976) and padasip's FilterRLS: the same rows, the same memory, the same prior, in one run.

The machine is a reference machine, identified from its own commissioning moves; the parameters are those that slow
adaptation follows (friction and pressure zeros), in units of their prior standard errors."""

import argparse
import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import padasip
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from cylforce.commissioning.identification import identify
from cylforce.estimation.model import CERTAIN_SHARE, Tares
from cylforce.estimation.observation import chunks
from cylforce.estimation.recursive import forget, known, solution, update
from cylforce.estimation.residual import residual
from cylforce.programs.common.readings import model_of, recorded_segments
from cylforce.service.adaptation import EVERY, MEMORY_SECONDS, DriftConstants, DriftFilter
from cylforce.settings.machine_file import Loaded, load
from reference_machine.machine import draw

Array = NDArray[np.float64]
MOVES_S = 34.0  # the scenario moves no longer than that


class Data(NamedTuple):
    """`columns` (T, R, D) and `observed` (T, R), scaled to unit noise and unit prior; `moves` (T, R): rows that the
    service would use; `keep`: the share that a step keeps; `rate_hz` of the steps."""

    columns: Array
    observed: Array
    moves: NDArray[np.bool_]
    keep: float
    rate_hz: float


def recorded(seed: int, friction: str, minutes: float) -> Data:
    """A reference machine, commissioned, moved for half a minute, then parked."""
    machine = draw(seed, friction=friction)
    with TemporaryDirectory() as name:
        commission = machine.run("commissioning", seed=0).write(name)
        parked = machine.run("parked", seed=1, duration_s=60.0 * minutes).write(name)
        loaded = load(Path(name) / "machine.toml")
        found = identify(model_of(loaded), recorded_segments(loaded, commission))
        return rows_of(loaded, DriftConstants(found.model, found.tares), found.tares, parked)


def rows_of(loaded: Loaded, constants: DriftConstants, tares: Tares, path: Path) -> Data:
    """What adaptation would be shown, every EVERY-th step."""
    model, parts = constants.model, []
    spread = np.sqrt(np.diag(DriftFilter.start(constants).covariance))
    for piece in chunks(model, recorded_segments(loaded, path)):
        rows = model.filtered.run(model.channels.run(piece).motion)
        for k in range(model.settle_steps, len(rows.torque), EVERY):
            one = type(rows)(rows.columns[k], rows.torque[k])
            left = residual(model, tares, one, np.zeros(len(tares.row_error)))
            scale = 1.0 / tares.row_error
            parts.append(
                (
                    one.columns[..., model.changing] * spread * scale[:, None],
                    left.torque * scale,
                    model.share_at_rest(one.columns) < CERTAIN_SHARE,
                )
            )
    columns, observed, moves = (np.array(part) for part in zip(*parts, strict=True))
    rate = model.filters.rate_hz / EVERY
    return Data(columns, observed, moves, 1.0 - 1.0 / (MEMORY_SECONDS * rate), rate)


def ours(data: Data, seen: NDArray[np.bool_]) -> Array:
    """Parameters (T, D) of our recursion on the rows `seen` (T, R)."""
    size = data.columns.shape[-1]
    root, path = known(np.zeros(size), np.ones(size)), np.empty((len(data.columns), size))
    for k, (columns, observed, use) in enumerate(zip(data.columns, data.observed, seen, strict=True)):
        if use.any():
            root = update(forget(root, columns[use], data.keep), columns[use], observed[use], np.ones(use.sum()))
        path[k], _ = solution(root)
    return path


def exponential_ud(data: Data) -> Array:
    """Parameters (T, D) of exponential forgetting, P = U D U', row by row as Bierman has it."""
    size = data.columns.shape[-1]
    upper, diagonal, values = np.eye(size), np.ones(size), np.zeros(size)
    path = np.empty((len(data.columns), size))
    for k, (columns, observed) in enumerate(zip(data.columns, data.observed, strict=True)):
        diagonal = diagonal / data.keep
        for row, y in zip(columns, observed, strict=True):
            gain = _bierman(upper, diagonal, row)
            values = values + gain * (y - row @ values)
        path[k] = values
    return path


def _bierman(upper: Array, diagonal: Array, row: Array) -> Array:
    """The gain of a row of unit noise; U and D in place."""
    f = upper.T @ row
    v, gain, before = diagonal * f, np.zeros_like(f), 1.0
    for j in range(len(f)):
        after = before + f[j] * v[j]
        diagonal[j] *= before / after
        column = upper[:j, j].copy()
        upper[:j, j] -= gain[:j] * f[j] / before
        gain[:j] += column * v[j]
        gain[j], before = v[j], after
    return gain / before


def by_padasip(data: Data) -> Array:
    """Parameters (T, D) of padasip.filters.FilterRLS, which forgets at every row."""
    rows = data.columns.shape[1]
    rls = padasip.filters.FilterRLS(n=data.columns.shape[-1], mu=data.keep ** (1.0 / rows), eps=1.0, w="zeros")
    path = np.empty((len(data.columns), data.columns.shape[-1]))
    for k, (columns, observed) in enumerate(zip(data.columns, data.observed, strict=True)):
        for row, y in zip(columns, observed, strict=True):
            rls.adapt(y, row)
        path[k] = rls.w
    return path


def drift(path: Array, first: int) -> float:
    """How far (largest over time and parameters) the parameters go from where they were at step `first`."""
    far = np.max(np.abs(path[first:] - path[first]))
    return float(far) if np.isfinite(far) else float("inf")


def modelled(data: Data, seed: int) -> Data:
    """The same rows, but what is observed is computed from them with some parameters, plus unit noise."""
    rng = np.random.default_rng(seed)
    true = rng.uniform(-1.0, 1.0, data.columns.shape[-1])
    return data._replace(observed=data.columns @ true + rng.normal(size=data.observed.shape))


def figures(options: argparse.Namespace) -> dict[str, float]:
    """Drifts, `noise.*` where what is observed is the model and noise, `recorded.*` where it is the machine's torque,
    with the friction at rest that no model knows; the promised ratios."""
    data, found = recorded(options.seed, options.friction, options.minutes), {}
    first, everything = round(MOVES_S * data.rate_hz), np.ones_like(data.moves)
    for name, seen in track(
        {"noise": modelled(data, options.seed), "recorded": data}.items(), console=Console(stderr=True)
    ):
        found[f"{name}.recursion_on_every_row"] = drift(ours(seen, everything), first)
        found[f"{name}.recursion_in_service"] = drift(ours(seen, seen.moves), first)
        found[f"{name}.exponential_ud"] = drift(exponential_ud(seen), first)
        found[f"{name}.padasip"] = drift(by_padasip(seen), first)
    worst = max(found["noise.recursion_on_every_row"], found["noise.recursion_in_service"])
    return found | {
        "noise.over_exponential_ud": worst / found["noise.exponential_ud"],
        "noise.over_padasip": worst / found["noise.padasip"],
        "recorded.over_exponential_ud": found["recorded.recursion_in_service"] / found["recorded.exponential_ud"],
        "recorded.over_padasip": found["recorded.recursion_in_service"] / found["recorded.padasip"],
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy parked", description=__doc__)
    parser.add_argument("--minutes", type=float, default=40.0)
    parser.add_argument("--friction", choices=("own", "foreign"), default="foreign")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found = figures(options)
    table = Table(title=f"{options.minutes:g} minutes parked, seed {options.seed}: drifts")
    table.add_column("what")
    table.add_column("figure", justify="right")
    for name, value in found.items():
        table.add_row(name, f"{value:.4g}")
    Console(highlight=False).print(table)
    if options.json:
        options.json.write_text(json.dumps({**found, "seed": options.seed}, indent=1) + "\n")


if __name__ == "__main__":
    main()
