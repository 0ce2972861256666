"""Notifications of a service manager (sd_notify(3)): the service is ready, alive, reads parameters anew, stops."""

import os
import socket
import time
from collections.abc import Mapping
from contextlib import suppress


class Manager:
    """The service manager that started this process, if one did: `NOTIFY_SOCKET` names its socket. Never blocks."""

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        place = (os.environ if environment is None else environment).get("NOTIFY_SOCKET", "")
        self._place = f"\0{place[1:]}" if place.startswith("@") else place
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) if place else None
        if self._socket is not None:
            self._socket.setblocking(False)

    def ready(self) -> None:
        """Notify that the service steps, and its values are on the bus."""
        self._say(b"READY=1\nWATCHDOG=1")

    def alive(self) -> None:
        """Notify that a step was on time, and its values were sent."""
        self._say(b"WATCHDOG=1")

    def reloading(self) -> None:
        """Notify that new parameters are read, while the service steps on."""
        self._say(b"RELOADING=1\nMONOTONIC_USEC=%d" % (time.monotonic_ns() // 1000))

    def reloaded(self) -> None:
        """Notify that reading has ended, with new parameters or with the old ones."""
        self._say(b"READY=1")

    def stopping(self) -> None:
        """Notify that the service stops, and close the socket."""
        self._say(b"STOPPING=1")
        if self._socket is not None:
            self._socket.close()

    def _say(self, words: bytes) -> None:
        if self._socket is not None:
            with suppress(OSError):
                self._socket.sendto(words, self._place)
