"""Server-sent events: every client gets the latest picture whenever it can take one.

For a client that does not read, only one event is stored; after PATIENCE_S it is disconnected.
"""

import asyncio
import json
from collections.abc import Callable
from typing import Any

from starlette.types import Receive, Scope, Send

PATIENCE_S = 10.0  # s for which a client may not read; chosen
MOST = 64  # clients; one more is refused; chosen


class Feed:
    """The latest event of one kind, and the clients that wait for the next.

    make: returns the content of an event
    clients: number of clients
    latest: the last event
    closed: whether no more events come
    """

    def __init__(self, make: Callable[[], dict[str, Any]]) -> None:
        self._make = make
        self.clients = 0
        self.latest = b""
        self.closed = False
        self._next = asyncio.Event()

    def renew(self) -> None:
        """Make a new event, once for all clients, if there are any."""
        if self.clients:
            self.latest = (
                b"data: " + json.dumps(self._make(), allow_nan=False, separators=(",", ":")).encode() + b"\n\n"
            )
            self._wake()

    def close(self) -> None:
        """Disconnect every client."""
        self.closed = True
        self._wake()

    def _wake(self) -> None:
        """Wake the clients that wait for the next event."""
        waiting, self._next = self._next, asyncio.Event()
        waiting.set()

    async def next(self) -> bytes:
        """Wait for the next event and return it."""
        await self._next.wait()
        return self.latest

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one client until it disconnects, stops reading, or the feed closes."""
        if self.clients >= MOST or self.closed:
            await _refused(send)
            return
        self.clients += 1
        gone = asyncio.create_task(_gone(receive))
        try:
            await self._serve(send, gone)
        finally:
            self.clients -= 1
            gone.cancel()

    async def _serve(self, send: Send, gone: "asyncio.Task[None]") -> None:
        """Send events; `gone` ends when the client disconnects."""
        kind = [(b"content-type", b"text/event-stream")]
        await send({"type": "http.response.start", "status": 200, "headers": kind})
        while not self.closed and not gone.done():
            event = await self.next()
            try:
                body = {"type": "http.response.body", "body": event, "more_body": True}
                await asyncio.wait_for(send(body), PATIENCE_S)
            except TimeoutError:
                return
        await send({"type": "http.response.body", "body": b""})


async def _gone(receive: Receive) -> None:
    """Wait until the client disconnects."""
    while (await receive())["type"] != "http.disconnect":
        pass


async def _refused(send: Send) -> None:
    """Answer that there are too many clients."""
    await send({"type": "http.response.start", "status": 503, "headers": []})
    await send({"type": "http.response.body", "body": b"Too many pages are open."})
