"""Access control: which objects of our node may be written over SDO, and when.

The operator's commands are always open. Supervision and communication parameters can be written while the node is
pre-operational, or unlocked by a code. Identifiers that belong to another node are always refused.
"""

from collections.abc import Callable, Collection
from enum import IntEnum

from canopen.sdo.exceptions import SdoAbortedError

from cylforce.canopen.dictionary.object_dictionary import LOCK_STATE, PROTECTION, SECONDS_LEFT
from cylforce.canopen.heartbeat import PRE_OPERATIONAL

STATE = 0x08000022  # abort code of CiA 301: not in the present device state
WRONG = 0x06090030  # abort code of CiA 301: invalid value
INCOMPATIBLE = 0x06040043  # abort code of CiA 301: general parameter incompatibility
TRIES, BLOCKED_US = 5, 30_000_000  # wrong codes in a row, after which every code is refused for so many us; chosen
OPEN_US = 600_000_000  # us after the last protected write until the lock closes by itself; chosen
SHORTEST_HEARTBEAT_MS = 10  # ms; a shorter one would fill the bus; chosen
_SUPERVISION = (0x1016, 0x1017)  # heartbeat consumer and producer
_IDENTIFIERS = 0x7FF  # bits of a COB-ID that are the identifier


class LockState(IntEnum):
    """States of the lock, the values of object 21A0h:2."""

    NO_CODE = 0
    LOCKED = 1
    UNLOCKED = 2
    BLOCKED = 3


def protected(index: int) -> bool:
    """Return whether an object is a parameter of supervision (1016h, 1017h) or of a PDO (1400h to 1BFFh)."""
    return index in _SUPERVISION or 0x1400 <= index < 0x1C00


class Access:
    """The lock of the protected objects. It reads no clock; `t_us` is the present time [us].

    code: code that unlocks; None: the lock cannot be opened
    taken: identifiers that no PDO of ours may have, because others send them
    report: called with a sentence when the lock opens, closes or refuses
    """

    def __init__(self, code: int | None, taken: Collection[int], report: Callable[[str], None]) -> None:
        self._code, self._taken, self._report = code, frozenset(taken), report
        self._until_us: int | None = None  # time at which the open lock closes by itself; None: closed
        self._wrong, self._blocked_us = 0, 0  # wrong codes in a row; time until which every code is refused

    def state(self, t_us: int) -> LockState:
        """Return the state of the lock (21A0h:2)."""
        if self._code is None:
            return LockState.NO_CODE
        if self._until_us is not None and t_us < self._until_us:
            return LockState.UNLOCKED
        return LockState.BLOCKED if t_us < self._blocked_us else LockState.LOCKED

    def read(self, index: int, sub: int, t_us: int) -> int | None:
        """Return the value of 21A0h:2 (state) or 21A0h:3 (seconds left); None for any other object.

        The seconds are those until the open lock closes by itself, or until codes are accepted again; else 0.
        """
        if index != PROTECTION or sub not in (LOCK_STATE, SECONDS_LEFT):
            return None
        state = self.state(t_us)
        if sub == LOCK_STATE:
            return int(state)
        until_us = self._until_us if state is LockState.UNLOCKED else self._blocked_us
        return max(0, ((until_us or 0) - t_us) // 1_000_000)

    def enter(self, code: int, t_us: int) -> None:
        """Open the lock for OPEN_US with a code, or close it with 0.

        Raises SdoAbortedError for a wrong code, and for every code where the lock has none (no lock file) or during
        BLOCKED_US after TRIES wrong codes in a row. An open lock stays open meanwhile.
        """
        if code == 0:
            self.close()
            return
        if self._code is None or t_us < self._blocked_us:
            raise SdoAbortedError(STATE)
        if code != self._code:
            self._wrong += 1
            self._report(f"wrong code, {self._wrong} in a row")
            if self._wrong >= TRIES:
                self._wrong, self._blocked_us = 0, t_us + BLOCKED_US
            raise SdoAbortedError(WRONG)
        self._wrong, self._until_us = 0, t_us + OPEN_US
        self._report("unlocked")

    def close(self) -> None:
        """Close the lock; report it if it was open."""
        if self._until_us is not None:
            self._until_us = None
            self._report("locked")

    def check(self, index: int, sub: int, value: int, nmt: int, t_us: int) -> None:
        """Raise SdoAbortedError where a value may not be written to a protected object now, or never.

        Now: the node is not pre-operational and the lock is not open. Never: a heartbeat below SHORTEST_HEARTBEAT_MS,
        an entry of 1016h with a node number above 127 or reserved bits, an identifier in `taken`. Other objects are not
        checked. A write that may be done keeps an open lock open for another OPEN_US.

        value: the value as an unsigned number
        nmt: NMT state of the node
        """
        if not protected(index):
            return
        if nmt != PRE_OPERATIONAL and self.state(t_us) is not LockState.UNLOCKED:
            self._report(f"write to {index:04X}h:{sub} refused: locked")
            raise SdoAbortedError(STATE)
        if index == 0x1017 and 0 < value < SHORTEST_HEARTBEAT_MS:
            raise SdoAbortedError(WRONG)
        if index == 0x1016 and (value >> 24 or value >> 16 & 0xFF > 0x7F):
            raise SdoAbortedError(WRONG)
        if 0x1800 <= index < 0x1A00 and sub == 1 and value & _IDENTIFIERS in self._taken:
            self._report(f"write to {index:04X}h:1 refused: identifier {value & _IDENTIFIERS:03X}h belongs to another")
            raise SdoAbortedError(INCOMPATIBLE)
        if self._until_us is not None:
            self._until_us = t_us + OPEN_US
