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

PERIOD_S = 0.2  # s between two pictures; chosen
WIDTH = 40  # characters of the target bar; chosen
FULL = 1.25  # end of the target bar, times the target; chosen


def lines(picture: Picture, language: str, unit: MassUnit = KILOGRAM) -> Iterator[str]:
    """Yield the picture (`Painter.work`) as lines of text.

    language: language of the text
    unit: unit of masses
    """
    translate = catalogue(language).gettext
    weight, truck = picture["weight"], picture["truck"]
    if weight["net"] is None:
        yield _reason(weight["reason"], language)
        yield ""
    else:
        yield f"{unit.coarse(weight['net'])} {unit.symbol} ± {unit.coarse(weight['error'])} {unit.symbol}"
        yield f"{translate(STATUSES[Status(weight['status'])])} {_reason(weight['reason'], language)}".rstrip()
    yield f"{translate('Force at the teeth')}: {_force(picture['force'], language)}"
    if truck is None:
        yield translate(SILENT_WORDS)
        return
    goal = f" / {unit.coarse(truck['target'])}" if truck["target"] else ""
    loaded, total = (f"{unit.coarse(truck[name])}" for name in ("loaded", "total"))
    part = f", {translate('part')} {truck['part']}" if truck["part"] > 1 else ""
    in_all = f", {translate('in all')} {total} {unit.symbol}" if part else ""
    loaded = f"{loaded}{goal} {unit.symbol}{in_all}"
    yield f"{translate('Truck')} {truck['number']}{part}: {loaded}, {translate('Buckets')}: {truck['filled']}"
    if truck["share"] is not None:
        yield _bar(truck["share"], truck["with_bucket"])
    yield from (f"{b['number']:6d}  {unit.coarse(b['mass'])} {unit.symbol}" for b in reversed(picture["buckets"]))


def _reason(code: int, language: str) -> str:
    """Return a reason in a language; "" for none."""
    translate = catalogue(language).gettext
    text = SILENT_WORDS if code == SILENT else REASONS[Reason(code)]
    return translate(text) if text else ""


def _force(force: Picture, language: str) -> str:
    """Return magnitude and direction of a force, or why there is none."""
    if force["magnitude"] is None:
        return _reason(force["reason"], language)
    turn = "" if force["direction"] is None else f", {force['direction'] / DEGREE:.0f}°"
    return f"{1e-3 * force['magnitude']:.1f} kN{turn}"


def _bar(share: float, with_bucket: float) -> str:
    """Return the target bar: the booked share, the bucket, and a mark at the target.

    share: share of the target that is booked
    with_bucket: the same with the bucket that was weighed
    """
    goal = round(WIDTH / FULL)
    booked, hanging = (min(WIDTH, max(0, round(WIDTH * part / FULL))) for part in (share, with_bucket))
    cells = "█" * booked + "▒" * max(0, hanging - booked)
    cells = cells.ljust(WIDTH, "·")
    return f"{cells[:goal]}|{cells[goal:]}"


async def show(
    service: Service, bus: Bus, marks: Marks, language: str, console: Console, unit: MassUnit = KILOGRAM
) -> None:
    """Show the page until SIGTERM or SIGINT."""
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
            text = "\n".join(lines(painter.work(panel.loading, now_us()), language, unit))
            live.update(Text(text), refresh=True)
            await asyncio.sleep(PERIOD_S)
    follow.cancel()


def run_terminal(service: Service, bus: Bus, marks: Marks, language: str, unit: MassUnit = KILOGRAM) -> None:
    """Show the page until SIGTERM or SIGINT, then close the bus."""
    asyncio.run(show(service, bus, marks, language, Console(highlight=False), unit))
    bus.close()
