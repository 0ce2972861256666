"""canopen's SDO server for clients with errors: every request is answered, and a transfer's memory is
limited.
"""

from struct import Struct
from typing import Protocol

from canopen.sdo import server
from canopen.sdo.exceptions import SdoAbortedError

from cylforce.signals.identifiers import SDO_REQUEST, SDO_RESPONSE

# Abort codes of CiA 301.
TOGGLE = 0x05030000  # toggle bit not alternated
TIMEOUT = 0x05040000  # protocol timed out
COMMAND = 0x05040001  # command specifier not valid or unknown
MEMORY = 0x05040005  # out of memory
LENGTH = 0x06070010  # length of the service parameter does not match
NOT_STORED = 0x08000020  # data cannot be transferred or stored

_LARGEST = 1024  # bytes of one transfer: no object of ours is longer; chosen
_PATIENCE_US = 1_000_000  # us, longest time between two segments; chosen
_HEAD = Struct("<BHB")  # command, index, sub-index


class SdoOwner(Protocol):
    """The node whose objects are read and written."""

    @property
    def node_id(self) -> int:
        """Return the node number, 1 to 127."""
        ...

    @property
    def answers(self) -> bool:
        """Return whether SDO works in the node's present NMT state."""
        ...

    @property
    def t_us(self) -> int:
        """Return the present time [us]."""
        ...

    def download(self, index: int, sub: int, data: bytes, length: int | None) -> None:
        """Write an object, or raise SdoAbortedError."""
        ...

    def check_segmented(self, index: int, sub: int) -> None:
        """Raise SdoAbortedError where a segmented download is not allowed."""
        ...


class SdoServer(server.SdoServer):
    """SDO server with expedited and segmented transfers; block transfers are refused, as CiA 301 allows a server.

    node: the node whose objects are read and written
    """

    def __init__(self, node: SdoOwner) -> None:
        super().__init__(SDO_REQUEST + node.node_id, SDO_RESPONSE + node.node_id, node)
        self._owner = node
        self._index = self._subindex = self._toggle = 0
        self._at = (0, 0)  # index and sub-index of the transfer
        self._buffer: bytearray | None = None  # bytes of a segmented transfer; None: none is in progress
        self._size: int | None = None  # announced length of a download; None: not announced
        self._download = False  # direction of the segmented transfer
        self._last_us = 0  # time of its last request [us]

    def on_request(self, can_id: int, data: bytearray, timestamp: float) -> None:
        """Answer one request, with an abort where it is refused. A client's abort ends the transfer.

        A node in a state without SDO does not answer, and drops the transfer.
        """
        if not self._owner.answers or (data and data[0] & 0xE0 == 0x80):
            self._buffer = None  # stopped, or the client has aborted
            return
        try:
            self._answer(data)
        except SdoAbortedError as error:
            self._buffer = None
            self.abort(error.code)

    def _answer(self, data: bytearray) -> None:
        """Answer a request by its command specifier. Raises SdoAbortedError.

        data: of the request; a client's abort has been handled by `on_request`
        """
        if len(data) != 8:
            raise SdoAbortedError(COMMAND)
        if data[0] & 0xE0 in (0x20, 0x40):
            self._buffer = None
            index, sub = _HEAD.unpack_from(data)[1:]
            self._at = (index, sub)
            self._index, self._subindex = index, sub
            begin = self.init_upload if data[0] & 0xE0 == 0x40 else self.init_download
            begin(data)
            self._last_us = self._owner.t_us
        elif data[0] & 0xE0 in (0x00, 0x60):
            self._segment(data)
        else:
            raise SdoAbortedError(COMMAND)

    def init_upload(self, request: bytearray) -> None:
        """Begin an upload as canopen's server does, and store its direction."""
        self._download = False
        super().init_upload(request)

    def init_download(self, request: bytearray) -> None:
        """Write the object of an expedited download, or begin a segmented one, and send the response.

        Raises SdoAbortedError where the object cannot be written (of a segmented download: before its data arrive), or
        more than _LARGEST bytes are announced.
        """
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
        """Continue a segmented transfer.

        Raises SdoAbortedError for a segment that belongs to no transfer, comes more than _PATIENCE_US after the last
        one, or has the wrong toggle bit; also as `_append` does.
        """
        download = data[0] & 0xE0 == 0x00
        if self._buffer is None or download != self._download:
            raise SdoAbortedError(COMMAND)
        if self._owner.t_us - self._last_us > _PATIENCE_US:
            raise SdoAbortedError(TIMEOUT)
        if data[0] & 0x10 != self._toggle:
            raise SdoAbortedError(TOGGLE)
        self._last_us = self._owner.t_us
        if download:
            self._append(self._buffer, data)
        else:
            self.segmented_upload(data[0])
            self._buffer = self._buffer or None

    def _append(self, buffer: bytearray, request: bytearray) -> None:
        """Append one segment of a download to `buffer`, and send the response; after the last one write the object.

        Raises SdoAbortedError when the whole has another length than announced, or unannounced more than _LARGEST
        bytes, and where the object cannot be written.
        """
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
