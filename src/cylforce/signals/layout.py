"""PDO layouts: the bytes that carry each value. Sensor decoding, our publication, EDS and DBC are made from them."""

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

CODES = {
    "b": 1,
    "B": 1,
    "h": 2,
    "H": 2,
    "i": 4,
    "I": 4,
    "f": 4,
}  # `struct` codes of the object types in use, and their size in bytes
TYPE_NAMES = {"b": "INTEGER8", "B": "UNSIGNED8", "h": "INTEGER16", "H": "UNSIGNED16", "i": "INTEGER32"}
TYPE_NAMES |= {"I": "UNSIGNED32", "f": "REAL32"}


@dataclass(frozen=True, slots=True)
class Field:
    """One mapped object.

    signal:        name of the signal or published value; None: unused bytes
    index, sub:    index and subindex of the object in the sender's object dictionary
    code:          `struct` code of its type
    scale, offset: SI value = raw * scale + offset
    unit:          SI unit of the value
    low, high:     range outside which a value is neither accepted nor published [SI]
    note:          bandwidth and delay of a published value, for its description
    """

    signal: str | None
    index: int
    sub: int
    code: str
    scale: float
    offset: float
    unit: str
    low: float
    high: float
    note: str = ""


class Pdo(NamedTuple):
    """Layout of a PDO.

    can_id:      identifier on the bus
    node_id:     CANopen node number of the sender
    number:      TPDO number, 1 to 512
    synchronous: sent after each `sync`-th SYNC; else by an event timer
    sync:        number of SYNCs from one to the next; 0 with an event timer
    period_s:    time from one to the next, by SYNC or by the event timer [s]
    fields:      in byte order, little endian, without gaps: unused bytes are fields too
    """

    can_id: int
    node_id: int
    number: int
    synchronous: bool
    sync: int
    period_s: float
    fields: tuple[Field, ...]

    @property
    def length(self) -> int:
        """Length of the data in bytes."""
        return sum(CODES[field.code] for field in self.fields)


@cache
def not_available(code: str) -> int | float:
    """Return the raw value, before scale and offset, that means "no value" for a `struct` code.

    It is NaN, the most negative signed or the largest unsigned integer."""
    bits = 8 * CODES[code]
    if code == "f":
        return float("nan")
    return (1 << bits) - 1 if code.isupper() else -(1 << (bits - 1))
