"""The pages and what they ask for, as a Starlette application."""

import sqlite3
from collections.abc import Callable
from contextlib import closing
from importlib.resources import files
from math import isnan
from pathlib import Path
from typing import Any, NamedTuple

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from cylforce.display.panel import Panel
from cylforce.display.stream import Feed
from cylforce.display.tickets import ticket_page
from cylforce.display.words import ENGLISH, languages, page_words, wanted
from cylforce.files.atomic import RecordingError
from cylforce.records.export import row_of
from cylforce.records.labels import set_to_zero
from cylforce.records.queries import GRAND, SHIFT, SHORT, Total, bookings, totals
from cylforce.records.schema import open_labels, open_reading
from cylforce.records.ticket import ticket
from cylforce.signals.units import MASS_UNITS, MassUnit

STATIC = Path(str(files(__package__) / "static"))
LISTED = 100  # bookings on the history page


class PageSources(NamedTuple):
    """What the pages need: how to command, where the records are (None: nowhere), the two streams, the clock, the
    language of a browser that wants none of ours, the unit of mass where the address names none."""

    panel: Panel
    records: Path | None
    work: Feed
    engineering: Feed
    now_us: Callable[[], int]
    language: str = ENGLISH
    unit: str = "kg"


class Pages:
    """The answers to every request."""

    def __init__(self, desk: PageSources) -> None:
        self._desk = desk

    def routes(self) -> list[Route | Mount]:
        """Which address is answered by what."""
        return [
            Route("/", self.front),
            Route("/words", self.words),
            Route("/stream/work", self._desk.work),
            Route("/stream/engineering", self._desk.engineering),
            Route("/history", self.history),
            Route("/ticket/{truck:int}", self.ticket),
            Route("/command", self.command, methods=["POST"]),
            Route("/print", self.print, methods=["POST"]),
            Route("/zero-total", self.zero_total, methods=["POST"]),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]

    def front(self, request: Request) -> Response:
        """The page itself; all else it asks for."""
        text = (STATIC / "index.html").read_text(encoding="utf-8")
        return HTMLResponse(text.replace('lang="en"', f'lang="{self._language(request)}"', 1))

    def words(self, request: Request) -> Response:
        """The page's words."""
        return JSONResponse(page_words(self._language(request), self._unit(request)))

    def _unit(self, request: Request) -> MassUnit:
        return MASS_UNITS.get(request.query_params.get("unit", ""), MASS_UNITS[self._desk.unit])

    def _language(self, request: Request) -> str:
        asked = request.query_params.get("lang", "")
        return (
            asked if asked in languages() else wanted(request.headers.get("accept-language", ""), self._desk.language)
        )

    async def command(self, request: Request) -> Response:
        """Send a command to the service: {"what": ..., "value": ...}; a command without a number needs no value."""
        said = await _body(request)
        value = said.get("value")
        if value is not None and (not isinstance(value, int | float) or isnan(value)):
            return JSONResponse({"done": False, "why": "06090030"})
        outcome = await self._desk.panel.send_command(str(said.get("what")), value)
        return JSONResponse(outcome._asdict())

    def history(self, request: Request) -> Response:
        """Bookings, newest first, and totals; `records` is false where there are none."""
        return self._with_records(_history)

    def ticket(self, request: Request) -> Response:
        """A ticket that was printed already, as a page."""
        truck, language, unit = request.path_params["truck"], self._language(request), self._unit(request)

        def page(found: sqlite3.Connection) -> Response:
            return HTMLResponse(ticket_page(ticket(found, truck, self._desk.now_us(), printing=False), language, unit))

        return self._with_records(page)

    async def print(self, request: Request) -> Response:
        """{"truck": N}: makes its ticket, or one more copy."""
        truck = (await _body(request)).get("truck")
        return await self._written(lambda found: ticket(found, int(str(truck)), self._desk.now_us()))

    async def zero_total(self, request: Request) -> Response:
        """{"which": "short" or "shift"}: begins anew."""
        which = str((await _body(request)).get("which"))
        return await self._written(lambda found: set_to_zero(found, which, self._desk.now_us()))

    def _with_records(self, answer: Callable[[sqlite3.Connection], Response]) -> Response:
        if self._desk.records is None:
            return JSONResponse({"records": False}, 404)
        try:
            with closing(open_reading(self._desk.records)) as found:
                return answer(found)
        except (RecordingError, sqlite3.Error) as error:
            return JSONResponse({"records": False, "why": str(error)}, 404)

    async def _written(self, change: Callable[[sqlite3.Connection], object]) -> Response:
        def write() -> Response:
            if self._desk.records is None:
                return JSONResponse({"done": False}, 404)
            try:
                with closing(open_labels(self._desk.records)) as found:
                    change(found)
            except (RecordingError, sqlite3.Error, ValueError) as error:
                return JSONResponse({"done": False, "why": str(error)}, 409)
            return JSONResponse({"done": True})

        return await run_in_threadpool(write)


async def _body(request: Request) -> dict[str, Any]:
    try:
        said = await request.json()
    except ValueError:
        return {}
    return said if isinstance(said, dict) else {}


def _history(found: sqlite3.Connection) -> Response:
    listed = [row_of(row) for row in reversed(bookings(found, last=LISTED))]
    sums = {which: [_total(total) for total in totals(found, which)] for which in (SHORT, SHIFT, GRAND)}
    return JSONResponse({"records": True, "bookings": listed, "totals": sums})


def _total(total: Total) -> dict[str, Any]:
    return {"product": total.name or total.product, "loads": total.loads, "mass_kg": total.mass}


def application(desk: PageSources) -> Starlette:
    """The application, without its guard."""
    return Starlette(routes=Pages(desk).routes())
