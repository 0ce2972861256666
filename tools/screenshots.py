"""Pictures of the page in the cab for its chapter: by day, by night, on a phone, the engineering page. A simulated
machine digs, the service's own steps and the display's own pictures are made of it, and Chromium gets the moment to be
shown."""

import argparse
import shutil
import socket
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import uvicorn
from playwright.sync_api import Browser, sync_playwright

from cylforce.commissioning.identification import identify
from cylforce.display.app import PageSources, application
from cylforce.display.listener import Listener
from cylforce.display.panel import Loading, TruckState
from cylforce.display.picture import Marks, Painter, Picture
from cylforce.display.stream import Feed
from cylforce.estimation.segments import gapless
from cylforce.files.shipped import shipped
from cylforce.programs.common.play import Play, prepare
from cylforce.programs.common.readings import model_of
from cylforce.service.assembler import assembler
from cylforce.service.core import Core
from cylforce.service.publication import frames
from cylforce.service.samples import samples
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.estimate import Status
from cylforce.signals.events import Event, Frame
from cylforce.simulation.sensor_bus import bus_events

START_US = 1_772_000_000_000_000
MOVES_S, CYCLES = 120.0, 7
TARGET_KG, BUCKETS = 6000.0, 4  # of the truck; buckets in it by day
HEARTBEAT_US = 500_000
HELD_S = 0.3  # for which the moment has lasted: then the display has heard of it
CAB, PHONE = {"width": 1180, "height": 700}, {"width": 390, "height": 844}
GRAB = """
[[attachments]]
name = "grab"
kind = "grab"
mass_kg = 1100
centre_m = [0.75, 0.2]
point_m = [1.6, 0.0]
rated_payload_kg = 1300
"""
Wanted = Callable[[WeighingService], bool]


def hangs(service: WeighingService) -> bool:
    """A weight that is OK, and some buckets in the truck."""
    net = service.estimate.net
    return net.status is Status.OK and net.value > 900.0 and service.truck.filled >= BUCKETS


def digs(service: WeighingService) -> bool:
    """The teeth are in the ground."""
    force = service.estimate.soil.magnitude
    return force.status is Status.OK and force.value > 4e4 and service.truck.filled >= BUCKETS


def played(made: Play) -> Iterator[Event]:
    """What the sensors send."""
    return bus_events(made.service, made.made, made.records, START_US, np.random.default_rng(made.seed))


def core_of(loaded: Loaded, seed: int) -> Core:
    """The service, commissioned with the empty machine's moves."""
    moves = prepare(loaded, "moves", seed, 0.1, amount=MOVES_S)
    period = round(1e6 / loaded.service.filters.rate_hz)
    pieces = samples(assembler(loaded.service), played(moves), period)
    longest = int(loaded.service.health.hold_s * loaded.service.filters.rate_hz)
    segments = [segment for piece in pieces for segment in gapless(piece, longest)]
    return Core(loaded.service, identify(model_of(loaded), segments).tares)


class Scene:
    """The machine at work, seen by the service and by the display."""

    def __init__(self, loaded: Loaded, seed: int) -> None:
        self._core = core_of(loaded, seed)
        self._service = WeighingService.start(self._core)
        self._service.truck = replace(self._service.truck, target=TARGET_KG)
        self._events = played(prepare(loaded, "cycles", seed, 0.1, amount=CYCLES))
        self._listener, self._loading, self._beat_us = Listener(loaded.service), Loading(), 0
        self._painter = Painter(self._listener, Marks())
        self._pdos, self._ticks = {pdo.number: pdo for pdo in loaded.service.publication}, 0

    def until(self, wanted: Wanted) -> Picture:
        """The engineering picture, which holds the operator's, of the next moment that is wanted and lasts."""
        held = 0
        for event in self._events:
            estimate = self._service.on_event(event)
            if isinstance(event, Frame):
                self._listener.on_frame(event)
            elif estimate is not None:
                self._hear(event.t_us, frames(self._core.service.publication, estimate))
                held = held + 1 if wanted(self._service) else 0
                if held > HELD_S * self._core.service.filters.rate_hz:
                    return self._painter.engineering(self._loading, event.t_us)
        raise ValueError("the machine's work has ended before the moment came: another --seed")

    def _hear(self, t_us: int, sent: Iterable[tuple[int, bytes]]) -> None:
        self._ticks += 1
        for number, data in sent:
            pdo = self._pdos[number]
            if self._ticks % max(1, round(pdo.period_s * self._core.service.filters.rate_hz)) == 0:
                self._listener.on_frame(Frame(t_us, pdo.can_id, data))
        if t_us - self._beat_us >= HEARTBEAT_US:
            self._beat_us = t_us
            self._listener.on_frame(Frame(t_us, 0x700 + self._core.service.node_id, b"\x05"))
        truck, booking = self._service.truck, self._service.estimate.booking
        last = booking.number if booking else 0
        known = TruckState(truck.number, truck.total, truck.filled, last, last, truck.product, truck.target, 1, 0)
        if self._loading.known is None or known.filled != self._loading.known.filled:
            self._loading.update(known)


@contextmanager
def served(picture: Picture) -> Iterator[str]:
    """The page's address; its streams repeat one picture."""
    feeds = Feed(lambda: picture), Feed(lambda: picture)
    desk: Any = PageSources(None, None, *feeds, lambda: START_US)  # type: ignore[arg-type]  # nothing is commanded
    listening = socket.create_server(("127.0.0.1", 0))
    server = uvicorn.Server(uvicorn.Config(_renewing(application(desk), feeds), lifespan="off", log_config=None))
    thread = threading.Thread(target=server.run, args=([listening],), daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{listening.getsockname()[1]}"
    server.should_exit = True
    for feed in feeds:
        feed.closed = True
    thread.join(5.0)


def _renewing(app: Any, feeds: tuple[Feed, Feed]) -> Any:  # noqa: ANN401 - ASGI's types
    """The application, with a task that sends the picture again and again."""
    import asyncio

    async def renew() -> None:
        while not feeds[0].closed:
            for feed in feeds:
                feed.renew()
            await asyncio.sleep(0.1)

    tasks: list[asyncio.Task[None]] = []

    async def wrapped(scope: Any, receive: Any, send: Any) -> None:  # noqa: ANN401
        if not tasks:
            tasks.append(asyncio.create_task(renew()))
        await app(scope, receive, send)

    return wrapped


def shot(browser: Browser, picture: Picture, path: Path, viewport: Any, locale: str, click: str = "") -> None:  # noqa: ANN401
    """One picture in a file."""
    with served(picture) as address:
        context = browser.new_context(
            viewport=viewport, locale=locale, device_scale_factor=1.0 if viewport is PHONE else 0.8
        )
        page = context.new_page()
        page.set_default_timeout(120e3)
        page.goto(address)
        page.wait_for_selector("#arm polygon", state="attached")
        if click:
            page.click(click)
        if "engineering" in click:
            page.wait_for_selector("#signals tr")
        page.screenshot(path=path, full_page=viewport is PHONE)
        context.close()
    print(path, flush=True)


def main() -> None:
    """Write them."""
    parser = argparse.ArgumentParser(prog="tools/screenshots", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("src/cylforce/display/docs"), help="folder")
    parser.add_argument("--seed", type=int, default=3)
    options = parser.parse_args()
    with TemporaryDirectory() as folder:
        machine = Path(folder) / "machine.toml"
        machine.write_text(shipped("excavator_20t.toml").read_text() + GRAB)
        scene = Scene(load(machine), options.seed)
        loaded, contact = scene.until(hangs), scene.until(digs)
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        shot(browser, loaded, options.output / "day.png", CAB, "en-GB")
        shot(browser, contact, options.output / "night.png", CAB, "en-GB", "#night")
        shot(browser, loaded, options.output / "phone.png", PHONE, "de-DE")
        shot(browser, contact, options.output / "engineering.png", CAB, "en-GB", "nav a[href='#engineering']")
        browser.close()


if __name__ == "__main__":
    main()
