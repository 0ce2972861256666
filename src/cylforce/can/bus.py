"""The CAN bus as the loop sees it: frames come in by a reader of our own, go out without waiting, and a bus
that fails is opened again. python-can's notifier hangs or spins on a broken bus, and its receive path costs
ten times as much.

Nothing ever leaves the machine by a network: `remote` is 127.0.0.1 only, `udp_multicast` is refused.
"""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from cylforce.signals.events import Frame

OnFrame = Callable[[Frame], None]
OnSent = Callable[[int, bytes], None]

BURST = 256  # frames per wake-up: after so many the loop gets its turn, so that a flood cannot starve the ticks
FIRST_DELAY_S, LAST_DELAY_S = 0.1, 1.0  # back-off of opening again


class BusError(Exception):
    """A bus that cannot be opened; the text is a sentence that says why and what to do."""


@dataclass(slots=True)
class Counters:
    """What a bus has seen: frames received and sent; own frames dropped because the queue was full or the bus
    down; failures of the bus; how often it was opened again."""

    received: int = 0
    sent: int = 0
    dropped: int = 0
    errors: int = 0
    reopened: int = 0


class Bus(ABC):
    """A CAN bus. `name` is what it was opened by, `counters` what it has seen. Subclasses own the transport:
    they open it in `_open`, which may raise OSError or BusError, count and pass on what they receive by `_on_frame`,
    count and report what they send by `_sent`, and call `_lost` when the transport fails."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.counters = Counters()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._on_frame: OnFrame = _ignore
        self._on_sent: OnSent = _ignore_sent
        self._delay_s = FIRST_DELAY_S
        self._passed = 0  # frames that had passed either way when the bus failed last
        self._again: asyncio.TimerHandle | None = None

    def attach(self, loop: asyncio.AbstractEventLoop, on_frame: OnFrame, on_sent: OnSent | None = None) -> None:
        """From now on `on_frame` is called, in the loop's thread, with each frame received, and `on_sent` with
        identifier and data of each frame sent."""
        self._loop, self._on_frame, self._on_sent = loop, on_frame, on_sent or _ignore_sent
        self._listen(loop)

    @abstractmethod
    def send(self, can_id: int, data: bytes) -> bool:
        """Send without waiting; `can_id` with SocketCAN's flag bits. False: dropped and counted."""

    def overflow(self) -> int:
        """Frames lost so far because nobody fetched them in time."""
        return 0

    def close(self) -> None:
        """Detach and close; twice does no harm."""
        if self._again is not None:
            self._again.cancel()
        self._shut()
        self._loop, self._on_frame, self._on_sent = None, _ignore, _ignore_sent

    @abstractmethod
    def _open(self) -> None: ...

    @abstractmethod
    def _listen(self, loop: asyncio.AbstractEventLoop) -> None: ...

    @abstractmethod
    def _shut(self) -> None: ...

    def _sent(self, can_id: int, data: bytes) -> bool:
        self.counters.sent += 1
        self._on_sent(can_id, data)
        return True

    def _drop(self) -> bool:
        self.counters.dropped += 1
        return False

    def _lost(self) -> None:
        """The transport failed: close it, open it again later; each time later than before, unless frames have passed
        since."""
        self.counters.errors += 1
        passed = self.counters.received + self.counters.sent
        if passed != self._passed:
            self._passed, self._delay_s = passed, FIRST_DELAY_S
        self._shut()
        if self._loop is not None:
            self._again = self._loop.call_later(self._delay_s, self._reopen)
            self._delay_s = min(2.0 * self._delay_s, LAST_DELAY_S)

    def _reopen(self) -> None:
        if self._loop is None:
            return
        try:
            self._open()
        except (OSError, BusError):
            self._lost()
            return
        self.counters.reopened += 1
        self._listen(self._loop)


def _ignore(frame: Frame) -> None:
    """Before `attach` and after `close`."""


def _ignore_sent(can_id: int, data: bytes) -> None:
    """Nobody wants to know what was sent."""
