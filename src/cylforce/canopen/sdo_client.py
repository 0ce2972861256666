"""An SDO client on the event loop: expedited and segmented transfers, one at a time for each server; nothing blocks."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from struct import Struct, pack, unpack
from typing import TypeVar

from canopen.sdo.exceptions import SdoAbortedError

from cylforce.canopen.network import Network
from cylforce.signals.identifiers import SDO_REQUEST, SDO_RESPONSE
from cylforce.signals.layout import CODES

TIMEOUT_S = 0.5  # s without an answer; chosen
LARGEST = 65536  # bytes of an upload; no object that is read here is longer; chosen

_WAITING = 16  # answers not yet processed, at most; chosen
_PARTS = 10  # parts of the time limit, counted one by one, see `Client`; chosen
_HEAD = Struct("<BHB")  # command, index, sub-index
_TOGGLE, _TIMED_OUT, _MEMORY = 0x05030000, 0x05040000, 0x05040005  # abort codes of CiA 301
_Result = TypeVar("_Result")


class SdoError(Exception):
    """A transfer that failed; the text is a sentence."""


class NoAnswerError(SdoError):
    """The server does not answer."""


class AbortedError(SdoError):
    """The server or this client aborted the transfer.

    code: abort code of CiA 301
    """

    def __init__(self, where: str, code: int) -> None:
        super().__init__(f"{where}: {SdoAbortedError.CODES.get(code, 'aborted')} (SDO abort {code:08X}h)")
        self.code = code


class Client:
    """Client of the default SDO of one node. Close it when it is no longer needed.

    All transfers raise AbortedError, or NoAnswerError after the time limit without an answer. Several tasks may call
    them at once and then take turns. The time limit is counted in short intervals, so that it does not run while this
    program itself cannot run. An answer that waits in the socket is then still processed.

    network: network on which the node is
    node_id: number of the node
    timeout_s: time limit of an answer [s]
    """

    def __init__(self, network: Network, node_id: int, timeout_s: float = TIMEOUT_S) -> None:
        self._network, self._node_id, self._timeout_s = network, node_id, timeout_s
        self._turn = asyncio.Lock()
        self._answers: asyncio.Queue[bytes] = asyncio.Queue(_WAITING)
        network.subscribe(SDO_RESPONSE + node_id, self._on_answer)

    def close(self) -> None:
        """Receive no more answers."""
        self._network.unsubscribe(SDO_RESPONSE + self._node_id, self._on_answer)

    async def upload(self, index: int, sub: int) -> bytes:
        """Read an object of the node: its bytes as sent."""
        return await self._transfer(index, sub, self._upload)

    async def download(self, index: int, sub: int, data: bytes) -> None:
        """Write the bytes of an object of the node."""
        await self._transfer(index, sub, lambda index, sub: self._download(index, sub, data))

    async def read(self, index: int, sub: int, code: str) -> int:
        """Read an integer object of a struct code, such as "H". Raises SdoError also when it has another length."""
        data = await self.upload(index, sub)
        if len(data) != CODES[code]:
            raise SdoError(f"{self._where(index, sub)} has {len(data)} bytes, {CODES[code]} were expected")
        return int(unpack(f"<{code}", data)[0])

    async def write(self, index: int, sub: int, code: str, value: float) -> None:
        """Write a number object of a struct code, such as "H"; raw, not scaled."""
        await self.download(index, sub, pack(f"<{code}", value))

    def _where(self, index: int, sub: int) -> str:
        return f"object {index:04X}h:{sub} of node {self._node_id}"

    async def _transfer(self, index: int, sub: int, transfer: Callable[[int, int], Awaitable[_Result]]) -> _Result:
        """Run a transfer after those of other tasks, and return its result.

        Raises AbortedError, or NoAnswerError after the server was sent an abort.

        transfer: function of index and sub-index that may raise SdoAbortedError or TimeoutError
        """
        async with self._turn:
            try:
                return await transfer(index, sub)
            except SdoAbortedError as error:
                raise AbortedError(self._where(index, sub), error.code) from None
            except TimeoutError:
                self._abort(index, sub, _TIMED_OUT)
                raise NoAnswerError(f"{self._where(index, sub)}: no answer") from None

    async def _upload(self, index: int, sub: int) -> bytes:
        """Read an object, expedited or in segments; abort a transfer of more than LARGEST bytes.

        Raises SdoAbortedError or TimeoutError.
        """
        answer = await self._request(_HEAD.pack(0x40, index, sub) + bytes(4), 0x40)
        if answer[0] & 2:
            return answer[4 : 8 - (answer[0] >> 2 & 3) if answer[0] & 1 else 8]
        data, toggle = b"", 0
        while len(data) <= LARGEST:
            answer = await self._request(bytes([0x60 | toggle]) + bytes(7), 0x00)
            self._check_toggle(answer, toggle, index, sub)
            data += answer[1 : 8 - (answer[0] >> 1 & 7)]
            if answer[0] & 1:
                return data
            toggle ^= 0x10
        self._abort(index, sub, _MEMORY)
        raise SdoAbortedError(_MEMORY)

    async def _download(self, index: int, sub: int, data: bytes) -> None:
        """Write an object, expedited for one to four bytes, else in segments.

        Raises SdoAbortedError or TimeoutError.
        """
        if 0 < len(data) <= 4:
            command = 0x23 | (4 - len(data)) << 2
            await self._request(_HEAD.pack(command, index, sub) + data.ljust(4, b"\0"), 0x60)
            return
        await self._request(_HEAD.pack(0x21, index, sub) + pack("<I", len(data)), 0x60)
        toggle = 0
        for at in range(0, max(len(data), 1), 7):
            part, last = data[at : at + 7], at + 7 >= len(data)
            request = bytes([toggle | (7 - len(part)) << 1 | last]) + part.ljust(7, b"\0")
            self._check_toggle(await self._request(request, 0x20), toggle, index, sub)
            toggle ^= 0x10

    def _check_toggle(self, answer: bytes, toggle: int, index: int, sub: int) -> None:
        """Abort a segmented transfer, and raise SdoAbortedError, where the answer has the wrong toggle bit.

        toggle: the expected bit 10h of the answer's first byte, 10h or 0
        """
        if answer[0] & 0x10 != toggle:
            self._abort(index, sub, _TOGGLE)
            raise SdoAbortedError(_TOGGLE)

    async def _request(self, request: bytes, expected: int) -> bytes:
        """Send a request and return the 8 bytes of its answer; answers to other requests are ignored.

        Raises TimeoutError after the time limit without an answer, SdoAbortedError when the server aborts.

        request: its 8 bytes
        expected: command specifier of the answer, bits E0h of its first byte
        """
        while not self._answers.empty():
            self._answers.get_nowait()
        self._network.send(SDO_REQUEST + self._node_id, request)
        for _ in range(_PARTS):
            with suppress(TimeoutError):
                async with asyncio.timeout(self._timeout_s / _PARTS):
                    return await self._answer(request, expected)
        raise TimeoutError

    async def _answer(self, request: bytes, expected: int) -> bytes:
        """Wait for the answer to a request and return its 8 bytes. Raises SdoAbortedError when the server aborts.

        An answer about another object, or with another command specifier than `expected`, is ignored.
        """
        while True:
            answer = await self._answers.get()
            if request[0] & 0xE0 in (0x20, 0x40) and answer[1:4] != request[1:4]:
                continue
            if answer[0] == 0x80:
                raise SdoAbortedError(int.from_bytes(answer[4:8], "little"))
            if answer[0] & 0xE0 == expected:
                return answer

    def _on_answer(self, can_id: int, data: bytearray, timestamp: float) -> None:
        """Queue an answer of 8 bytes; ignore it while no transfer runs, or _WAITING answers wait."""
        if len(data) == 8 and self._turn.locked() and not self._answers.full():
            self._answers.put_nowait(bytes(data))

    def _abort(self, index: int, sub: int, code: int) -> None:
        """Send the server an abort of a transfer; `code`: abort code of CiA 301."""
        self._network.send(SDO_REQUEST + self._node_id, _HEAD.pack(0x80, index, sub) + pack("<I", code))
