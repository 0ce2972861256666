"""canopen's SDO server for clients that may be faulty: every request is answered, and a transfer's memory is
limited."""

from struct import Struct
from typing import Protocol

from canopen.sdo import server
from canopen.sdo.exceptions import SdoAbortedError

TOGGLE = 0x05030000
TIMEOUT = 0x05040000
COMMAND = 0x05040001
MEMORY = 0x05040005
LENGTH = 0x06070010
NOT_STORED = 0x08000020

_LARGEST = 1024  # bytes of one transfer
_PATIENCE_US = 1_000_000  # between two segments
_HEAD = Struct("<BHB")


class SdoOwner(Protocol):
    """The node whose objects are read and written."""

    @property
    def node_id(self) -> int:
        """1 to 127."""
        ...

    @property
    def answers(self) -> bool:
        """Whether SDO works in its present NMT state."""
        ...

    @property
    def t_us(self) -> int:
        """The time [us]."""
        ...

    def download(self, index: int, sub: int, data: bytes, length: int | None) -> None:
        """Write an object, or raise SdoAbortedError."""
        ...

    def check_segmented(self, index: int, sub: int) -> None:
        """Raise SdoAbortedError where nothing can be written."""
        ...


class SdoServer(server.SdoServer):
    """Expedited and segmented transfers; block transfers are refused, as CiA 301 lets a server."""

    def __init__(self, node: SdoOwner) -> None:
        super().__init__(0x600 + node.node_id, 0x580 + node.node_id, node)
        self._owner = node
        self._index = self._subindex = self._toggle = 0
        self._at = (0, 0)
        self._buffer: bytearray | None = None
        self._size: int | None = None
        self._download = False
        self._last_us = 0

    def on_request(self, can_id: int, data: bytearray, timestamp: float) -> None:
        """Answer one request; while the node is stopped there is no SDO."""
        if not self._owner.answers or (data and data[0] & 0xE0 == 0x80):
            self._buffer = None  # stopped, or the client has given up
            return
        try:
            self._answer(data)
        except SdoAbortedError as error:
            self._buffer = None
            self.abort(error.code)

    def _answer(self, data: bytearray) -> None:
        if len(data) != 8:
            raise SdoAbortedError(COMMAND)
        if data[0] & 0xE0 in (0x20, 0x40):
            self._buffer = None
            _, *at = _HEAD.unpack_from(data)
            self._at = self._index, self._subindex = (at[0], at[1])
            begin = self.init_upload if data[0] & 0xE0 == 0x40 else self.init_download
            begin(data)
            self._last_us = self._owner.t_us
        elif data[0] & 0xE0 in (0x00, 0x60):
            self._segment(data)
        else:
            raise SdoAbortedError(COMMAND)

    def init_upload(self, request: bytearray) -> None:
        """See canopen; remembers which way the data go."""
        self._download = False
        super().init_upload(request)

    def init_download(self, request: bytearray) -> None:
        """Initiate a download; what cannot be written is refused before its data come."""
        command = request[0]
        size = int.from_bytes(request[4:8], "little") if command & 1 else None
        if command & 2:
            length = 4 - (command >> 2 & 3) if command & 1 else None
            self._owner.download(*self._at, bytes(request[4:8]), length)
        else:
            self._owner.check_segmented(*self._at)
            if size is not None and size > _LARGEST:
                raise SdoAbortedError(MEMORY)
            self._buffer, self._size, self._toggle, self._download = bytearray(), size, 0, True
        self.send_response(_HEAD.pack(0x60, *self._at) + bytes(4))

    def _segment(self, data: bytearray) -> None:
        download = data[0] & 0xE0 == 0x00
        if self._buffer is None or download != self._download:
            raise SdoAbortedError(COMMAND)
        if self._owner.t_us - self._last_us > _PATIENCE_US:
            raise SdoAbortedError(TIMEOUT)
        if data[0] & 0x10 != self._toggle:
            raise SdoAbortedError(TOGGLE)
        self._last_us = self._owner.t_us
        if download:
            self._take(self._buffer, data)
        else:
            self.segmented_upload(data[0])
            self._buffer = self._buffer or None

    def _take(self, buffer: bytearray, request: bytearray) -> None:
        """Append one segment of a download; after the last one write the whole to the object. Raises SdoAbortedError
        when it has another length than announced, or more than _LARGEST bytes."""
        buffer += request[1 : 8 - (request[0] >> 1 & 7)]
        if len(buffer) > (_LARGEST if self._size is None else self._size):
            raise SdoAbortedError(MEMORY if self._size is None else LENGTH)
        response = bytes([0x20 | self._toggle]) + bytes(7)
        self._toggle ^= 0x10
        if request[0] & 1:
            self._buffer = None
            if self._size not in (None, len(buffer)):
                raise SdoAbortedError(LENGTH)
            self._owner.download(*self._at, bytes(buffer), len(buffer))
        self.send_response(response)
