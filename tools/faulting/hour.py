"""An hour of work of the service as a daemon, with log and records: does its memory grow, does its log replay to the
same bytes? On the virtual clock an hour takes minutes, and nothing in it is late:

    tools/vcan -g -t virtual -w . env PYTHONPATH=src:tools python -m faulting.hour --bus socketcan:vcan0"""

import argparse
import asyncio
import json
import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from cylforce.can.clock import now_us
from cylforce.can.opening import open_bus
from cylforce.commissioning.identification import identify
from cylforce.files.logfile import LogWriter
from cylforce.files.rotation import Rotation, older
from cylforce.programs.common.play import prepare
from cylforce.programs.common.readings import header_of, make_core, model_of
from cylforce.programs.live.books import open_recorder
from cylforce.programs.replay import stream_replay
from cylforce.programs.run import Daemon
from cylforce.service.state import NOTHING_KEPT
from cylforce.settings.identified import write_identified
from cylforce.settings.machine_file import load

from .serving import Sensors, served
from .works import ROOT, simulated_case

LOG_BYTES, KEPT = 50_000_000, 1000  # of each file of the log; older ones
BEGUN = 1.0 / 6.0  # share of the time after which memory is compared: what is made once has been made


class Hour(NamedTuple):
    """Memory [MB] each minute, steps, bookings; files of the log, PDOs in it, and how many a replay tells otherwise."""

    memory: list[float]
    steps: int
    bookings: int
    files: int
    pdos: int
    different: int


def resident() -> float:
    """Memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def worked(folder: Path, bus: str, minutes: float, seed: int) -> Hour:
    """A simulated excavator digs for so long."""
    loaded, tares, log = load(ROOT / "config" / "excavator_20t.toml"), folder / "identified.toml", folder / "run.log"
    moves = np.concatenate([r.values for r in prepare(loaded, "moves", seed, 0.1, amount=120.0).records])
    write_identified(tares, identify(model_of(loaded), [moves]), loaded, [])
    recorder = open_recorder(folder / "records.db", loaded, tares)
    kept = recorder.kept if recorder else NOTHING_KEPT
    header = header_of(loaded, tares, bus, kept)
    writer = LogWriter(log, header, now_us(), bus.partition(":")[2], rotation=Rotation(LOG_BYTES, KEPT))
    sensors = Sensors(bus, loaded.service, simulated_case(seed).table)
    core, memory = make_core(loaded, tares), list[float]()
    daemon = Daemon(loaded, core, open_bus(bus), writer, kept, recorder, identified=tares)
    asyncio.run(served(daemon, sensors, 60.0 * minutes, lambda: memory.append(resident()), 60.0))
    if recorder is not None:
        recorder.close()
    booking = daemon.state.estimate.booking
    files = [*older(log).values(), log]
    again = [stream_replay(loaded, each, tares, lambda _: None) for each in files]
    played = sum(each.compared for each in again), sum(each.different for each in again)
    return Hour(memory, daemon.counts.steps, booking.number if booking else 0, len(files), *played)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy hour", description=__doc__)
    parser.add_argument("--bus", default="virtual:hour")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=7, help="which simulated machine")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    with TemporaryDirectory() as folder:
        found = worked(Path(folder), asked.bus, asked.minutes, asked.seed)
    later = found.memory[round(BEGUN * len(found.memory)) :]
    slope = float(np.polyfit(np.arange(len(later)) / 60.0, later, 1)[0])
    print("memory, MB, each minute:", " ".join(f"{x:.2f}" for x in found.memory))
    figures = {
        "memory_mb": found.memory[-1],
        "mb_per_hour": slope,
        **dict(zip(found._fields[1:], found[1:], strict=True)),
    }
    print(json.dumps(figures, indent=1))
    if asked.json:
        asked.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
