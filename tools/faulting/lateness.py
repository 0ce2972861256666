"""How late are the service's steps, and the PDOs that they send, beside a program in C that only sleeps until deadlines
as far apart? Once undisturbed, then while nobody reads the messages, the log's disk is full, a reader of the bus has
stopped, others fill the bus with 4504 frames a second. The last two need a bus that other processes see:

    tools/vcan -g -t real env PYTHONPATH=src:tools python -m faulting.lateness --bus socketcan:vcan0 --seconds 60"""

import argparse
import asyncio
import json
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from struct import Struct
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import structlog
from rich.console import Console
from rich.table import Table

from cylforce.can.clock import now_us
from cylforce.can.opening import open_bus
from cylforce.files.logfile import LogWriter
from cylforce.programs.common.readings import header_of
from cylforce.programs.live.messages import configure_messages
from cylforce.programs.run import Daemon
from cylforce.service.memory import NOTHING_KEPT
from cylforce.signals.estimate import Status

from .serving import Sensors, served
from .works import Case, simulated_case

FLOOD = 4504  # frames of 8 bytes a second: 500 kbit/s, full
FRAME, FOREIGN = Struct("=IB3x8s"), (0x123, 0x222, 0x333, 0x444, 0x555, 0x18FEEA21 | 0x80000000)
UNREAD, FULL = "nobody reads the messages", "the log's disk is full"
PROBE = r"""
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
int main(int argc, char **argv) {
  long period_ns = 1000 * atol(argv[1]), count = atol(argv[2]);
  struct timespec due, now;
  clock_gettime(CLOCK_MONOTONIC, &due);
  while (count-- > 0) {
    due.tv_nsec += period_ns;
    if (due.tv_nsec >= 1000000000) { due.tv_nsec -= 1000000000; due.tv_sec++; }
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
    clock_gettime(CLOCK_MONOTONIC, &now);
    printf("%ld\n", ((now.tv_sec - due.tv_sec) * 1000000000 + now.tv_nsec - due.tv_nsec) / 1000);
  }
}
"""


class Late(NamedTuple):
    """How late [us] each step began, its PDOs had been sent, the probe woke; share of the steps with a weight or force
    that is OK; steps that were left out."""

    begun: list[int]
    sent: list[int]
    probe: list[int]
    ok: float
    left_out: int


def flooded(channel: str, rate: float) -> None:
    """Send foreign frames on a bus for ever."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as sender:
        sender.bind((channel,))
        begun, count = time.monotonic(), 0
        while True:
            while count < (time.monotonic() - begun) * rate:
                sender.send(FRAME.pack(FOREIGN[count % len(FOREIGN)], 8, bytes(8)))
                count += 1
            time.sleep(0.005)


def stopped(channel: str) -> None:
    """Hear the bus, and stop reading."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as reader:
        reader.bind((channel,))
        os.kill(os.getpid(), signal.SIGSTOP)


@contextmanager
def beside(work: Callable[..., None], *words: object) -> Iterator[None]:
    """A process of its own meanwhile."""
    other = multiprocessing.get_context("fork").Process(target=work, args=words)
    other.start()
    time.sleep(0.5)
    try:
        yield
    finally:
        other.kill()
        other.join()


@contextmanager
def messages(*, unread: bool) -> Iterator[None]:
    """The service's messages, a line each step: thrown away, or into a pipe that nobody reads."""
    read, write = os.pipe()
    with os.fdopen(write, "w") if unread else Path(os.devnull).open("w") as stream:
        configure_messages(stream)
        try:
            yield
        finally:
            structlog.reset_defaults()
            os.close(read)


class Followed:
    """A daemon whose steps are timed."""

    def __init__(self, daemon: Daemon, period_us: int) -> None:
        self.late, self.ok = Late([], [], [], 0.0, 0), list[bool]()
        self._daemon, self._period_us, self._overruns, self._due_us = daemon, period_us, 0, 0
        self._before, self._after = daemon.before_tick, daemon.after_sync
        self._say = structlog.get_logger("cylforce")
        daemon.before_tick, daemon.after_sync = self._begins, self._sent  # type: ignore[method-assign]

    def _begins(self, t_us: int) -> None:
        overruns = self._daemon.counts.overruns
        self._due_us, self._overruns = t_us - (overruns - self._overruns) * self._period_us, overruns
        self.late.begun.append(now_us() - self._due_us)
        self._before(t_us)

    def _sent(self) -> None:
        self.late.sent.append(now_us() - self._due_us)
        estimate = self._daemon.weighing.estimate
        self.ok.append(Status.OK in (estimate.gross.status, estimate.force.x.status))
        self._say.info("step", number=self._daemon.counts.steps)
        self._after()


def measured(case: Case, bus: str, seconds: float, log: Path, probe: Path) -> Late:
    """A daemon on a bus for so long, with a log, beside the probe."""
    header, period_us = header_of(case.loaded, None, bus, NOTHING_KEPT), case.core.period_us
    sensors = Sensors(bus, case.loaded.service, case.table)
    writer = LogWriter(log, header, now_us(), bus.partition(":")[2], report=lambda _: None)
    daemon = Daemon(case.loaded, case.core, open_bus(bus), writer, NOTHING_KEPT)
    followed = Followed(daemon, period_us)
    command = (str(probe), str(period_us), str(round(1e6 * seconds / period_us)))
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as asleep:
        asyncio.run(served(daemon, sensors, seconds, lambda: None, 1.0))
        told, _ = asleep.communicate(timeout=seconds + 10.0)
    woke, ok = [int(line) for line in told.split()], float(np.mean(followed.ok))
    return followed.late._replace(probe=woke, ok=ok, left_out=daemon.counts.overruns)


def ways(bus: str) -> dict[str, Callable[[], AbstractContextManager[None]]]:
    """What others do meanwhile."""
    interface, _, channel = bus.partition(":")
    found: dict[str, Callable[[], AbstractContextManager[None]]] = {}
    found |= dict.fromkeys(("undisturbed", UNREAD, FULL), nullcontext)
    if interface == "socketcan":
        found["a reader of the bus has stopped"] = lambda: beside(stopped, channel)
        found[f"{FLOOD} foreign frames/s"] = lambda: beside(flooded, channel, FLOOD)
    return found


def figures(late: Late) -> dict[str, float]:
    """Percentiles [ms], shares."""
    found = {
        f"{name}_p{share}_ms": float(np.percentile(each, share)) / 1e3
        for name, each in (("probe", late.probe), ("begun", late.begun), ("sent", late.sent))
        for share in (50, 99)
    }
    return found | {"ok": late.ok, "steps": len(late.begun), "left_out": late.left_out}


def table(found: dict[str, dict[str, float]]) -> Table:
    """By what others do."""
    shown = Table(title="ms late: median, 99th percentile")
    for name in ("meanwhile", "probe", "step begins", "PDOs are sent", "steps", "left out", "weight or force OK"):
        shown.add_column(name, justify="left" if name == "meanwhile" else "right")
    for name, f in found.items():
        each = (f"{f[f'{what}_p50_ms']:.2f}, {f[f'{what}_p99_ms']:.2f}" for what in ("probe", "begun", "sent"))
        shown.add_row(name, *each, f"{f['steps']:.0f}", f"{f['left_out']:.0f}", f"{100.0 * f['ok']:.1f} %")
    return shown


def followed_by(case: Case, asked: argparse.Namespace, folder: Path) -> dict[str, Late]:
    """Each way, in turn: what else this computer does concerns all of them."""
    (folder / "probe.c").write_text(PROBE, encoding="utf-8")
    subprocess.run(["cc", "-O2", "-o", folder / "probe", folder / "probe.c"], check=True)
    found = {way: list[Late]() for way in ways(asked.bus)}
    for k in range(asked.rounds):
        for way, meanwhile in ways(asked.bus).items():
            log = Path("/dev/full") if way == FULL else folder / f"{k}.log"
            with meanwhile(), messages(unread=way == UNREAD):
                found[way].append(measured(case, asked.bus, asked.seconds / asked.rounds, log, folder / "probe"))
    return {way: joined(each) for way, each in found.items()}


def joined(parts: list[Late]) -> Late:
    """Parts of one measurement."""
    begun = [late for part in parts for late in part.begun]
    sent = [late for part in parts for late in part.sent]
    probe = [late for part in parts for late in part.probe]
    ok = sum(part.ok * len(part.begun) for part in parts) / len(begun)
    return Late(begun, sent, probe, ok, sum(part.left_out for part in parts))


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy lateness", description=__doc__)
    parser.add_argument("--bus", default="virtual:lateness")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each measurement")
    parser.add_argument(
        "--rounds", type=int, default=3, help="of which each measurement consists, in turn with the others"
    )
    parser.add_argument("--seed", type=int, default=7, help="which simulated machine")
    parser.add_argument("--json", type=Path)
    asked, found = parser.parse_args(), dict[str, dict[str, float]]()
    with TemporaryDirectory() as folder:
        for way, late in followed_by(simulated_case(asked.seed), asked, Path(folder)).items():
            found[way] = figures(late)
    Console().print(table(found))
    if asked.json:
        asked.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
