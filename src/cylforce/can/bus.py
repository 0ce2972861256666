"""The CAN bus as the event loop uses it.

Frames are received by the loop's own reader and sent without waiting. A bus that fails is opened again. python-can's
Notifier is not used: on a broken bus it blocks or keeps the processor busy, and receiving through it takes ten times as
long.

No frame is sent over a network to another computer: `remote` accepts 127.0.0.1 only, `udp_multicast` is refused.
"""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from cylforce.signals.events import ERROR, Frame

OnFrame = Callable[[Frame], None]
OnSent = Callable[[int, bytes], None]
Filter = tuple[int, int]  # identifier and mask, both with SocketCAN's flag bits

# Frames read at one wake-up; then the loop serves its timers, so that many frames cannot delay the ticks. Chosen.
BURST = 256
FIRST_DELAY_S, LAST_DELAY_S = 0.1, 1.0  # s before a failed bus is opened again, doubled at each attempt; chosen


class BusError(Exception):
    """A bus cannot be opened; the text is a sentence with the reason and the cure."""


@dataclass(slots=True)
class Counters:
    """Counts since the start.

    received, sent: frames
    dropped: own frames that were not sent, because the queue was full or the bus down
    errors: failures of the bus, and of attempts to open it again
    reopened: times that the bus was opened again
    """

    received: int = 0
    sent: int = 0
    dropped: int = 0
    errors: int = 0
    reopened: int = 0


class Bus(ABC):
    """A CAN bus, the base class of the transports.

    A subclass opens its transport in `_open`, which may raise OSError or BusError, receives on the loop from `_listen`
    on, and closes the transport in `_shut`. It counts each received frame and passes it to `_on_frame`. It calls
    `_sent` after each frame that it sent, and `_lost` when the transport fails.

    name: INTERFACE:CHANNEL
    counters: counts since the start
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.counters = Counters()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._on_frame: OnFrame = _ignore
        self._on_sent: OnSent = _ignore_sent
        self._delay_s = FIRST_DELAY_S
        self._passed = 0  # frames received and sent until the last failure
        self._again: asyncio.TimerHandle | None = None  # the next attempt to open the bus
        self._filters: tuple[Filter, ...] | None = None  # None: every frame is received

    def accept(self, filters: Iterable[Filter]) -> None:
        """Receive from now on only frames that match one of the filters, and the controller's error frames.

        A frame matches where its identifier equals the filter's in every bit that is 1 in the filter's mask. Traffic
        between other nodes, however much there is, then costs no time.
        """
        self._filters = tuple(filters)

    def _accepts(self, can_id: int) -> bool:
        """Return whether a frame passes the filters, for a transport that cannot filter by itself."""
        if self._filters is None or can_id & ERROR:
            return True
        return any((can_id ^ wanted) & mask == 0 for wanted, mask in self._filters)

    def attach(self, loop: asyncio.AbstractEventLoop, on_frame: OnFrame, on_sent: OnSent | None = None) -> None:
        """Begin to receive on an event loop.

        on_frame: called, in the loop's thread, with each frame received
        on_sent: called with identifier and data of each frame sent
        """
        self._loop, self._on_frame, self._on_sent = loop, on_frame, on_sent or _ignore_sent
        self._listen(loop)

    @abstractmethod
    def send(self, can_id: int, data: bytes) -> bool:
        """Send a frame without waiting; return False when it was dropped and counted.

        can_id: identifier with SocketCAN's flag bits
        """

    def overflow(self) -> int:
        """Return the number of received frames that were lost so far because the receive buffer was full.

        It is 0 where a transport does not count them.
        """
        return 0

    def close(self) -> None:
        """Detach and close the bus; a second call has no effect."""
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
        """Count and report a frame that was sent; return True."""
        self.counters.sent += 1
        self._on_sent(can_id, data)
        return True

    def _drop(self) -> bool:
        """Count a frame that was not sent; return False."""
        self.counters.dropped += 1
        return False

    def _lost(self) -> None:
        """Count a failure, close the transport, and open it again later.

        The wait doubles with each failure, from FIRST_DELAY_S to LAST_DELAY_S. It starts again from the shortest once
        frames have been received or sent. Before `attach` and after `close` the transport stays closed.
        """
        self.counters.errors += 1
        passed = self.counters.received + self.counters.sent
        if passed != self._passed:
            self._passed, self._delay_s = passed, FIRST_DELAY_S
        self._shut()
        if self._loop is not None:
            self._again = self._loop.call_later(self._delay_s, self._reopen)
            self._delay_s = min(2.0 * self._delay_s, LAST_DELAY_S)

    def _reopen(self) -> None:
        """Open the transport again; if that fails, try once more later."""
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
    """Ignore received frames, before `attach` and after `close`."""


def _ignore_sent(can_id: int, data: bytes) -> None:
    """Ignore frames that were sent, where they are not reported."""
