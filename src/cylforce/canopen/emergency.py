"""Emergency messages, error register (1001h) and the list of past errors (1003h)."""

from collections import deque
from collections.abc import Callable
from struct import Struct

_EMCY = Struct("<HB5s")  # error code, error register, 5 bytes of information
_GENERIC = 0x01  # bit of 1001h that is set with every error
_MOST = 64  # present errors, and messages that wait for the bus; a limit, so that memory is limited; chosen

HISTORY = 8  # entries of 1003h


class Emergencies:
    """The present and past errors of a node.

    active: the present errors: EMCY code -> mask of its bit in the error register (1001h)
    send: sends the 8 bytes of an EMCY message; returns False when the bus cannot take it now, then `flush` sends it
    store: writes a value (index, sub-index, value) into the object dictionary
    """

    def __init__(self, send: Callable[[bytes], bool], store: Callable[[int, int, int], None]) -> None:
        self._send, self._store = send, store
        self._waiting: deque[bytes] = deque(maxlen=_MOST)  # messages not yet sent, oldest first
        self.active: dict[int, int] = {}
        self._history: list[int] = []  # entries of 1003h, newest first: EMCY code, in bits 16 to 31 two bytes of `info`

    @property
    def register(self) -> int:
        """Return the error register 1001h: bit 0 whenever there is an error, and the bits of the present kinds."""
        bits = _GENERIC if self.active else 0
        for bit in self.active.values():
            bits |= bit
        return bits

    def occur(self, code: int, bit: int = 0, info: bytes = b"") -> bool:
        """Report an error once until it is repaired; return False if it was present already, or _MOST others are.

        It is entered into 1001h and 1003h, and an EMCY message is sent.

        code: error code of CiA 301 or FFxxh
        bit: mask of the bit of 1001h that the error sets, such as 10h (communication); 0: only bit 0, set by every one
        info: up to 5 bytes of information
        """
        if code in self.active or len(self.active) >= _MOST:
            return False
        self.active[code] = bit
        self._history = [code | int.from_bytes(info[:2], "little") << 16, *self._history][:HISTORY]
        self._mirror()
        self._queue(_EMCY.pack(code, self.register, info[:5]))
        return True

    def repair(self, code: int) -> bool:
        """Report that the error with an EMCY code is repaired; return False if it was not present.

        An EMCY message is sent, with code 0 and the register of the errors that remain; 1003h keeps the error.
        """
        if self.active.pop(code, None) is None:
            return False
        self._mirror()
        self._queue(_EMCY.pack(0, self.register, b""))
        return True

    def flush(self) -> None:
        """Send the messages that the bus could not take, oldest first; after a long time without bus only the last
        _MOST ones.
        """
        while self._waiting and self._send(self._waiting[0]):
            self._waiting.popleft()

    def _queue(self, data: bytes) -> None:
        """Send a message after those that still wait."""
        self._waiting.append(data)
        self.flush()

    def clear(self) -> None:
        """Clear the list of past errors (0 written to 1003h:0); present errors stay."""
        self._history = []
        self._mirror()

    def _mirror(self) -> None:
        """Write register and history into the object dictionary."""
        self._store(0x1001, 0, self.register)
        self._store(0x1003, 0, len(self._history))
        for sub in range(1, HISTORY + 1):
            self._store(0x1003, sub, self._history[sub - 1] if sub <= len(self._history) else 0)
