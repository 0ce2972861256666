"""Time and memory of `cylforce fleet` by number of recordings and of workers: as whole commands, imports included."""

import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from studies._fleets import name_of


class Timed(NamedTuple):
    """So many `recordings` by so many `workers` (0: one process, without Dask). In s: wall time of a `first` run and
    processor time of its recordings; wall and processor time of a run in which `one_new` recording is there, of which
    `alone` is that recording's own processor time. Largest `memory` of a worker while it worked [MB]."""

    recordings: int
    workers: int
    first_s: float
    processor_s: float
    one_new_s: float
    one_new_processor_s: float
    alone_s: float
    memory_mb: float


class _Run(NamedTuple):
    seconds: float
    processor: float
    rows: Sequence[dict[str, object]]


def timed(folder: Path, machines: int, workers: int) -> Timed:
    """On the first of the machines in a folder; their last recording is the new one."""
    with TemporaryDirectory(dir=folder.parent) as name:
        base = Path(name)
        (base / "data").mkdir()
        os.link(folder / "machine.toml", base / "data/machine.toml")
        for own in map(name_of, range(machines)):
            shutil.copytree(folder / own, base / "data" / own, copy_function=os.link)
        kept_back = max((base / "data" / name_of(machines - 1)).iterdir())
        kept_back.rename(base / kept_back.name)
        first = _run(base, workers)
        (base / kept_back.name).rename(kept_back)
        one = _run(base, workers)
    took = {str(row["address"]): float(str(row["took_s"])) for row in one.rows}
    memory = max(float(str(row["memory_mb"])) for row in first.rows)
    done = sum(float(str(row["took_s"])) for row in first.rows)
    new = next(
        seconds for address, seconds in took.items() if address.endswith(f"{name_of(machines - 1)}/{kept_back.name}")
    )
    return Timed(len(took), workers, first.seconds, done, one.seconds, one.processor, new, memory)


def _run(base: Path, workers: int) -> _Run:
    from pyarrow import parquet

    output = base / "results.parquet"
    command = [sys.executable, "-m", "cylforce", "fleet", str(base / "data"), "-o", str(output)]
    command += ["--cache", str(base / "cache"), "--workers", str(workers)]
    before, begun = _processor(), time.monotonic()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    seconds = time.monotonic() - begun
    return _Run(seconds, _processor() - before, parquet.read_table(output).to_pylist())


def _processor() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


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
