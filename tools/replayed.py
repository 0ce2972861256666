"""`tools/bench --replay`: how many times faster than real time a log of digging is replayed, and in how much memory, a
minute's and one of `--minutes`. Both are as `cylforce run` writes them: what our node sent is in them, and is compared
bit by bit. The replays are processes of their own, timed by the processor time that they took, start included."""

import contextlib
import io
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from rich.table import Table

from bench import due_at, recorded_events
from cylforce.files.candump import Sent, event_line
from cylforce.files.logfile import header_lines
from cylforce.programs.common.readings import header_of, make_core
from cylforce.programs.sim import run_sim
from cylforce.service.core import Core
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.events import Event

CYCLE_S = 15.0  # at most, of a simulated digging cycle
BUS = "can0"
# The program, and what it says of its memory: ru_maxrss would begin with that of the process which started it.
WATCHED = """
import runpy
from pathlib import Path
try:
    runpy.run_module("cylforce", run_name="__main__", alter_sys=True)
finally:
    print(next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")))
"""
PEAK = re.compile(r"VmHWM:\s+(\d+) kB")
COMPARED = re.compile(r"(\d+) frames were sent live, (\d+) differ now")


class Replay(NamedTuple):
    """Length of the log [s], processor time [s] and largest memory [bytes] of its replay, frames that were compared and
    that differ."""

    recorded_s: float
    took_s: float
    memory: int
    compared: int
    different: int

    @property
    def times(self) -> float:
        """How many times faster than real time."""
        return self.recorded_s / self.took_s


def measure(config: Path, minutes: float, rounds: int) -> list[Replay]:
    """A minute's, and one of so many minutes, the quickest of `rounds`."""
    with TemporaryDirectory() as name:
        identified, *paths = recorded(config, Path(name), 1.0, minutes)
        each = [[replayed(config, log, identified) for log in paths] for _ in range(rounds)]
        return [min(same, key=lambda one: one.took_s) for same in zip(*each, strict=True)]


def recorded(config: Path, folder: Path, *minutes: float) -> list[Path]:
    """The identified file of a simulated machine, and logs of its service of so many minutes."""
    moves, raw, identified = (folder / each for each in ("moves.log", "raw.log", "identified.toml"))
    with contextlib.redirect_stdout(io.StringIO()):
        run_sim(config, scenario="moves", seed=1, log=moves)
        run_sim(config, scenario="cycles", cycles=ceil(60.0 * max(minutes) / CYCLE_S) + 1, seed=1, log=raw)
    command = [sys.executable, "-m", "cylforce", "identify", str(config), str(moves), "-o", str(identified)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    logs = [folder / f"served_{k}.log" for k, _ in enumerate(minutes)]
    for log, length in zip(logs, minutes, strict=True):
        written(config, raw, identified, log, 60.0 * length)
    return [identified, *logs]


def written(config: Path, raw: Path, identified: Path, log: Path, seconds: float) -> None:
    """The log that the service would have written of the first seconds of the sensors' frames and its ticks."""
    loaded = load(config)
    core = make_core(loaded, identified)
    with log.open("w") as file:
        begun = None
        for event in served(core, recorded_events(loaded, raw)):
            if begun is None:
                begun = event.t_us
                file.write(header_lines(header_of(loaded, identified, BUS), begun))
            if event.t_us - begun > 1e6 * seconds:
                break
            file.write(event_line(event, BUS))


def served(core: Core, events: Iterator[Event]) -> Iterator[Event | Sent]:
    """The events, and behind each tick what our node sends."""
    weighing, due, steps = WeighingService.start(core), due_at(core), 0
    ids = {pdo.number: pdo.can_id for pdo in core.service.publication}
    for event in events:
        yield event
        estimate = weighing.on_event(event)
        if estimate is not None:
            steps += 1
            sent = core.encoders.due(estimate, due[steps % len(due)])
            yield from (Sent(event.t_us, ids[number], data) for number, data in sent)


def replayed(config: Path, log: Path, identified: Path) -> Replay:
    """One replay by the program."""
    command = [sys.executable, "-c", WATCHED, "replay", str(config), str(log), "--identified", str(identified)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as child:
        said = child.stdout.read() if child.stdout else ""
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    found, peak = COMPARED.search(said), PEAK.search(said)
    if child.returncode or found is None or peak is None:
        raise SystemExit(said)
    with log.open("rb") as file:
        first = float(file.readline()[1:18])
        file.seek(-200, os.SEEK_END)
        last = float(file.readlines()[-1][1:18])
    compared, different = map(int, found.groups())
    return Replay(last - first, used.ru_utime + used.ru_stime, 1024 * int(peak[1]), compared, different)


def table(found: list[Replay]) -> Table:
    """One replay a row."""
    text = Table(title="Replay of a log")
    for words in ("recorded, s", "processor, s", "times real time", "memory, MB", "frames compared", "different"):
        text.add_column(words, justify="right")
    for each in found:
        text.add_row(
            f"{each.recorded_s:.0f}",
            f"{each.took_s:.1f}",
            f"{each.times:.0f}",
            f"{each.memory / 1e6:.0f}",
            f"{each.compared}",
            f"{each.different}",
        )
    return text
