"""SocketCAN through a raw, non-blocking socket. A frame takes 2 microseconds; python-can takes 5 to 9.

Each frame has the kernel's receive stamp (SO_TIMESTAMPNS), so that frames which wait while the loop is busy keep the
times at which they came.
"""

import asyncio
import errno
import socket
import time
from collections.abc import Callable, Iterable
from struct import Struct

from cylforce.can.bus import BURST, Bus, BusError, Filter
from cylforce.signals.events import Frame

_FRAME = Struct("=IB3x8s")  # struct can_frame
_FILTER, _ERROR_FILTER = 1, 2  # CAN_RAW_FILTER, CAN_RAW_ERR_FILTER
_ERROR_MASK = 0x145  # the error classes TX_TIMEOUT, CRTL, BUSOFF, RESTARTED; the others may come with every frame
_PAIR = Struct("=II")  # struct can_filter
_RECEIVE_BUFFER_FORCE, _MEMORY_INFO = 33, 55  # SO_RCVBUFFORCE, SO_MEMINFO
_BUFFER_BYTES = 4 << 20  # 5000 frames: a second of a full bus
_STAMP, _TIMESPEC = 35, Struct("@ll")  # SO_TIMESTAMPNS, which is SCM_TIMESTAMPNS too; struct timespec
_EXTRA = socket.CMSG_SPACE(_TIMESPEC.size)  # bytes of ancillary data with one stamp
_LONGEST_WAIT_US = 1_000_000  # an older stamp is not used: the wall clock was set meanwhile; chosen
_BUSY = {errno.ENOBUFS, errno.EAGAIN}  # the send queue is full: the bus itself works


class SocketCan(Bus):
    """The bus `socketcan:INTERFACE`. The interface may go down and up, or be removed and plugged in again.

    interface: name of the interface, e.g. can0
    now: clock that stamps the frames [us]
    """

    def __init__(self, interface: str, now: Callable[[], int]) -> None:
        super().__init__(f"socketcan:{interface}")
        self._interface, self._now = interface, now
        self._socket: socket.socket | None = None
        self._overflow = 0  # frames lost by the sockets that were closed
        try:
            self._open()
        except OSError as error:
            raise BusError(self._sentence(error)) from error

    def _sentence(self, error: OSError) -> str:
        """Return what is wrong and what to do when the bus cannot be opened."""
        if error.errno in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
            return f"{self.name}: this kernel has no SocketCAN; remote:127.0.0.1:PORT works without, on this computer"
        if error.errno == errno.ENODEV:
            return f"{self.name}: there is no such interface; `ip link show type can` lists those there are"
        return f"{self.name}: cannot be opened: {error}"

    def _open(self) -> None:
        """Open the socket, with error frames, receive stamps, a large buffer and the filters."""
        opened = socket.socket(socket.AF_CAN, socket.SOCK_RAW | socket.SOCK_NONBLOCK, socket.CAN_RAW)
        try:
            opened.setsockopt(socket.SOL_CAN_RAW, _ERROR_FILTER, _ERROR_MASK)
            opened.setsockopt(socket.SOL_SOCKET, _STAMP, 1)
            _enlarge(opened)
            self._install(opened)
            opened.bind((self._interface,))
        except OSError:
            opened.close()
            raise
        self._socket = opened

    def accept(self, filters: Iterable[Filter]) -> None:
        """Filter in the kernel, see `Bus.accept`. Raises BusError for more filters than it takes (512)."""
        super().accept(filters)
        if self._socket is not None:
            try:
                self._install(self._socket)
            except OSError as error:
                raise BusError(f"{self.name}: the kernel takes no {len(self._filters or ())} filters") from error

    def _install(self, opened: socket.socket) -> None:
        """Set the filters of `accept` in a socket; before `accept` the kernel passes every frame."""
        if self._filters is not None:
            opened.setsockopt(socket.SOL_CAN_RAW, _FILTER, b"".join(_PAIR.pack(*pair) for pair in self._filters))

    def _listen(self, loop: asyncio.AbstractEventLoop) -> None:
        if self._socket is not None:
            loop.add_reader(self._socket, self._drain, self._socket)

    def _shut(self) -> None:
        """Close the socket, and keep its count of lost frames."""
        if self._socket is not None:
            self._overflow = self.overflow()
            if self._loop is not None:
                self._loop.remove_reader(self._socket)
            self._socket.close()
            self._socket = None

    def _drain(self, opened: socket.socket) -> None:
        """Receive the frames that wait in the socket `opened`, at most BURST, with the times at which they came.

        When the interface fails, the bus is opened again later.
        """
        now_us, wall_ns = self._now(), time.time_ns()
        for _ in range(BURST):
            try:
                received, ancillary = opened.recvmsg(_FRAME.size, _EXTRA)[:2]
            except BlockingIOError:
                return
            except OSError:  # ENETDOWN, ENODEV
                self._lost()
                return
            self.counters.received += 1
            can_id, length, data = _FRAME.unpack(received)
            self._on_frame(Frame(now_us - waited_us(ancillary, wall_ns), can_id, data[:length]))
            if self._socket is not opened:  # a receiver of the frame has closed the bus
                return

    def send(self, can_id: int, data: bytes) -> bool:
        """Send a frame, see `Bus.send`; after an error other than a full queue the bus is opened again later."""
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
        """Return the kernel's own count for this socket and those before it, see `Bus.overflow`."""
        if self._socket is None:
            return self._overflow
        info = self._socket.getsockopt(socket.SOL_SOCKET, _MEMORY_INFO, 36)
        return self._overflow + int.from_bytes(info[32:36], "little")


def waited_us(ancillary: list[tuple[int, int, bytes]], wall_ns: int) -> int:
    """Return the time [us] since a frame was received; 0 without a valid stamp.

    A stamp is invalid when it lies in the future, or so far back that the wall clock was set since.

    ancillary: ancillary data of the frame
    wall_ns:   present wall clock [ns]
    """
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, _STAMP):
            seconds, nanoseconds = _TIMESPEC.unpack(data[: _TIMESPEC.size])
            waited = (wall_ns - seconds * 10**9 - nanoseconds) // 1000
            return waited if 0 <= waited < _LONGEST_WAIT_US else 0
    return 0


def _enlarge(opened: socket.socket) -> None:
    """Request a larger receive buffer. Only root may exceed the system's limit; others get as much as it allows."""
    try:
        opened.setsockopt(socket.SOL_SOCKET, _RECEIVE_BUFFER_FORCE, _BUFFER_BYTES)
    except PermissionError:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
