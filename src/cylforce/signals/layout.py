"""The table of PDO layouts: which bytes carry which value. Sensors, our own publication, EDS, DBC all come from it."""

from dataclasses import dataclass
from typing import NamedTuple

CODES = {
    "b": 1,
    "B": 1,
    "h": 2,
    "H": 2,
    "i": 4,
    "I": 4,
    "f": 4,
}  # struct codes of the object types we carry: bytes
TYPE_NAMES = {"b": "INTEGER8", "B": "UNSIGNED8", "h": "INTEGER16", "H": "UNSIGNED16", "i": "INTEGER32"}
TYPE_NAMES |= {"I": "UNSIGNED32", "f": "REAL32"}


@dataclass(frozen=True, slots=True)
class Field:
    """One mapped object: SI value = raw * scale + offset. `signal` is the signal's (or published value's) name, None
    for a gap. `index`, `sub` address the object; `low`, `high` [SI] bound what is believed or published."""

    signal: str | None
    index: int
    sub: int
    code: str
    scale: float
    offset: float
    unit: str
    low: float
    high: float


class Pdo(NamedTuple):
    """A PDO: identifier on the bus, producer's node id, TPDO number 1..4 (or up to 512), fields in byte order (little
    endian, no gaps but those declared). `synchronous`: sent after each `sync`-th SYNC; else event timer `period_s`."""

    can_id: int
    node_id: int
    number: int
    synchronous: bool
    sync: int
    period_s: float
    fields: tuple[Field, ...]

    @property
    def length(self) -> int:
        """Bytes."""
        return sum(CODES[field.code] for field in self.fields)


def not_available(code: str) -> int | float:
    """The raw value that says "no value": NaN, the most negative integer, or the largest unsigned one."""
    bits = 8 * CODES[code]
    if code == "f":
        return float("nan")
    return (1 << bits) - 1 if code.isupper() else -(1 << (bits - 1))
