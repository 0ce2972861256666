"""Emergency messages, error register (1001h) and the list of past errors (1003h)."""

from collections import deque
from collections.abc import Callable
from struct import Struct

_EMCY = Struct("<HB5s")
_GENERIC = 0x01
_ACTIVE = 64  # errors at a time; further ones are not stored, so that memory is limited

HISTORY = 8  # entries of 1003h


class Emergencies:
    """The present and past errors of a node. `send(data)` sends an EMCY message, False: the bus cannot take it now, so
    that it is sent with the next `flush`; `store(index, sub, value)` writes into the object dictionary."""

    def __init__(self, send: Callable[[bytes], bool], store: Callable[[int, int, int], None]) -> None:
        self._send, self._store = send, store
        self._waiting: deque[bytes] = deque(maxlen=_ACTIVE)
        self._active: dict[int, int] = {}
        self._history: list[int] = []

    @property
    def register(self) -> int:
        """1001h: bit 0 whenever there is an error, and the bits of the kinds of those there are."""
        bits = _GENERIC if self._active else 0
        for bit in self._active.values():
            bits |= bit
        return bits

    def occur(self, code: int, bit: int = 0, info: bytes = b"") -> bool:
        """An error has occurred: code of CiA 301 or FFxxh, its bit in 1001h, up to 5 bytes of information.
        Sent once until it is repaired; False if it was present already."""
        if code in self._active or len(self._active) >= _ACTIVE:
            return False
        self._active[code] = bit
        self._history = [code | int.from_bytes(info[:2], "little") << 16, *self._history][:HISTORY]
        self._mirror()
        self._say(_EMCY.pack(code, self.register, info[:5]))
        return True

    def repair(self, code: int) -> bool:
        """An error is repaired; False if there was none."""
        if self._active.pop(code, None) is None:
            return False
        self._mirror()
        self._say(_EMCY.pack(0, self.register, b""))
        return True

    def flush(self) -> None:
        """Send what the bus could not take, in order; of a long time without bus the last ones."""
        while self._waiting and self._send(self._waiting[0]):
            self._waiting.popleft()

    def _say(self, data: bytes) -> None:
        self._waiting.append(data)
        self.flush()

    def clear(self) -> None:
        """Clear the list of past errors (0 written to 1003h:0); present errors stay."""
        self._history = []
        self._mirror()

    def _mirror(self) -> None:
        self._store(0x1001, 0, self.register)
        self._store(0x1003, 0, len(self._history))
        for sub in range(1, HISTORY + 1):
            self._store(0x1003, sub, self._history[sub - 1] if sub <= len(self._history) else 0)
