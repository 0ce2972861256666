"""`cylforce replay --bus`: a recording played onto a bus as if its sensors sent it, so that a daemon can measure."""

import asyncio
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

from cylforce.can.bus import Bus
from cylforce.can.clock import Timer, now_us
from cylforce.can.opening import open_shared_bus
from cylforce.canopen.devices import sensor_node
from cylforce.canopen.network import Network, Send
from cylforce.files.recording import Events, open_recording, sensor_frames
from cylforce.files.tables import Table
from cylforce.mechanics.installation import Service
from cylforce.settings.machine_file import Loaded
from cylforce.signals.codec import encode
from cylforce.signals.events import Frame
from cylforce.signals.identifiers import SYNC

POLL_S = 0.001


class Player(Protocol):
    """Sends a recording. It is given frames and the time until it is `done`."""

    def boot(self) -> None:
        """Begin."""
        ...

    def on_frame(self, frame: Frame) -> None:
        """Process a frame from the bus."""
        ...

    def poll(self, t_us: int) -> None:
        """Send frames whose time has come."""
        ...

    @property
    def done(self) -> bool:
        """True where nothing remains to be played."""
        ...


class TablePlayer:
    """Simulated sensors with the values of a table, commissioned like real ones.

    They play one row per SYNC, or, where no sensor uses SYNC, one per period.
    """

    def __init__(self, service: Service, table: Table, send: Send) -> None:
        self.network = Network(send)
        self._service, self._signals = service, table.signals
        self._rows: Iterator[list[float]] = iter(table.values.tolist())
        self._sensors = [(described, sensor_node(described)) for described in service.nodes]
        self._by_sync = any(pdo.synchronous for n in service.nodes for pdo in n.pdos)
        self._begun, self._due_us, self.done = False, 0, False
        for _, node in self._sensors:
            node.associate_network(self.network)
        self._store(dict.fromkeys(table.signals, np.nan))

    def boot(self) -> None:
        """Send the sensors' boot-up messages."""
        for _, node in self._sensors:
            node.boot()

    def on_frame(self, frame: Frame) -> None:
        """Process a frame; SYNC plays the next row."""
        if frame.can_id == SYNC and self._by_sync:
            self._next()
        self.network.on_frame(frame)

    def poll(self, t_us: int) -> None:
        """Send heartbeats and the PDOs of event timers."""
        if not self._by_sync and t_us >= self._due_us:
            self._due_us = t_us + round(1e6 / self._service.filters.rate_hz)
            self._next()
        self.network.poll(t_us)

    def _next(self) -> None:
        self._begun = self._begun or all(node.operational for _, node in self._sensors)
        if not self._begun:
            return
        row = next(self._rows, None)
        if row is None:
            self.done = True
        else:
            self._store(dict(zip(self._signals, row, strict=True)))

    def _store(self, values: dict[str, float]) -> None:
        for described, node in self._sensors:
            for pdo in described.pdos:
                node.store(pdo.number, encode(pdo, values))


class LogPlayer:
    """The frames of a log's sensors, at the log's own pace."""

    def __init__(self, service: Service, recording: Events, send: Send) -> None:
        self._frames = sensor_frames(recording, service)
        self._send = send
        self._next = next(self._frames, None)
        self._shift: int | None = None

    @property
    def done(self) -> bool:
        """True where nothing remains to be played."""
        return self._next is None

    def boot(self) -> None:
        """Send nothing: the log has its own first frame."""

    def on_frame(self, frame: Frame) -> None:
        """Ignore a frame from the bus."""

    def poll(self, t_us: int) -> None:
        """Send frames whose time has come."""
        if self._next is not None and self._shift is None:
            self._shift = t_us - self._next.t_us
        while self._next is not None and self._next.t_us + (self._shift or 0) <= t_us:
            self._send(self._next.can_id, self._next.data)
            self._next = next(self._frames, None)


def play(loaded: Loaded, recording: Path, bus: str) -> None:
    """Play until the recording ends, or SIGTERM or SIGINT. Raises RecordingError or BusError with a sentence."""
    opened = open_shared_bus(bus)
    try:
        asyncio.run(_until_stopped(loaded, recording, opened))
    finally:
        opened.close()
    print(f"{opened.counters.sent} frames sent, {opened.counters.dropped} dropped")


async def _until_stopped(loaded: Loaded, recording: Path, bus: Bus) -> None:
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    await play_until(loaded, recording, bus, stop)


async def play_until(loaded: Loaded, recording: Path, bus: Bus, stop: asyncio.Event) -> None:
    """Play on the running loop until the recording ends or `stop` is set; the bus is open and stays open."""
    source = open_recording(recording, loaded.service, loaded.columns)
    player: Player
    if isinstance(source, Table):
        player = TablePlayer(loaded.service, source, bus.send)
    else:
        player = LogPlayer(loaded.service, source, bus.send)
    loop, timer = asyncio.get_running_loop(), Timer(POLL_S)

    def on_timer() -> None:
        if timer.read():
            player.poll(now_us())
            if player.done:
                stop.set()

    bus.attach(loop, player.on_frame)
    loop.add_reader(timer.fileno(), on_timer)
    try:
        player.boot()
        await stop.wait()
    finally:
        loop.remove_reader(timer.fileno())
        timer.close()
