"""Buses for computers without SocketCAN, through python-can.

`virtual` works inside one process, `remote` between processes of this computer through a relay at 127.0.0.1. Unlike a
real bus, neither has arbitration or a bit rate.
"""

import asyncio
import queue
import select
import threading
from collections.abc import Callable
from types import ModuleType, TracebackType
from typing import TYPE_CHECKING, Self, cast

import can
from can.interfaces import virtual

from cylforce.can.bus import BURST, Bus, BusError
from cylforce.signals.events import ERROR, EXTENDED, REMOTE, Frame

if TYPE_CHECKING:
    import can_remote

HOST = "127.0.0.1"
_QUEUE_FRAMES = 5000  # as many as SocketCAN's receive buffer holds; chosen


def _message(can_id: int, data: bytes) -> can.Message:
    """Return python-can's message of a frame. A remote frame has no data, and its length becomes 0.

    can_id: identifier with SocketCAN's flag bits
    """
    return can.Message(
        arbitration_id=can_id & 0x1FFFFFFF,
        is_extended_id=bool(can_id & EXTENDED),
        is_remote_frame=bool(can_id & REMOTE),
        is_error_frame=bool(can_id & ERROR),
        data=None if can_id & REMOTE else data,
    )


def _can_id(message: can.Message) -> int:
    """Return the identifier of a message with SocketCAN's flag bits."""
    flags = (message.is_extended_id and EXTENDED) | (message.is_remote_frame and REMOTE)
    return message.arbitration_id | flags | (message.is_error_frame and ERROR)


class _Mailbox(queue.Queue[can.Message]):
    """A receive queue. A sender never waits: when the queue is full, the frame is lost and counted.

    arrived: called, in the sender's thread, after each frame that was stored
    lost: number of frames that were lost
    """

    def __init__(self, arrived: Callable[[], None]) -> None:
        super().__init__()
        self.lost = 0
        self._arrived = arrived

    def put(self, item: can.Message, block: bool = True, timeout: float | None = None) -> None:
        """Store a frame and call `arrived`; count it as lost when _QUEUE_FRAMES wait already.

        The arguments are those of `queue.Queue`; `block` and `timeout` have no effect.
        """
        if self.qsize() >= _QUEUE_FRAMES:
            self.lost += 1
            return
        super().put(item)
        self._arrived()


class PythonCan(Bus):
    """Base class of both buses: converts messages of python-can into frames."""

    def _received(self, t_us: int, message: can.Message) -> None:
        """Count a message and pass it on as a frame of the time `t_us` [us], unless it is filtered out."""
        can_id = _can_id(message)
        if self._accepts(can_id):
            self.counters.received += 1
            self._on_frame(Frame(t_us, can_id, bytes(message.data)))


class Virtual(PythonCan):
    """The bus `virtual:NAME`: python-can's virtual bus, so that other programs in this process can use python-can on
    it.

    Frames may come from any thread.

    channel: its name
    now: clock that stamps the frames [us]
    """

    def __init__(self, channel: str, now: Callable[[], int]) -> None:
        super().__init__(f"virtual:{channel}")
        self._channel, self._now = channel, now
        self._mailbox = _Mailbox(self._arrived)
        self._woken = threading.Event()
        self._open()

    def _open(self) -> None:
        """Join the bus, with a queue that wakes the loop."""
        self._bus: virtual.VirtualBus | None = virtual.VirtualBus(self._channel)
        with virtual.channels_lock:
            # python-can's queue is replaced by one that wakes the loop
            place = self._bus.channel.index(self._bus.queue)
            self._bus.channel[place] = self._bus.queue = self._mailbox

    def _listen(self, loop: asyncio.AbstractEventLoop) -> None:
        loop.call_soon(self._drain)

    def _shut(self) -> None:
        """Leave the bus."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    def _arrived(self) -> None:
        """Make the loop call `_drain`, unless that has been requested already; called in any thread."""
        loop = self._loop
        if loop is not None and not loop.is_closed() and not self._woken.is_set():
            self._woken.set()
            loop.call_soon_threadsafe(self._drain)

    def _drain(self) -> None:
        """Receive the frames that wait, all with the time of this call; after BURST frames, request another call."""
        self._woken.clear()
        t_us = self._now()
        for _ in range(BURST):
            try:
                message = self._mailbox.get_nowait()
            except queue.Empty:
                return
            self._received(t_us, message)
        self._arrived()

    def send(self, can_id: int, data: bytes) -> bool:
        """Send a frame, see `Bus.send`."""
        if self._bus is None:
            return self._drop()
        self._bus.send(_message(can_id, data))
        return self._sent(can_id, data)

    def overflow(self) -> int:
        """Return the number of lost frames, see `Bus.overflow`."""
        return self._mailbox.lost


class Remote(PythonCan):
    """The bus `remote:127.0.0.1:PORT`: a client of the relay (`Relay`, or `python -m can_remote -H 127.0.0.1`).

    Raises BusError with a sentence for another address, or where no relay answers.

    channel: address of the relay, 127.0.0.1:PORT
    now: clock that stamps the frames [us]
    """

    def __init__(self, channel: str, now: Callable[[], int]) -> None:
        super().__init__(f"remote:{channel}")
        host, _, port = channel.rpartition(":")
        if host != HOST:
            raise BusError(f"{self.name}: frames stay on this machine, so the address must be {HOST}:PORT")
        if not (port.isascii() and port.isdecimal() and len(port) <= 5 and 1 <= int(port) <= 65535):
            raise BusError(f"{self.name}: {port!r} is no port number: write one from 1 to 65535")
        self._address, self._now = channel, now
        self._bus: can_remote.RemoteBus | None = None
        try:
            self._open()
        except OSError as error:
            relay = f"python -m can_remote -i virtual -c x -p {port} -H {HOST}"
            why = error.strerror or error
            raise BusError(f"{self.name}: no relay answers there ({why}): start `{relay}`") from error

    def _open(self) -> None:
        """Connect to the relay."""
        self._bus = _can_remote().RemoteBus(f"ws://{self._address}")
        self._bus.socket.settimeout(1.0)  # between the bytes of one frame
        self._reader = self._bus.socket.fileno()

    def _listen(self, loop: asyncio.AbstractEventLoop) -> None:
        """Receive frames on the event loop."""
        if self._bus is None:
            return
        if self._bus.socket.fileno() < 0:  # the relay ended while the connection was opened
            self._lost()
        else:
            loop.add_reader(self._reader, self._drain)

    def _shut(self) -> None:
        """Disconnect without waiting for the relay."""
        if self._bus is None:
            return
        if self._loop is not None:
            # by its number: when the relay ends, the client closes the socket itself
            self._loop.remove_reader(self._reader)
        can.BusABC.shutdown(self._bus)  # RemoteBus.shutdown would wait for the relay's answer without a time limit
        self._bus.socket.close()
        self._bus = None

    def _drain(self) -> None:
        """Receive the frames that wait, at most BURST, all with the time of this call. On any error reconnect later."""
        t_us = self._now()
        for _ in range(BURST):
            if self._bus is None:
                return
            try:
                if not select.select([self._bus.socket], [], [], 0.0)[0]:
                    return
                message = self._bus.recv(0.0)
            except Exception:  # noqa: BLE001 - when the relay ends, the client raises whatever its parser raises
                self._lost()
                return
            if message is not None:
                self._received(t_us, message)

    def send(self, can_id: int, data: bytes) -> bool:
        """Send a frame, see `Bus.send`; after an error the bus is opened again later."""
        if self._bus is None:
            return self._drop()
        try:
            if not select.select([], [self._bus.socket], [], 0.0)[1]:
                return self._drop()
            self._bus.send(_message(can_id, data))
        except (OSError, ValueError):  # ValueError: the client has closed the socket
            self._lost()
            return self._drop()
        return self._sent(can_id, data)


def _can_remote() -> ModuleType:
    """Return the package, which only the extra `remote` installs. Raises BusError with a sentence."""
    try:
        import can_remote
    except ImportError as error:
        raise BusError("remote buses need python-can-remote: pip install 'cylforce[remote]'") from error
    return cast(ModuleType, can_remote)


class Relay:
    """The relay between `remote` buses, in threads of this process: `with Relay() as relay: open_bus(relay.name)`.

    port: port at 127.0.0.1; 0: any free one
    name: name of the bus
    """

    def __init__(self, port: int = 0) -> None:
        self._server = _can_remote().RemoteServer(HOST, port, interface="virtual", channel=f"relay {id(self)}")
        self.name = f"remote:{HOST}:{self._server.server_port}"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.shutdown()
        for client in tuple(self._server.clients):
            client.running = False
        self._server.server_close()
        self._thread.join()
