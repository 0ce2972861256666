"""Time and memory of `cylforce fleet` by number of recordings and of workers: as whole commands, imports included."""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from cylforce.programs.fleet.kept import SUFFIX, KeptResults
from cylforce.programs.fleet.task import key_of
from studies._fleets import name_of


class Timed(NamedTuple):
    """So many `recordings` by so many `workers` (0: one process, without Dask). In s: wall time of a `first` run and
    processor time of its recordings; wall and processor time of a run to which `one_new` recording is new, of which
    `alone` is that recording's own processor time. In MB: largest `memory` of a worker, `largest` process of the first
    run."""

    recordings: int
    workers: int
    first_s: float
    processor_s: float
    one_new_s: float
    one_new_processor_s: float
    alone_s: float
    memory_mb: float
    largest_mb: float


class _Run(NamedTuple):
    seconds: float
    processor: float
    largest: float
    rows: Sequence[dict[str, Any]]


def timed(folder: Path, machines: int, workers: int) -> Timed:
    """On the first of the machines in a folder."""
    with TemporaryDirectory(dir=folder.parent) as name:
        base = Path(name)
        (base / "data").mkdir()
        os.link(folder / "machine.toml", base / "data/machine.toml")
        for own in map(name_of, range(machines)):
            shutil.copytree(folder / own, base / "data" / own, copy_function=os.link)
        return timed_in(base / "data", base / "cache", workers)


def timed_in(folder: Path, cache: Path, workers: int, repeated: int = 3) -> Timed:
    """On all machines of a folder, with a cache that is empty: a first run, then others for which the last recording is
    new again, the shortest of which counts."""
    first = _run(folder, cache, workers)
    address = max(str(row["address"]) for row in first.rows)
    later = []
    for _ in range(repeated):
        _forget(folder, cache, address)
        later.append(_run(folder, cache, workers))
    one = min(later, key=lambda run: run.seconds)
    alone = next(float(row["took_s"]) for row in one.rows if row["address"] == address)
    memory = max(float(row["memory_mb"]) for row in first.rows)
    done = sum(float(row["took_s"]) for row in first.rows)
    return Timed(len(one.rows), workers, first.seconds, done, one.seconds, one.processor, alone, memory, first.largest)


def _forget(folder: Path, cache: Path, address: str) -> None:
    """Make a recording new again."""
    kept = KeptResults(cache)
    _, sha256 = kept.stamps.pop(address)
    (cache / f"{key_of(sha256, (folder / 'machine.toml').read_text())}{SUFFIX}").unlink()
    kept.remember()


def _run(folder: Path, cache: Path, workers: int) -> _Run:
    from pyarrow import parquet

    with TemporaryDirectory() as scratch:
        output = Path(scratch) / "results.parquet"
        command = [sys.executable, "-m", "cylforce", "fleet", str(folder), "-o", str(output)]
        command += ["--cache", str(cache), "--workers", str(workers)]
        begun = time.monotonic()
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as running:
            _, status, used = os.wait4(running.pid, 0)
            running.returncode = os.waitstatus_to_exitcode(status)
        if running.returncode:
            raise subprocess.CalledProcessError(running.returncode, command)
        seconds = time.monotonic() - begun
        rows = parquet.read_table(output).to_pylist()
        return _Run(seconds, used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3, rows)


def plot(times: Sequence[Timed], path: Path) -> None:
    """Time and memory over the number of recordings, a line for each number of workers."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for workers in sorted({each.workers for each in times}):
        own = [each for each in times if each.workers == workers]
        name = f"{workers} workers" if workers else "one process"
        count = [each.recordings for each in own]
        left.plot(count, [each.first_s for each in own], "o-", label=f"first run, {name}")
        left.plot(count, [each.one_new_s for each in own], "s--", label=f"one new recording, {name}")
        right.plot(count, [each.memory_mb for each in own], "o-", label=name)
    left.set(xscale="log", yscale="log", xlabel="recordings of 3 minutes", ylabel="time [s]")
    right.set(xscale="log", ylim=(0.0, 800.0), xlabel="recordings of 3 minutes", ylabel="memory of a worker [MB]")
    for axes in (left, right):
        axes.grid(visible=True, which="major", alpha=0.3)
        axes.legend(fontsize="x-small")
    figure.savefig(path, metadata={"Date": None})
