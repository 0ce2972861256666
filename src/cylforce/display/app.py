"""The pages and their requests, as a Starlette application."""

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
LISTED = 100  # bookings on the history page; chosen


class PageSources(NamedTuple):
    """Inputs of the pages.

    panel: sends commands
    records: path of the records; None: none
    work: stream of pictures for the operator
    engineering: stream of pictures for the engineer
    now_us: clock [us]
    language: language of a browser that accepts none of ours
    unit: unit of masses where the address names none
    """

    panel: Panel
    records: Path | None
    work: Feed
    engineering: Feed
    now_us: Callable[[], int]
    language: str = ENGLISH
    unit: str = "kg"


class Pages:
    """Answers to all requests.

    sources: inputs of the pages
    """

    def __init__(self, sources: PageSources) -> None:
        self._sources = sources

    def routes(self) -> list[Route | Mount]:
        """Return the addresses with their answers."""
        return [
            Route("/", self.front),
            Route("/words", self.words),
            Route("/stream/work", self._sources.work),
            Route("/stream/engineering", self._sources.engineering),
            Route("/history", self.history),
            Route("/ticket/{truck:int}", self.ticket),
            Route("/command", self.command, methods=["POST"]),
            Route("/print", self.print, methods=["POST"]),
            Route("/zero-total", self.zero_total, methods=["POST"]),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]

    def front(self, request: Request) -> Response:
        """Answer with the page itself, which requests everything else."""
        text = (STATIC / "index.html").read_text(encoding="utf-8")
        return HTMLResponse(text.replace('lang="en"', f'lang="{self._language(request)}"', 1))

    def words(self, request: Request) -> Response:
        """Answer with the page's words."""
        return JSONResponse(page_words(self._language(request), self._unit(request)))

    def _unit(self, request: Request) -> MassUnit:
        """Return the unit of masses that the address names."""
        return MASS_UNITS.get(request.query_params.get("unit", ""), MASS_UNITS[self._sources.unit])

    def _language(self, request: Request) -> str:
        """Return the language that the address names, else the browser's."""
        named = request.query_params.get("lang", "")
        return (
            named
            if named in languages()
            else wanted(request.headers.get("accept-language", ""), self._sources.language)
        )

    async def command(self, request: Request) -> Response:
        """Send a command to the service: {"what": ..., "value": ...}; a command without a number needs no value."""
        body = await _body(request)
        value = body.get("value")
        if value is not None and (not isinstance(value, int | float) or isnan(value)):
            return JSONResponse({"done": False, "why": "06090030"})
        outcome = await self._sources.panel.send_command(str(body.get("what")), value)
        return JSONResponse(outcome._asdict())

    def history(self, request: Request) -> Response:
        """Answer with bookings, newest first, and totals; `records` is false where there are none."""
        return self._with_records(_history)

    def ticket(self, request: Request) -> Response:
        """Answer with a ticket that was printed already, as a page."""
        truck, language, unit = request.path_params["truck"], self._language(request), self._unit(request)

        def page(connection: sqlite3.Connection) -> Response:
            """Return the page."""
            printed = ticket(connection, truck, self._sources.now_us(), printing=False)
            return HTMLResponse(ticket_page(printed, language, unit))

        return self._with_records(page)

    async def print(self, request: Request) -> Response:
        """Make a truck's ticket, or one more copy: {"truck": N}."""
        truck = (await _body(request)).get("truck")
        return await self._written(lambda connection: ticket(connection, int(str(truck)), self._sources.now_us()))

    async def zero_total(self, request: Request) -> Response:
        """Begin a total anew: {"which": "short" or "shift"}."""
        which = str((await _body(request)).get("which"))
        return await self._written(lambda connection: set_to_zero(connection, which, self._sources.now_us()))

    def _with_records(self, answer: Callable[[sqlite3.Connection], Response]) -> Response:
        """Answer from the records, or that there are none."""
        if self._sources.records is None:
            return JSONResponse({"records": False}, 404)
        try:
            with closing(open_reading(self._sources.records)) as connection:
                return answer(connection)
        except (RecordingError, sqlite3.Error) as error:
            return JSONResponse({"records": False, "why": str(error)}, 404)

    async def _written(self, change: Callable[[sqlite3.Connection], object]) -> Response:
        """Change the records in a thread; answer whether it was done, or why not."""

        def write() -> Response:
            """Change the records."""
            if self._sources.records is None:
                return JSONResponse({"done": False}, 404)
            try:
                with closing(open_labels(self._sources.records)) as connection:
                    change(connection)
            except (RecordingError, sqlite3.Error, ValueError) as error:
                return JSONResponse({"done": False, "why": str(error)}, 409)
            return JSONResponse({"done": True})

        return await run_in_threadpool(write)


async def _body(request: Request) -> dict[str, Any]:
    """Return the JSON object in a request; {} for anything else."""
    try:
        body = await request.json()
    except ValueError:
        return {}
    return body if isinstance(body, dict) else {}


def _history(connection: sqlite3.Connection) -> Response:
    """Answer with bookings and totals."""
    listed = [row_of(row) for row in reversed(bookings(connection, last=LISTED))]
    sums = {which: [_total(total) for total in totals(connection, which)] for which in (SHORT, SHIFT, GRAND)}
    return JSONResponse({"records": True, "bookings": listed, "totals": sums})


def _total(total: Total) -> dict[str, Any]:
    """Return a total for JSON."""
    return {"product": total.name or total.product, "loads": total.loads, "mass_kg": total.mass}


def application(sources: PageSources) -> Starlette:
    """Return the application, without its guard."""
    return Starlette(routes=Pages(sources).routes())
