"""An hour of work of the service as a daemon, with log and records: does its memory grow, does its log replay to the
same bytes? On a clock and a bus of its own, in this process: an hour takes minutes, and nothing in it is late."""

import argparse
import asyncio
import json
import os
import sys
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple
from unittest.mock import patch

import numpy as np

from cylforce.can.bus import Bus
from cylforce.commissioning.identification import identify
from cylforce.files.logfile import LogWriter
from cylforce.files.recording import as_frames
from cylforce.files.rotation import Rotation, earlier_files
from cylforce.files.tables import Table
from cylforce.programs.common.play import prepare
from cylforce.programs.common.readings import header_of, make_core, model_of
from cylforce.programs.live import station
from cylforce.programs.live.books import open_recorder
from cylforce.programs.replay import stream_replay
from cylforce.programs.run import Daemon
from cylforce.service.memory import NOTHING_KEPT
from cylforce.settings.identified import write_identified
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.estimate import Array
from cylforce.signals.events import Frame

from .lateness import messages
from .works import ROOT

BEGIN_US = 1_700_000_000_000_000
PERIOD_US, LATER_US = 10_000, 1_000  # of the steps; after SYNC the sensors answer
CYCLE_S = 14.0  # a digging cycle takes at least as long
ROWS = 1_000  # of the work that are made frames at once
LOG_BYTES, KEPT = 2_000_000, 1000  # of each file of the log, so that many begin in an hour; older ones
BEGUN = 1.0 / 6.0  # share of the time after which memory is compared: what is made once has been made


class Hour(NamedTuple):
    """Memory [MB] each minute, steps, bookings; files of the log, PDOs in it, and how many a replay tells otherwise."""

    memory: list[float]
    steps: int
    bookings: int
    files: int
    pdos: int
    different: int


class Steps:
    """In place of the daemon's timer: the next step is due when the one before has ended; after `count` none is."""

    def __init__(self, count: int) -> None:
        self.count = self._left = count
        self.deadline_us, self._always = BEGIN_US, os.eventfd(1)

    def now_us(self) -> int:
        """The time."""
        return self.deadline_us

    def fileno(self) -> int:
        """Always readable."""
        return self._always

    def read(self) -> int:
        """One step more, or none."""
        if self._left == 0:
            return 0
        self._left -= 1
        self.deadline_us += PERIOD_US
        return 1

    def close(self) -> None:
        """No step is due any more."""
        os.close(self._always)


class Wires(Bus):
    """A bus on which nobody but sensors is: they answer each SYNC with the next row of frames."""

    def __init__(self, rows: Iterator[list[Frame]], steps: Steps) -> None:
        super().__init__("virtual:hour")
        self._rows, self._steps = rows, steps

    def send(self, can_id: int, data: bytes) -> bool:
        """Takes every frame."""
        if can_id == 0x80 and self._loop is not None:
            self._loop.call_soon(self._answer)
        return self._sent(can_id, data)

    def _answer(self) -> None:
        for frame in next(self._rows, []):
            self.counters.received += 1
            self._on_frame(frame._replace(t_us=self._steps.now_us() + LATER_US))

    def _open(self) -> None: ...

    def _listen(self, loop: asyncio.AbstractEventLoop) -> None: ...

    def _shut(self) -> None: ...


def rows_of(loaded: Loaded, values: Array) -> Iterator[list[Frame]]:
    """Samples (T, S) as their sensors' frames, row by row."""
    names = tuple(s.name for s in loaded.service.machine.signals)
    pdos = [pdo for node in loaded.service.nodes for pdo in node.pdos]
    for first in range(0, len(values), ROWS):
        piece = values[first : first + ROWS]
        times = 1e-6 * PERIOD_US * np.arange(len(piece), dtype=np.float64)
        for _, frames in groupby(as_frames(Table(times, piece, names), pdos), key=lambda frame: frame.t_us):
            yield list(frames)


def resident() -> float:
    """Memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def simulated(loaded: Loaded, scenario: str, seed: int, amount: float) -> Array:
    """Samples (T, S)."""
    return np.concatenate([r.values for r in prepare(loaded, scenario, seed, 0.1, amount=amount).records])


async def served(daemon: Daemon, count: int, memory: list[float]) -> None:
    """So many steps; the memory after each minute of them."""
    loop, after, done = asyncio.get_running_loop(), daemon.after_sync, asyncio.Event()

    def looked() -> None:
        after()
        if daemon.counts.steps % (60_000_000 // PERIOD_US) == 0:
            memory.append(resident())
        if daemon.counts.steps == count:
            done.set()

    daemon.after_sync = looked  # type: ignore[method-assign]
    daemon.start(loop)
    await done.wait()
    await daemon.stop(loop)


def worked(folder: Path, minutes: float, seed: int) -> Hour:
    """A simulated excavator digs for so long."""
    loaded, tares, log = load(ROOT / "config" / "excavator_20t.toml"), folder / "identified.toml", folder / "run.log"
    write_identified(tares, identify(model_of(loaded), [simulated(loaded, "moves", seed, 120.0)]), loaded, [])
    rows = rows_of(loaded, simulated(loaded, "cycles", seed, np.ceil(60.0 * minutes / CYCLE_S)))
    recorder = open_recorder(folder / "records.db", loaded, tares)
    kept = recorder.kept if recorder else NOTHING_KEPT
    writer = LogWriter(
        log, header_of(loaded, tares, "hour", kept), BEGIN_US, "hour", rotation=Rotation(LOG_BYTES, KEPT)
    )
    core, memory, steps = make_core(loaded, tares), list[float](), Steps(round(60e6 * minutes / PERIOD_US))
    with patch.multiple(station, now_us=steps.now_us, Timer=lambda _: steps), messages(unread=False):
        daemon = Daemon(loaded, core, Wires(rows, steps), writer, kept, recorder, identified=tares)
        asyncio.run(served(daemon, steps.count, memory))
    if recorder is not None:
        recorder.close()
    booking, files = daemon.weighing.estimate.booking, [*earlier_files(log).values(), log]
    again = [stream_replay(loaded, each, tares, lambda _: None) for each in files]
    played = sum(each.compared for each in again), sum(each.different for each in again)
    return Hour(memory, daemon.counts.steps, booking.number if booking else 0, len(files), *played)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy hour", description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=7, help="which simulated machine")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    with TemporaryDirectory() as folder:
        found = worked(Path(folder), asked.minutes, asked.seed)
    later = found.memory[round(BEGUN * len(found.memory)) :]
    slope = float(np.polyfit(np.arange(len(later)) / 60.0, later, 1)[0]) if len(later) > 1 else float("nan")
    print("memory, MB, each minute:", " ".join(f"{x:.2f}" for x in found.memory))
    figures = {"memory_mb": found.memory[-1], "mb_per_hour": slope}
    figures |= dict(zip(found._fields[1:], found[1:], strict=True))
    print(json.dumps(figures, indent=1))
    if asked.json:
        asked.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
