"""The simulated sensors as CANopen nodes on a bus: they boot, are commissioned, and measure the simulated
machine."""

import asyncio
import signal
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path

import numpy as np

from cylforce.can.bus import Bus
from cylforce.can.clock import Timer, now_us
from cylforce.can.opening import open_shared_bus
from cylforce.canopen.devices import sensor_node
from cylforce.canopen.network import Network, Send
from cylforce.files.truth import TruthWriter, truth_columns
from cylforce.mechanics.machine import Machine
from cylforce.programs.common.play import Play
from cylforce.signals.codec import encode
from cylforce.signals.estimate import Array
from cylforce.signals.events import Frame
from cylforce.signals.identifiers import SYNC
from cylforce.simulation.sensing import Record, as_sent

STILL_S = 1.0  # at rest after the last sensor has become operational
LINGER_S = 2.0  # at rest after the run, so that the daemon ends on good samples
EVENT_POLL_S, HEARTBEAT_POLL_S = 0.001, 0.01  # resolution of event timers, which is their jitter; of all else


class MovingStage:
    """Machine at any time of the run: linear between samples, at rest before and after.

    The next scene is computed in a thread while one is played.
    """

    def __init__(self, machine: Machine, records: Iterator[Record]) -> None:
        self._machine, self._records = machine, records
        self._pool = ThreadPoolExecutor(1, "next scene")
        first = next(records)
        self.names, self._truth = truth_columns(machine, first)
        self._t, self._analog = first.t, first.analog
        self._next = self._ask()
        self.end: float | None = None

    def _ask(self) -> "Future[Record | None]":
        return self._pool.submit(next, self._records, None)

    def at(self, t: float) -> tuple[Array, Array]:
        """Return the sensors' inner values (S,) and the truth's row (K,) at `t` [s].

        Times must not go back by a scene.
        """
        while t > self._t[-1] and self.end is None:
            self._advance()
        k = min(max(int(np.searchsorted(self._t, t, side="right")) - 1, 0), len(self._t) - 2)
        share = min(max((t - self._t[k]) / (self._t[k + 1] - self._t[k]), 0.0), 1.0)
        analog, truth = (x[k] + share * (x[k + 1] - x[k]) for x in (self._analog, self._truth))
        for step in STEPS:
            truth[self.names.index(step)] = self._truth[k, self.names.index(step)]
        return analog, truth

    def close(self) -> None:
        """Compute no more scenes."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _advance(self) -> None:
        record = self._next.result()
        if record is None:
            self.end = float(self._t[-1])
            return
        rows = truth_columns(self._machine, record)[1]
        self._t = np.concatenate([self._t[-1:], record.t])
        self._analog = np.concatenate([self._analog[-1:], record.analog])
        self._truth = np.concatenate([self._truth[-1:], rows])
        self._next = self._ask()


STEPS = ("cycle", "phase")  # columns that are not interpolated


class SensorNodes:
    """Sensors of a machine file on a bus.

    They process frames and the time, and send frames by `send`. They write rows of truth: one per SYNC, or where no
    sensor uses SYNC, one per period of the service.
    """

    def __init__(self, play: Play, send: Send, truth: TruthWriter | None, stage: MovingStage) -> None:
        service = play.service
        self.network, self.stage = Network(send), stage
        self._play, self._writer = play, truth
        self._names = [s.name for s in service.machine.signals]
        self._rng = np.random.default_rng((play.seed, 4))
        self._sensors = [(described, sensor_node(described)) for described in service.nodes]
        self._by_sync = any(pdo.synchronous for n in service.nodes for pdo in n.pdos)
        self._free = any(not pdo.synchronous for n in service.nodes for pdo in n.pdos)
        self._start_us: int | None = None
        self._row_us = 0
        for _, node in self._sensors:
            node.associate_network(self.network)

    @property
    def poll_s(self) -> float:
        """Polling period [s]."""
        return EVENT_POLL_S if self._free else HEARTBEAT_POLL_S

    def boot(self) -> None:
        """Send the boot-up messages."""
        for _, node in self._sensors:
            node.boot()

    def on_frame(self, frame: Frame) -> None:
        """Process a frame from the bus; at SYNC all sensors measure before any answers."""
        if frame.can_id == SYNC:
            self._measure(frame.t_us)
            self._tell(frame.t_us, self._by_sync)
        self.network.on_frame(frame)

    def poll(self, t_us: int) -> None:
        """Send the PDOs of event timers and heartbeats whose time has come."""
        if self._free:
            self._measure(t_us)
        period_us = 1e6 / self._play.service.filters.rate_hz
        if t_us - self._row_us >= period_us:
            self._tell(t_us, not self._by_sync)
        self.network.poll(t_us)

    def done(self, t_us: int) -> bool:
        """Return whether the run has been over for LINGER_S."""
        end = self.stage.end
        return end is not None and self._seconds(t_us) > end + LINGER_S

    def _seconds(self, t_us: int) -> float:
        """Return the time of the run [s] at the time `t_us`.

        The first call with all sensors operational sets its zero to `STILL_S` later. Before that call the time is 0,
        then negative until the zero; the machine is at rest.
        """
        if self._start_us is None and all(node.operational for _, node in self._sensors):
            self._start_us = t_us + round(1e6 * STILL_S)
        return 0.0 if self._start_us is None else 1e-6 * (t_us - self._start_us)

    def _measure(self, t_us: int) -> None:
        analog, _ = self.stage.at(self._seconds(t_us))
        values = dict(zip(self._names, as_sent(self._play.made, analog, self._rng).tolist(), strict=True))
        for described, node in self._sensors:
            for pdo in described.pdos:
                node.store(pdo.number, encode(pdo, values))

    def _tell(self, t_us: int, wanted: bool) -> None:
        if wanted and self._writer is not None:
            self._row_us = t_us
            self._writer.write([t_us], self.stage.at(self._seconds(t_us))[1][None])


def play_on_bus(play: Play, bus: str, truth: Path | None) -> None:
    """Simulate the sensors on `bus` ("INTERFACE:CHANNEL") until the run is over, or SIGTERM or SIGINT. Raises
    BusError.
    """
    opened = open_shared_bus(bus)
    print(f"seed {play.seed}", flush=True)
    try:
        asyncio.run(_until_stopped(play, opened, truth))
    finally:
        opened.close()
    print(f"{opened.counters.sent} frames sent, {opened.counters.dropped} dropped")


async def _until_stopped(play: Play, bus: Bus, truth: Path | None) -> None:
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    await play_until(play, bus, truth, stop)


async def play_until(play: Play, bus: Bus, truth: Path | None, stop: asyncio.Event) -> None:
    """Simulate the sensors on the running loop until `stop` is set; the bus is open and stays open."""
    stage = MovingStage(play.service.machine, play.records)
    with TruthWriter(truth, play.header, stage.names) if truth else nullcontext() as writer:
        nodes = SensorNodes(play, bus.send, writer, stage)
        loop, timer = asyncio.get_running_loop(), Timer(nodes.poll_s)

        def on_timer() -> None:
            if timer.read():
                t_us = now_us()
                nodes.poll(t_us)
                if nodes.done(t_us):
                    stop.set()

        bus.attach(loop, nodes.on_frame)
        loop.add_reader(timer.fileno(), on_timer)
        try:
            nodes.boot()
            await stop.wait()
        finally:
            loop.remove_reader(timer.fileno())
            timer.close()
            stage.close()
