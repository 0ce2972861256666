"""The operator's page as text, for a terminal on the controller or over ssh. It needs no extra packages."""

import asyncio
import signal
from collections.abc import Iterator

from rich.console import Console
from rich.live import Live
from rich.text import Text

from cylforce.can.bus import Bus
from cylforce.can.clock import now_us
from cylforce.canopen.network import Network
from cylforce.display.listener import Listener
from cylforce.display.panel import Panel
from cylforce.display.picture import SILENT, Marks, Painter, Picture
from cylforce.display.words import REASONS, STATUSES, catalogue
from cylforce.display.words import SILENT as SILENT_WORDS
from cylforce.mechanics.installation import Service
from cylforce.signals.estimate import Reason, Status
from cylforce.signals.events import Frame
from cylforce.signals.units import DEGREE, KILOGRAM, MassUnit

PERIOD_S = 0.2  # between two pictures
WIDTH = 40  # characters of the target bar, which ends at 125 % of the target
FULL = 1.25


def lines(picture: Picture, language: str, unit: MassUnit = KILOGRAM) -> Iterator[str]:
    """The picture (`Painter.work`) as lines of text in a language, masses in a unit."""
    say = catalogue(language).gettext
    weight, truck = picture["weight"], picture["truck"]
    if weight["net"] is None:
        yield _reason(weight["reason"], language)
        yield ""
    else:
        yield f"{unit.coarse(weight['net'])} {unit.symbol} ± {unit.coarse(weight['error'])} {unit.symbol}"
        yield f"{say(STATUSES[Status(weight['status'])])} {_reason(weight['reason'], language)}".rstrip()
    yield f"{say('Force at the teeth')}: {_force(picture['force'], language)}"
    if truck is None:
        yield say(SILENT_WORDS)
        return
    goal = f" / {unit.coarse(truck['target'])}" if truck["target"] else ""
    load, whole = (f"{unit.coarse(truck[name])}" for name in ("loaded", "total"))
    part = f", {say('part')} {truck['part']}" if truck["part"] > 1 else ""
    both = f", {say('in all')} {whole} {unit.symbol}" if part else ""
    load = f"{load}{goal} {unit.symbol}{both}"
    yield f"{say('Truck')} {truck['number']}{part}: {load}, {say('Buckets')}: {truck['filled']}"
    if truck["share"] is not None:
        yield _bar(truck["share"], truck["with_bucket"])
    yield from (f"{b['number']:6d}  {unit.coarse(b['mass'])} {unit.symbol}" for b in reversed(picture["buckets"]))


def _reason(code: int, language: str) -> str:
    say = catalogue(language).gettext
    text = SILENT_WORDS if code == SILENT else REASONS[Reason(code)]
    return say(text) if text else ""


def _force(force: Picture, language: str) -> str:
    if force["magnitude"] is None:
        return _reason(force["reason"], language)
    turn = "" if force["direction"] is None else f", {force['direction'] / DEGREE:.0f}°"
    return f"{1e-3 * force['magnitude']:.1f} kN{turn}"


def _bar(share: float, with_bucket: float) -> str:
    """What is booked, what hangs in the bucket, and the target."""
    goal = round(WIDTH / FULL)
    booked, hanging = (min(WIDTH, max(0, round(WIDTH * part / FULL))) for part in (share, with_bucket))
    cells = "█" * booked + "▒" * max(0, hanging - booked)
    cells = cells.ljust(WIDTH, "·")
    return f"{cells[:goal]}|{cells[goal:]}"


async def show(
    service: Service, bus: Bus, marks: Marks, language: str, console: Console, unit: MassUnit = KILOGRAM
) -> None:
    """Until SIGTERM or SIGINT."""
    network, listener, until = Network(bus.send), Listener(service), asyncio.Event()
    panel, painter = Panel(network, service.node_id), Painter(listener, marks)

    def on_frame(frame: Frame) -> None:
        listener.on_frame(frame)
        network.on_frame(frame)

    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, until.set)
    bus.attach(loop, on_frame)
    follow = asyncio.create_task(panel.follow())
    with Live(console=console, auto_refresh=False) as live:
        while not until.is_set():
            said = lines(painter.work(panel.loading, now_us()), language, unit)
            live.update(Text("\n".join(said)), refresh=True)
            await asyncio.sleep(PERIOD_S)
    follow.cancel()


def run_terminal(service: Service, bus: Bus, marks: Marks, language: str, unit: MassUnit = KILOGRAM) -> None:
    """Show until a signal comes."""
    asyncio.run(show(service, bus, marks, language, Console(highlight=False), unit))
    bus.close()
