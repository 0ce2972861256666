"""The object dictionary of a device at run time: canopen's LocalNode with limits, lengths and commands."""

from collections.abc import Callable
from math import isfinite
from typing import NamedTuple

import canopen
from canopen.objectdictionary import ObjectDictionary, ODVariable
from canopen.objectdictionary.datatypes import NUMBER_TYPES
from canopen.sdo.exceptions import SdoAbortedError

from cylforce.canopen.sdo_server import LENGTH, NOT_STORED

# Abort codes of CiA 301.
NO_SUB = 0x06090011  # sub-index does not exist
READ_ONLY = 0x06010002  # attempt to write a read-only object
RANGE, TOO_HIGH, TOO_LOW = 0x06090030, 0x06090031, 0x06090032  # invalid value, value too high, value too low


class Commands(NamedTuple):
    """Objects that are commands: writing them stores nothing.

    objects: (index, sub-index) of the commands
    verdict: returns the service's decision on the last command: None or 0 (done), or the abort code with which to
        refuse it. The service gets each frame before the node does.
    """

    objects: frozenset[tuple[int, int]]
    verdict: Callable[[], int | None]


def _done() -> None:
    """Accept: without commands none is refused."""


NO_COMMANDS = Commands(frozenset(), _done)


class Objects(canopen.LocalNode):
    """A node whose objects are bytes, little-endian, in `data_store[index][sub]`, at first the default values.

    node_id: CANopen node number
    dictionary: description of every object
    commands: objects that are commands
    """

    def __init__(self, node_id: int, dictionary: ObjectDictionary, commands: Commands) -> None:
        super().__init__(node_id, dictionary)
        self.node_id = node_id
        self._commands = commands
        self.restore(0x1000, 0x10000)

    def restore(self, first: int, end: int) -> None:
        """Set the default values again for the indices first <= index < end."""
        for index in self.object_dictionary:
            if first <= index < end:
                described = self.object_dictionary[index]
                members = (described,) if isinstance(described, ODVariable) else tuple(described.values())
                self.data_store[index] = {member.subindex: _default(member) for member in members}

    def variable(self, index: int, sub: int) -> ODVariable | None:
        """Return the description of an object; None if there is none."""
        try:
            return self._find_object(index, sub)
        except SdoAbortedError:
            return None

    def _find_object(self, index: int, subindex: int) -> ODVariable:
        """Return the description of an object. Raises SdoAbortedError where there is none."""
        described: ODVariable = super()._find_object(index, subindex)
        if described.subindex != subindex:  # a single variable has no other sub-index than 0
            raise SdoAbortedError(NO_SUB)
        return described

    def raw(self, index: int, sub: int) -> int:
        """Return an object's bytes as an unsigned number."""
        return int.from_bytes(self.data_store[index][sub], "little")

    def set_value(self, index: int, sub: int, value: float | str) -> None:
        """Set an object from inside the device: read-only objects too, and without limits."""
        self.set_data(index, sub, self._find_object(index, sub).encode_raw(value))

    def download(self, index: int, sub: int, data: bytes, length: int | None) -> None:
        """Write an object for an SDO client. A command is not stored: the service decides whether to obey it.

        Raises SdoAbortedError for an object that does not exist or is read-only, data of another length than its type,
        a value beyond its limits, a command that the service refuses, and what `write` refuses.

        data: the bytes of the request
        length: how many of them are data; None: the client did not announce it
        """
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
        """Store bytes of the right type and within the limits; a subclass may still raise SdoAbortedError."""
        self.set_data(index, sub, data)

    def check_segmented(self, index: int, sub: int) -> None:
        """Raise SdoAbortedError for a segmented download that must not begin.

        Commands are refused, too: the service reads only single frames.
        """
        if not self._find_object(index, sub).writable:
            raise SdoAbortedError(READ_ONLY)
        if (index, sub) in self._commands.objects:
            raise SdoAbortedError(NOT_STORED)


def _default(variable: ODVariable) -> bytes:
    """Return the default value as bytes; zeros without one."""
    if variable.default is None:
        return bytes(len(variable) // 8) if variable.fixed_size else b""
    return variable.encode_raw(variable.default)


def check_limits(variable: ODVariable, data: bytes) -> None:
    """Raise SdoAbortedError for NaN, infinity and a value beyond the object's limits."""
    if variable.data_type not in NUMBER_TYPES:
        return
    value = variable.decode_raw(data)
    if not isinstance(value, int | float) or not isfinite(value):
        raise SdoAbortedError(RANGE)
    if variable.max is not None and value > variable.max:
        raise SdoAbortedError(TOO_HIGH)
    if variable.min is not None and value < variable.min:
        raise SdoAbortedError(TOO_LOW)
