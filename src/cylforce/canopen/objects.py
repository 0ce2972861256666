"""The object dictionary of a device at run time: canopen's LocalNode, with limits, lengths and commands."""

from collections.abc import Callable
from math import isfinite
from typing import NamedTuple

import canopen
from canopen.objectdictionary import ObjectDictionary, ODVariable
from canopen.objectdictionary.datatypes import NUMBER_TYPES
from canopen.sdo.exceptions import SdoAbortedError

from cylforce.canopen.sdo_server import LENGTH, NOT_STORED

NO_SUB = 0x06090011
READ_ONLY = 0x06010002
RANGE, TOO_HIGH, TOO_LOW = 0x06090030, 0x06090031, 0x06090032


class Commands(NamedTuple):
    """Objects (index, sub-index) that are commands: writing them stores nothing. `verdict()` is the service's decision
    on the last one: None or 0 (done), or the abort code with which to refuse it. The service gets each frame before the
    node does."""

    objects: frozenset[tuple[int, int]]
    verdict: Callable[[], int | None]


def _done() -> None:
    """There are no commands, so none is refused."""


NO_COMMANDS = Commands(frozenset(), _done)


class Objects(canopen.LocalNode):
    """Every object of `dictionary` with its value as bytes in `data_store[index][sub]`."""

    def __init__(self, node_id: int, dictionary: ObjectDictionary, commands: Commands) -> None:
        super().__init__(node_id, dictionary)
        self.node_id = node_id
        self._commands = commands
        self.restore(0x1000, 0x10000)

    def restore(self, first: int, end: int) -> None:
        """Default values again for the indices first <= index < end."""
        for index in self.object_dictionary:
            if first <= index < end:
                found = self.object_dictionary[index]
                members = (found,) if isinstance(found, ODVariable) else tuple(found.values())
                self.data_store[index] = {member.subindex: _default(member) for member in members}

    def variable(self, index: int, sub: int) -> ODVariable | None:
        """The description of an object, None if there is none."""
        try:
            return self._find_object(index, sub)
        except SdoAbortedError:
            return None

    def _find_object(self, index: int, subindex: int) -> ODVariable:
        found: ODVariable = super()._find_object(index, subindex)
        if found.subindex != subindex:  # a single variable has no other sub-index than 0
            raise SdoAbortedError(NO_SUB)
        return found

    def raw(self, index: int, sub: int) -> int:
        """An object's bytes as an unsigned number."""
        return int.from_bytes(self.data_store[index][sub], "little")

    def set_value(self, index: int, sub: int, value: float | str) -> None:
        """Set an object from inside the device: read-only objects too, and without limits."""
        self.set_data(index, sub, self._find_object(index, sub).encode_raw(value))

    def download(self, index: int, sub: int, data: bytes, length: int | None) -> None:
        """An SDO client writes `data`, of which `length` bytes count (None: it did not say). Raises
        SdoAbortedError."""
        variable = self._find_object(index, sub)
        if not variable.writable:
            raise SdoAbortedError(READ_ONLY)
        if variable.fixed_size:
            size = len(variable) // 8
            if length not in (None, size):
                raise SdoAbortedError(LENGTH)
            length = size
        if (index, sub) in self._commands.objects:
            refusal = self._commands.verdict()
            if refusal:
                raise SdoAbortedError(refusal)
            return
        check_limits(variable, data[:length])
        self.write(index, sub, data[:length])

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Take over what an SDO client has written within type and limits; may still raise
        SdoAbortedError."""
        self.set_data(index, sub, data)

    def check_segmented(self, index: int, sub: int) -> None:
        """Refuse a segmented download before it begins; commands too, for the core reads single frames
        only."""
        if not self._find_object(index, sub).writable:
            raise SdoAbortedError(READ_ONLY)
        if (index, sub) in self._commands.objects:
            raise SdoAbortedError(NOT_STORED)


def _default(variable: ODVariable) -> bytes:
    if variable.default is None:
        return bytes(len(variable) // 8) if variable.fixed_size else b""
    return variable.encode_raw(variable.default)


def check_limits(variable: ODVariable, data: bytes) -> None:
    """Raises SdoAbortedError for NaN, infinity and what is beyond the object's limits."""
    if variable.data_type not in NUMBER_TYPES:
        return
    value = variable.decode_raw(data)
    if not isinstance(value, int | float) or not isfinite(value):
        raise SdoAbortedError(RANGE)
    if variable.max is not None and value > variable.max:
        raise SdoAbortedError(TOO_HIGH)
    if variable.min is not None and value < variable.min:
        raise SdoAbortedError(TOO_LOW)
