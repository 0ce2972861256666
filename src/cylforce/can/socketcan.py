"""SocketCAN through a raw, non-blocking socket. A frame takes 1 microsecond; python-can takes 5 to 9."""

import asyncio
import errno
import socket
from collections.abc import Callable
from struct import Struct

from cylforce.can.bus import BURST, Bus, BusError
from cylforce.signals.events import Frame

_FRAME = Struct("=IB3x8s")  # struct can_frame
_ERROR_FILTER, _ERROR_MASK = 2, 0x1FFFFFFF  # CAN_RAW_ERR_FILTER, CAN_ERR_MASK: the socket module lacks them
_RECEIVE_BUFFER_FORCE, _MEMORY_INFO = 33, 55  # SO_RCVBUFFORCE, SO_MEMINFO
_BUFFER_BYTES = 4 << 20  # 5000 frames: a second of a full bus
_BUSY = {errno.ENOBUFS, errno.EAGAIN}


class SocketCan(Bus):
    """`socketcan:INTERFACE`. The interface may go down and up, or be removed and plugged in again."""

    def __init__(self, interface: str, now: Callable[[], int]) -> None:
        super().__init__(f"socketcan:{interface}")
        self._interface, self._now = interface, now
        self._socket: socket.socket | None = None
        self._overflow = 0
        try:
            self._open()
        except OSError as error:
            raise BusError(self._sentence(error)) from error

    def _sentence(self, error: OSError) -> str:
        if error.errno in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
            return f"{self.name}: this kernel has no SocketCAN; remote:127.0.0.1:PORT works without, on this computer"
        if error.errno == errno.ENODEV:
            return f"{self.name}: there is no such interface; `ip link show type can` lists those there are"
        return f"{self.name}: cannot be opened: {error}"

    def _open(self) -> None:
        opened = socket.socket(socket.AF_CAN, socket.SOCK_RAW | socket.SOCK_NONBLOCK, socket.CAN_RAW)
        try:
            opened.setsockopt(socket.SOL_CAN_RAW, _ERROR_FILTER, _ERROR_MASK)
            _enlarge(opened)
            opened.bind((self._interface,))
        except OSError:
            opened.close()
            raise
        self._socket = opened

    def _listen(self, loop: asyncio.AbstractEventLoop) -> None:
        if self._socket is not None:
            loop.add_reader(self._socket, self._drain, self._socket)

    def _shut(self) -> None:
        if self._socket is not None:
            self._overflow = self.overflow()
            if self._loop is not None:
                self._loop.remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def _drain(self, opened: socket.socket) -> None:
        t_us = self._now()
        for _ in range(BURST):
            try:
                can_id, length, data = _FRAME.unpack(opened.recv(_FRAME.size))
            except BlockingIOError:
                return
            except OSError:  # ENETDOWN, ENODEV
                self._lost()
                return
            self.counters.received += 1
            self._on_frame(Frame(t_us, can_id, data[:length]))
            if self._socket is not opened:  # a receiver of the frame has closed the bus
                return

    def send(self, can_id: int, data: bytes) -> bool:
        """See Bus.send."""
        if self._socket is None:
            return self._drop()
        try:
            self._socket.send(_FRAME.pack(can_id, len(data), data))
        except OSError as error:
            if error.errno not in _BUSY:
                self._lost()
            return self._drop()
        return self._sent(can_id, data)

    def overflow(self) -> int:
        """See Bus.overflow: the kernel's own count for this socket and those before it."""
        if self._socket is None:
            return self._overflow
        info = self._socket.getsockopt(socket.SOL_SOCKET, _MEMORY_INFO, 36)
        return self._overflow + int.from_bytes(info[32:36], "little")


def _enlarge(opened: socket.socket) -> None:
    """Ask for a larger receive buffer. Only root may exceed the system's limit; others get as much as it allows."""
    try:
        opened.setsockopt(socket.SOL_SOCKET, _RECEIVE_BUFFER_FORCE, _BUFFER_BYTES)
    except PermissionError:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
