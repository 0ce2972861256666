"""An hour of recording, at 100 Hz, by least squares: our chunked triangular factors against `numpy.linalg.lstsq` on the
materialised matrix (peak memory, time, the answer) and against normal equations where the columns are nearly collinear.

The columns come minute by minute, the same for both, and are made outside the measured time: three measured rows a
sample, as many columns as the 20 t excavator's model has. Each peak is of a process of its own, less what interpreter
and libraries take; times are CPU seconds of one thread, medians of alternating runs."""

import argparse
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from time import process_time

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.batch import best
from cylforce.estimation.blocks import Factors, factors, joined
from cylforce.estimation.model import FRICTION, Model
from cylforce.estimation.observation import BLOCK_SECONDS, MOST_BLOCKS
from cylforce.settings.machine_file import load

ROOT = Path(__file__).resolve().parents[2]
Array = NDArray[np.float64]
RATE, MINUTE, MEASURED = 100, 6000, 3
NOISE = 0.1
RUNS = 5


def columns_of_the_model() -> int:
    """How many parameters the excavator's model has."""
    service = load(ROOT / "config" / "excavator_20t.toml").service
    return len(Model(service.machine, service.filters, FRICTION).parameters)


class Problem:
    """`minutes` of rows of `size` columns with this condition number and normal noise of this size."""

    def __init__(self, size: int, minutes: int, seed: int, condition: float, noise: float) -> None:
        rng = np.random.default_rng((seed, 0))
        turn, _ = np.linalg.qr(rng.normal(size=(size, size)))
        self.mixing = np.linalg.qr(rng.normal(size=(size, size)))[0] * np.geomspace(1.0, 1.0 / condition, size) @ turn
        self.true = rng.normal(size=size)
        self.minutes, self.seed, self.noise = minutes, seed, noise

    def minute(self, k: int) -> tuple[Array, Array]:
        """Columns (T, R, K) and observed (T, R)."""
        rng = np.random.default_rng((self.seed, 1, k))
        columns = rng.normal(size=(MINUTE, MEASURED, self.true.size)) @ self.mixing
        return columns, columns @ self.true + self.noise * rng.normal(size=(MINUTE, MEASURED))

    def matrix(self) -> tuple[Array, Array]:
        """All rows (T R, K) and what was observed (T R,)."""
        rows, size = self.minutes * MINUTE * MEASURED, self.true.size
        matrix, right = np.empty((rows, size)), np.empty(rows)
        for k in range(self.minutes):
            part = slice(k * MINUTE * MEASURED, (k + 1) * MINUTE * MEASURED)
            columns, observed = self.minute(k)
            matrix[part], right[part] = columns.reshape(-1, size), observed.reshape(-1)
        return matrix, right


def by_factors(problem: Problem) -> tuple[Array, float]:
    """(values, CPU seconds) by the product's own way: blocks of two seconds, merged, then solved."""
    spent = 0.0

    def parts() -> Iterator[Factors]:
        nonlocal spent
        for k in range(problem.minutes):
            columns, observed = problem.minute(k)
            begin = process_time()
            yield factors(columns, observed, np.zeros((MINUTE, 1)), int(BLOCK_SECONDS * RATE))
            spent += process_time() - begin  # the joining of this part included

    blocks = joined(parts(), MOST_BLOCKS)
    begin = process_time()
    values, _ = best(blocks, np.ones_like(blocks.samples), None)
    return values, spent + process_time() - begin


def by_lstsq(problem: Problem) -> tuple[Array, float]:
    """(values, CPU seconds) of lstsq on the whole matrix."""
    matrix, right = problem.matrix()
    begin = process_time()
    values = np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0], dtype=np.float64)
    return values, process_time() - begin


def by_normal_equations(problem: Problem) -> Array:
    """The textbook: (A'A) x = A'b."""
    size = problem.true.size
    gram, pull = np.zeros((size, size)), np.zeros(size)
    for k in range(problem.minutes):
        columns, observed = problem.minute(k)
        rows = columns.reshape(-1, size)
        gram, pull = gram + rows.T @ rows, pull + rows.T @ observed.reshape(-1)
    return np.asarray(np.linalg.solve(gram, pull), dtype=np.float64)


def peak_mb() -> float:
    """The process's greatest resident memory so far [MB]; ru_maxrss would begin with the parent's."""
    (line,) = [x for x in Path("/proc/self/status").read_text().splitlines() if x.startswith("VmHWM")]
    return int(line.split()[1]) / 1024.0


def peak_of(way: str, options: argparse.Namespace) -> float:
    """Peak memory [MB] of one way in a process of its own, less what it takes before it begins."""
    command = [sys.executable, "-m", "studies.leastsquares", "--peak-of", way, "--minutes", str(options.minutes)]
    return float(subprocess.check_output([*command, "--seed", str(options.seed)]))


def error(values: Array, true: Array) -> float:
    """Relative."""
    return float(np.linalg.norm(values - true) / np.linalg.norm(true))


def figures(options: argparse.Namespace) -> dict[str, float]:
    """All that is measured."""
    size = columns_of_the_model()
    typical = Problem(size, options.minutes, options.seed, 1e3, NOISE)
    peaks = [peak_of(way, options) for way in ("factors", "lstsq")]
    found = [(by_factors(typical), by_lstsq(typical)) for _ in range(RUNS)]
    times = np.median([[ours[1], theirs[1]] for ours, theirs in found], axis=0)
    hard = Problem(size, options.minutes, options.seed, 1e8, 0.0)
    ours, normal = error(by_factors(hard)[0], hard.true), error(by_normal_equations(hard), hard.true)
    return {
        "columns": float(size),
        "rows": float(options.minutes * MINUTE * MEASURED),
        "factors_peak_mb": peaks[0],
        "lstsq_peak_mb": peaks[1],
        "memory_ratio": peaks[0] / peaks[1],
        "factors_seconds": float(times[0]),
        "lstsq_seconds": float(times[1]),
        "time_ratio": float(times[0] / times[1]),
        "relative_difference": error(found[0][0][0], found[0][1][0]),
        "factors_error_at_1e8": ours,
        "normal_equations_error_at_1e8": normal,
        "accuracy_gain_at_1e8": normal / ours,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy leastsquares", description=__doc__)
    parser.add_argument("--minutes", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--peak-of", choices=("factors", "lstsq"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.peak_of:
        problem = Problem(columns_of_the_model(), options.minutes, options.seed, 1e3, NOISE)
        before = peak_mb()
        (by_factors if options.peak_of == "factors" else by_lstsq)(problem)
        print(peak_mb() - before)
        return
    from rich.console import Console
    from rich.table import Table

    found = figures(options)
    table = Table(title=f"{options.minutes} minutes at {RATE} Hz, seed {options.seed}")
    table.add_column("what")
    table.add_column("figure", justify="right")
    for name, value in found.items():
        table.add_row(name, f"{value:.4g}")
    Console(highlight=False).print(table)
    if options.json:
        options.json.write_text(json.dumps({**found, "seed": options.seed}, indent=1) + "\n")


if __name__ == "__main__":
    main()
