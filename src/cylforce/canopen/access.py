"""Who may write what over SDO. The operator's commands are always open; supervision and communication parameters can be
written while the node is pre-operational, or unlocked by a code. Identifiers that belong to somebody else are refused
always."""

from collections.abc import Callable, Collection
from enum import IntEnum

from canopen.sdo.exceptions import SdoAbortedError

from cylforce.canopen.dictionary.object_dictionary import LOCK_STATE, PROTECTION, SECONDS_LEFT
from cylforce.canopen.heartbeat import PRE_OPERATIONAL

STATE = 0x08000022  # abort code: not in the present state
WRONG = 0x06090030  # abort code: invalid value
INCOMPATIBLE = 0x06040043  # abort code: general parameter incompatibility
TRIES, BLOCKED_US = 5, 30_000_000  # wrong codes in a row, and for how long no other is looked at then; chosen
OPEN_US = 600_000_000  # after the last protected write, until the lock closes by itself; chosen
SHORTEST_HEARTBEAT_MS = 10  # a shorter one would fill the bus
_SUPERVISION = (0x1016, 0x1017)
_IDENTIFIERS = 0x7FF


class LockState(IntEnum):
    """Values of 21A0h:2."""

    NO_CODE = 0
    LOCKED = 1
    UNLOCKED = 2
    BLOCKED = 3


def protected(index: int) -> bool:
    """Whether an object is a parameter of supervision or communication."""
    return index in _SUPERVISION or 0x1400 <= index < 0x1C00


class Access:
    """The lock, with `code` (None: there is none, then nothing can be unlocked), and `taken`: identifiers that no PDO
    of ours may have. `tell(words)` is called for what an owner wants to know. Time is an argument."""

    def __init__(self, code: int | None, taken: Collection[int], tell: Callable[[str], None]) -> None:
        self._code, self._taken, self._tell = code, frozenset(taken), tell
        self._until_us: int | None = None
        self._wrong, self._blocked_us = 0, 0

    def state(self, t_us: int) -> LockState:
        """What 21A0h:2 says."""
        if self._code is None:
            return LockState.NO_CODE
        if self._until_us is not None and t_us < self._until_us:
            return LockState.UNLOCKED
        return LockState.BLOCKED if t_us < self._blocked_us else LockState.LOCKED

    def read(self, index: int, sub: int, t_us: int) -> int | None:
        """The value of an object of the lock; None for any other."""
        if index != PROTECTION or sub not in (LOCK_STATE, SECONDS_LEFT):
            return None
        state = self.state(t_us)
        if sub == LOCK_STATE:
            return int(state)
        until_us = self._until_us if state is LockState.UNLOCKED else self._blocked_us
        return max(0, ((until_us or 0) - t_us) // 1_000_000)

    def enter(self, code: int, t_us: int) -> None:
        """A code was written: 0 closes the lock. Raises SdoAbortedError for a wrong one, and while none is looked
        at."""
        if code == 0:
            self.close()
            return
        if self._code is None or t_us < self._blocked_us:
            raise SdoAbortedError(STATE)
        if code != self._code:
            self._wrong += 1
            self._tell(f"wrong code, {self._wrong} in a row")
            if self._wrong >= TRIES:
                self._wrong, self._blocked_us = 0, t_us + BLOCKED_US
            raise SdoAbortedError(WRONG)
        self._wrong, self._until_us = 0, t_us + OPEN_US
        self._tell("unlocked")

    def close(self) -> None:
        """Lock again."""
        if self._until_us is not None:
            self._until_us = None
            self._tell("locked")

    def check(self, index: int, sub: int, value: int, nmt: int, t_us: int) -> None:
        """Raises SdoAbortedError where a value may not be written now, or never."""
        if not protected(index):
            return
        if nmt != PRE_OPERATIONAL and self.state(t_us) is not LockState.UNLOCKED:
            self._tell(f"write to {index:04X}h:{sub} refused: locked")
            raise SdoAbortedError(STATE)
        if index == 0x1017 and 0 < value < SHORTEST_HEARTBEAT_MS:
            raise SdoAbortedError(WRONG)
        if index == 0x1016 and (value >> 24 or value >> 16 & 0xFF > 0x7F):
            raise SdoAbortedError(WRONG)
        if 0x1800 <= index < 0x1A00 and sub == 1 and value & _IDENTIFIERS in self._taken:
            self._tell(f"write to {index:04X}h:1 refused: identifier {value & _IDENTIFIERS:03X}h belongs to another")
            raise SdoAbortedError(INCOMPATIBLE)
        if self._until_us is not None:
            self._until_us = t_us + OPEN_US
