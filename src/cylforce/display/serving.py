"""The program: one event loop with the bus, the pictures and the web server.

Nothing here can delay the service, which is another process; this one runs at a lower priority.
"""

import asyncio
import gc
import os
import signal
import socket
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import NamedTuple

import uvicorn

from cylforce.can.bus import Bus
from cylforce.can.clock import now_us
from cylforce.canopen.network import Network
from cylforce.display.app import PageSources, application
from cylforce.display.guard import LOOPBACK, Guard
from cylforce.display.listener import Listener
from cylforce.display.panel import Panel
from cylforce.display.picture import Marks, Painter
from cylforce.display.stream import Feed
from cylforce.files.atomic import Report
from cylforce.mechanics.installation import Service
from cylforce.signals.events import Frame

PERIOD_S = 0.1  # s between two pictures; chosen
NICE = 5  # niceness: the service has priority; chosen
STOP_S = 1  # s that open pages get when the program stops; chosen


class Served(NamedTuple):
    """Settings of the server and of its pages.

    service: settings of the machine's service
    records: path of the records; None: none
    host: host of its address
    port: port of its address
    names: names under which it is reached
    pin: PIN for changes; "": none
    marks: settings of the page
    language: language of browsers that accept none of ours
    unit: unit of masses
    """

    service: Service
    records: Path | None
    host: str
    port: int
    names: tuple[str, ...]
    pin: str
    marks: Marks
    language: str
    unit: str = "kg"


def is_loopback(host: str) -> bool:
    """Return whether only this computer reaches an address."""
    return host in LOOPBACK


def listen(host: str, port: int) -> socket.socket:
    """Return the socket to serve on. Raises ValueError with a sentence."""
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host, port), family=family, backlog=128)
    except OSError as error:
        raise ValueError(
            f"--listen {host}:{port}: {error.strerror or error}: choose another address or port"
        ) from error


class Display:
    """Bus, listener and panel, and the pictures made of them.

    panel: the operator's panel
    work: stream of pictures for the operator
    engineering: stream of pictures for the engineer
    """

    def __init__(self, served: Served, bus: Bus) -> None:
        self._bus = bus
        self._network = Network(bus.send)
        self._listener = Listener(served.service)
        self.panel = Panel(self._network, served.service.node_id, len(served.service.machine.rows))
        painter, loading = Painter(self._listener, served.marks), self.panel.loading
        self.work = Feed(lambda: painter.work(loading, now_us()))
        self.engineering = Feed(lambda: painter.engineering(loading, now_us()))

    def on_frame(self, frame: Frame) -> None:
        """Process a frame from the bus."""
        self._listener.on_frame(frame)
        self._network.on_frame(frame)

    async def paint(self, server: uvicorn.Server) -> None:
        """Make new pictures, until the server stops; then every page is disconnected."""
        while not server.should_exit:
            self.work.renew()
            self.engineering.renew()
            await asyncio.sleep(PERIOD_S)
        self.work.close()
        self.engineering.close()


async def serve_display(served: Served, bus: Bus, listening: socket.socket) -> None:
    """Serve until SIGTERM or SIGINT."""
    display = Display(served, bus)
    desk = PageSources(
        display.panel, served.records, display.work, display.engineering, now_us, served.language, served.unit
    )
    hosts = (*LOOPBACK, served.host, *served.names)
    guarded = Guard(application(desk), hosts, served.pin, now_us)
    config = uvicorn.Config(
        guarded,
        lifespan="off",
        log_config=None,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=STOP_S,
    )
    server = uvicorn.Server(config)
    bus.attach(asyncio.get_running_loop(), display.on_frame)
    follow = asyncio.create_task(display.panel.follow())
    paint = asyncio.create_task(display.paint(server))
    try:
        await server.serve([listening])
    finally:
        follow.cancel()
        await paint


def run_display(served: Served, bus: Bus, report: Report) -> None:
    """Serve until SIGTERM or SIGINT. Raises ValueError.

    report: called with the address
    """
    with suppress(OSError):
        os.nice(NICE)
    gc.freeze()  # the modules stay to the end; searching them for garbage then takes seconds on a slow, busy machine
    listening = listen(served.host, served.port)
    host = f"[{served.host}]" if ":" in served.host else served.host
    report(f"http://{host}:{listening.getsockname()[1]}/")
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, _stopped)
    asyncio.run(serve_display(served, bus, listening))
    bus.close()


def _stopped(number: int, frame: FrameType | None) -> None:
    """Ignore the signal: the server raises the one that ended it once more, when all is done."""
