"""How soon is a weight on the page, and does a display delay the service? A process makes the service's real steps at
100 Hz and publishes another weight every half second; the display is a process of its own, as in the cab; a third one
opens pages: none, one, 1000 (of which the display serves 64), one that never reads.

A step's delay is from its tick to its end. A weight's is from its PDO to the first event on a page that shows it. Pages
run on other computers: here they give way to all else."""

import argparse
import asyncio
import json
import multiprocessing
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from cylforce.can.clock import now_us
from cylforce.can.opening import open_bus
from cylforce.can.python_can import Relay
from cylforce.files.recording import as_frames
from cylforce.files.tables import Table as Samples
from cylforce.programs.common.readings import model_of
from cylforce.service.core import Core
from cylforce.service.publication import frames
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Array, Quantity, Reason, Status
from cylforce.signals.events import Frame
from reference_machine.machine import draw

RATE, EVERY, SELDOM = 100, 50, 5  # steps a second; from one weight to the next; from one publication to the next
PRIORITY = 20  # as in systemd/README.md; without the right to it, the steps are as late as the computer is busy
PATIENCE_S, NICE = 3.0, 15  # before a refused page asks again; the pages are other computers' work
FIRST_KG = 100.0
ASK = b"GET /stream/work HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
OK = Quantity(FIRST_KG, 5.0, Status.OK, Reason.NONE)


class Way(NamedTuple):
    """How many pages read, and how many never do; whether there is a display at all."""

    name: str
    reading: int
    stuck: int = 0
    display: bool = True


WAYS = (
    Way("no display", 0, display=False),
    Way("one page", 1),
    Way("1000 pages", 1000),
    Way("one page, and one that never reads", 1, 1),
)


def service(
    machine: Path, values: Array, names: tuple[str, ...], bus_name: str, seconds: float, out: Connection
) -> None:
    """Steps as the service makes them, on samples (T, S); tells the steps' delays [s], and when a weight was sent."""
    loaded = load(machine)
    core, bus = Core(loaded.service, model_of(loaded).data_sheet), open_bus(bus_name)
    weighing, ids = WeighingService.start(core), {pdo.number: pdo.can_id for pdo in core.service.publication}
    pdos = [pdo for node in core.service.nodes for pdo in node.pdos]
    whole = list(as_frames(Samples(np.arange(len(values)) / RATE, values, names), pdos))
    rows = [whole[k : k + len(pdos)] for k in range(0, len(whole), len(pdos))]
    late, sent, begun = [], [], time.monotonic() + 0.1
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    for k in range(round(seconds * RATE)):
        due = begun + k / RATE
        time.sleep(max(0.0, due - time.monotonic()))
        t_us = now_us()
        for frame in rows[k % len(rows)]:
            weighing.on_frame(Frame(t_us, frame.can_id, frame.data))
        estimate = weighing.on_tick(t_us)
        late.append(time.monotonic() - due)
        if k % SELDOM:
            continue
        for frame in rows[k % len(rows)]:
            bus.send(frame.can_id, frame.data)
        shown = replace(OK, value=FIRST_KG + k // EVERY)
        if k % EVERY == 0:
            sent.append(time.monotonic())
        for number, data in frames(core.service.publication, replace(estimate, gross=shown, net=shown)):
            bus.send(ids[number], data)
    bus.close()
    out.send((late, sent))


def relay(out: Connection) -> None:
    """The bus between the processes, until the pipe is closed."""
    with Relay() as made:
        out.send(made.name)
        out.poll(None)


async def page(port: int, seen: dict[float, float] | None) -> None:
    """A page: when each weight came, or (None) only reading. One that is refused tries again, as a browser does."""
    while True:
        try:
            reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1 << 20)
            writer.write(ASK)
            while seen is None and await reader.read(1 << 20):
                pass
            while line := await reader.readline():
                if line.startswith(b"data: ") and seen is not None:
                    seen.setdefault(json.loads(line[6:])["weight"]["net"] or 0.0, time.monotonic())
            writer.close()
        except OSError:
            pass
        await asyncio.sleep(PATIENCE_S)


def never_reads(port: int) -> socket.socket:
    """A client that asks and then does nothing."""
    client = socket.create_connection(("127.0.0.1", port))
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    client.sendall(ASK)
    return client


async def pages(port: int, way: Way, seconds: float) -> dict[float, float]:
    """The first of these pages' arrivals, by weight."""
    seen: dict[float, float] = {}
    stuck = [never_reads(port) for _ in range(way.stuck)]
    tasks = [asyncio.create_task(page(port, seen))]
    await asyncio.sleep(1.0)
    tasks += [asyncio.create_task(page(port, None)) for _ in range(way.reading - 1)]
    await asyncio.sleep(seconds)
    for task in tasks:
        task.cancel()
    for client in stuck:
        client.close()
    return seen


def visitors(port: int, way: Way, seconds: float, out: Connection) -> None:
    """The pages' process."""
    os.nice(NICE)
    out.send(asyncio.run(pages(port, way, seconds)) if port else {})


@contextmanager
def bus_of(context: Any) -> Iterator[str]:  # noqa: ANN401 - multiprocessing's contexts have no common type
    """A relay in a process of its own; its name."""
    here, there = context.Pipe()
    process = context.Process(target=relay, args=(there,))
    process.start()
    there.close()
    yield here.recv()
    here.close()
    process.terminate()
    process.join()


@contextmanager
def display_of(machine: Path, bus: str, way: Way) -> Iterator[int]:
    """The display as a process; its port (0: there is none)."""
    if not way.display:
        yield 0
        return
    words = (sys.executable, "-m", "cylforce", "display", machine, "--bus", bus, "--listen", "127.0.0.1:0")
    with subprocess.Popen([*map(str, words)], stdout=subprocess.PIPE, text=True) as process:
        line = process.stdout.readline() if process.stdout else ""
        yield int(line.rstrip("/\n").rpartition(":")[2])
        process.terminate()


def trial(machine: Path, values: Array, names: tuple[str, ...], way: Way, seconds: float) -> dict[str, float]:
    """Delays of the steps and of the weights, one way [ms]."""
    context = multiprocessing.get_context("spawn")
    (here, there), (heard, told) = context.Pipe(), context.Pipe()
    with bus_of(context) as bus, display_of(machine, bus, way) as port:
        steps = context.Process(target=service, args=(machine, values, names, bus, seconds, there))
        opened = context.Process(target=visitors, args=(port, way, seconds + 3.0, told))
        opened.start()
        steps.start()
        late, sent = here.recv()
        steps.join()
        seen = heard.recv()
        opened.join()
    delays = [seen[FIRST_KG + k] - t for k, t in enumerate(sent) if FIRST_KG + k in seen]
    return _figures(1e3 * np.array(late[RATE:]), 1e3 * np.array(delays or [np.nan]), len(delays), len(sent))


def _figures(late: Array, delays: Array, came: int, sent: int) -> dict[str, float]:
    return {
        "steps": len(late),
        "step_median_ms": float(np.median(late)),
        "step_p999_ms": float(np.percentile(late, 99.9)),
        "steps_above_10_ms": int(np.sum(late > 1e3 / RATE)),
        "weights": came,
        "weights_sent": sent,
        "weight_median_ms": float(np.median(delays)),
        "weight_largest_ms": float(np.max(delays)),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy display", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="each way")
    parser.add_argument("--rounds", type=int, default=1, help="all ways in turn, so often")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    table = Table(title="the display beside the service")
    found: list[dict[str, Any]] = []
    with TemporaryDirectory() as folder:
        made = draw(300).run("cycles", seed=1, payloads_kg=(900.0, 600.0))
        machine = made.write(folder).parent / "machine.toml"
        for way in WAYS * options.rounds:
            found.append({"way": way.name, **trial(machine, made.values, made.signals, way, options.seconds)})
            print(found[-1], flush=True)
    for name in found[0]:
        table.add_column(name.replace("_", " "), justify="right")
    for line in found:
        table.add_row(*(x if isinstance(x, str) else f"{x:.1f}".removesuffix(".0") for x in line.values()))
    Console(highlight=False, width=160).print(table)
    if options.json:
        options.json.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
