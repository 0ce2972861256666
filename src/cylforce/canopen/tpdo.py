"""A transmit PDO of a node: its parameters (1800h + n), its mapping (1A00h + n), its triggers and its data."""

from collections.abc import Callable
from typing import Protocol

from canopen.objectdictionary import ODVariable
from canopen.sdo.exceptions import SdoAbortedError

from cylforce.signals.identifiers import is_of_a_pdo

DISABLED, NO_REMOTE = 1 << 31, 1 << 30  # bits of a COB-ID
_CAN_ID = 0x3FFFFFFF  # the other bits of a COB-ID: identifier, and bit 29 for one of 29 bits

# Abort codes of CiA 301.
VALUE_RANGE = 0x06090030  # invalid value
NOT_MAPPABLE = 0x06040041  # object cannot be mapped to the PDO
TOO_LONG = 0x06040042  # number and length of the objects exceed the PDO
DEVICE_STATE = 0x08000022  # not in the present device state

_MOST = 8  # objects in a PDO: as many as it has bytes


class PdoOwner(Protocol):
    """The node that sends the PDO.

    data_store: bytes of every object, by index and sub-index
    send: sends a frame (identifier, data); returns False when it was dropped
    """

    data_store: dict[int, dict[int, bytes]]
    send: Callable[[int, bytes], bool]

    @property
    def operational(self) -> bool:
        """Return whether it may send PDOs."""
        ...

    def raw(self, index: int, sub: int) -> int:
        """Return the value of an object that is a number."""
        ...

    def variable(self, index: int, sub: int) -> ODVariable | None:
        """Return the description of an object; None if there is none."""
        ...


class Tpdo:
    """A TPDO, as the object dictionary of its node describes it now.

    node: the node that sends it
    number: number of the TPDO, from 1
    """

    def __init__(self, node: PdoOwner, number: int) -> None:
        self._node = node
        self._communication, self._mapping = 0x17FF + number, 0x19FF + number
        self._syncs = 0  # SYNCs since the last one after which it was sent
        self._sent: bytes | None = None  # data that were sent last
        self._due_us: int | None = None  # time at which the event timer sends it; None: stopped
        self.reload()

    def reload(self) -> None:
        """Read the parameters from the object dictionary again; the event timer begins anew."""
        raw, index = self._node.raw, self._communication
        self._cob_id, self._type = raw(index, 1), raw(index, 2)
        self._event_us = 1000 * raw(index, 5)
        entries = [raw(self._mapping, sub) for sub in range(1, raw(self._mapping, 0) + 1)]
        self._objects = [(entry >> 16, entry >> 8 & 0xFF) for entry in entries]
        self._due_us = None

    @property
    def event_driven(self) -> bool:
        """Return whether it is sent on events, not on SYNC."""
        return self._type > 240

    def data(self) -> bytes:
        """Return the bytes of the mapped objects."""
        store = self._node.data_store
        return b"".join([store[index][sub] for index, sub in self._objects])

    def send(self) -> bool:
        """Send now, if the node is operational and the PDO enabled; return whether it was sent."""
        if not self._node.operational or self._cob_id & DISABLED:
            return False
        self._sent = self.data()
        return self._node.send(self._cob_id & 0x7FF, self._sent)

    def on_sync(self) -> None:
        """Send after a SYNC, by the transmission type: n: after every n-th SYNC, 0: if the data have changed.

        Changed data differ from those sent last. An event-driven PDO is not sent.
        """
        if self.event_driven:
            return
        self._syncs += 1
        if (self._type == 0 and self.data() != self._sent) or 0 < self._type <= self._syncs:
            self._syncs = 0
            self.send()

    def poll(self, t_us: int) -> None:
        """Send an event-driven PDO when its event timer has expired at the time `t_us` [us].

        Missed periods are skipped. The timer begins with the first poll in which the node is operational.
        """
        if not self._event_us or not self.event_driven or not self._node.operational:
            self._due_us = None
        elif self._due_us is None:
            self._due_us = t_us + self._event_us
        elif t_us >= self._due_us:
            self._due_us += self._event_us * ((t_us - self._due_us) // self._event_us + 1)
            self.send()

    def check(self, index: int, sub: int, value: int) -> None:
        """Raise SdoAbortedError for a write that CiA 301 does not allow, or not in the present state.

        index: of the communication or mapping parameters of this TPDO
        sub: sub-index
        value: number to be written
        """
        if index == self._communication:
            if sub == 1:
                self._check_cob_id(value)
            if sub == 2 and 240 < value < 254:
                raise SdoAbortedError(VALUE_RANGE)
        else:
            self._check_mapping(sub, value)

    def _check_cob_id(self, value: int) -> None:
        """Raise SdoAbortedError for an identifier that no PDO may have, or a new one while the PDO stays enabled.

        value: COB-ID to be written, with the bits DISABLED and NO_REMOTE
        """
        can_id = value & _CAN_ID
        if not is_of_a_pdo(can_id):
            raise SdoAbortedError(VALUE_RANGE)
        if not (self._cob_id | value) & DISABLED and can_id != self._cob_id & _CAN_ID:
            raise SdoAbortedError(DEVICE_STATE)

    def _check_mapping(self, sub: int, value: int) -> None:
        """Raise SdoAbortedError for a mapping of more than 8 bytes, or a new one while the PDO is enabled.

        Entries can change only while the number of entries is 0.

        sub: sub-index; 0: number of entries, others: an entry
        value: number, or entry: index in bits 16 to 31, sub-index in bits 8 to 15, length [bits] in bits 0 to 7
        """
        if not self._cob_id & DISABLED or (sub and self._node.raw(self._mapping, 0)):
            raise SdoAbortedError(DEVICE_STATE)
        if sub:
            self._check_mapped(value)
            return
        if value > _MOST:
            raise SdoAbortedError(TOO_LONG)
        entries = [self._node.raw(self._mapping, k) for k in range(1, value + 1)]
        for entry in entries:
            self._check_mapped(entry)
        if sum(entry & 0xFF for entry in entries) > 64:
            raise SdoAbortedError(TOO_LONG)

    def _check_mapped(self, entry: int) -> None:
        """Raise SdoAbortedError unless the object of an entry exists, may be mapped, and has the entry's length."""
        variable = self._node.variable(entry >> 16, entry >> 8 & 0xFF)
        if variable is None or not variable.pdo_mappable or len(variable) != entry & 0xFF:
            raise SdoAbortedError(NOT_MAPPABLE)
