"""Access control of the page: foreign hosts and origins are refused, changes may need a PIN."""

import hmac
from collections.abc import Callable, Iterable
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LOOPBACK = ("127.0.0.1", "localhost", "::1")
TRIES, LOCKED_US = 5, 30_000_000  # wrong PINs in a row, after which every PIN is refused for so many us; chosen
HEADERS = (  # of every answer: the page loads nothing from elsewhere and is not embedded
    (b"content-security-policy", b"default-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cache-control", b"no-store"),
)


class Guard:
    """A wrapper around the application that refuses requests.

    app: the application
    hosts: names under which it may be reached
    pin: PIN for changes; "": none
    now_us: clock [us]
    """

    def __init__(self, app: ASGIApp, hosts: Iterable[str], pin: str, now_us: Callable[[], int]) -> None:
        self._app, self._hosts, self._pin, self._now_us = app, frozenset(hosts), pin, now_us
        self._wrong = self._until_us = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it with a sentence."""
        if scope["type"] != "http":
            return
        refusal = self.refusal(scope["method"], Headers(scope=scope))

        async def send_with_headers(message: Message) -> None:
            """Send a message; an answer gets the headers."""
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", ()), *HEADERS]
            await send(message)

        answer = self._app if refusal is None else PlainTextResponse(refusal[1], refusal[0])
        await answer(scope, receive, send_with_headers)

    def refusal(self, method: str, headers: Headers) -> tuple[int, str] | None:
        """Return status and sentence of a refusal; None if the request may pass."""
        host, origin = headers.get("host", ""), headers.get("origin")
        if _name(host) not in self._hosts:
            return 421, f"This page is not served under the name {_name(host)!r}: see cylforce display --name."
        if origin is not None and urlsplit(origin).netloc != host:
            return 403, "Refused: another page asked for this."
        if headers.get("sec-fetch-site", "same-origin") not in ("same-origin", "none"):
            return 403, "Refused: another page asked for this."
        if method in ("GET", "HEAD"):
            return None
        if headers.get("content-type", "").partition(";")[0] != "application/json":
            return 415, "Refused: a change is sent as application/json."
        return self._pin_refusal(headers.get("x-pin", ""))

    def _pin_refusal(self, given: str) -> tuple[int, str] | None:
        """Return the refusal of a PIN; None if it is right or none is needed."""
        if not self._pin:
            return None
        if self._now_us() < self._until_us:
            return 429, "Too many wrong PINs: wait half a minute."
        if hmac.compare_digest(given.encode(), self._pin.encode()):
            self._wrong = 0
            return None
        self._wrong += bool(given)
        if self._wrong >= TRIES:
            self._wrong, self._until_us = 0, self._now_us() + LOCKED_US
        return 401, "The PIN is missing or wrong."


def _name(host: str) -> str:
    """Return the name in a host header, without the port."""
    return (urlsplit(f"//{host}").hostname or "") if host else ""
