"""Object dictionaries as tables of entries, from which canopen's dictionary and EDS text are made."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import groupby
from typing import NamedTuple

from canopen.objectdictionary import ObjectDictionary, ODArray, ODRecord, ODVariable

VARIABLE, ARRAY, RECORD = 7, 8, 9
TEXT = "s"  # in addition to the `struct` codes of `signals.layout.CODES`
DATA_TYPES = {"b": 2, "h": 3, "i": 4, "B": 5, "H": 6, "I": 7, "f": 8, TEXT: 9}


class Entry(NamedTuple):
    """One (sub-)object: type by struct code or TEXT; access "ro", "rw", "wo", "const"; default (None: none),
    to which the node id is added if `relative`; limits; whether it may be mapped into a PDO."""

    sub: int
    name: str
    code: str
    access: str = "ro"
    default: float | str | None = None
    relative: bool = False
    low: int | None = None
    high: int | None = None
    mappable: bool = False


@dataclass(frozen=True, slots=True)
class Object:
    """An object: a variable, or an array or record whose first entry is the highest sub-index."""

    index: int
    name: str
    kind: int
    entries: tuple[Entry, ...]


def variable(index: int, name: str, code: str, access: str, default: float | str | None) -> Object:
    """An object with one value."""
    return Object(index, name, VARIABLE, (Entry(0, name, code, access, default),))


def group(index: int, name: str, kind: int, entries: Iterable[Entry]) -> Object:
    """An array or record."""
    entries = tuple(entries)
    highest = Entry(0, "Highest sub-index supported", "B", "ro", max(entry.sub for entry in entries))
    return Object(index, name, kind, (highest, *entries))


def first_entry(made: Object, entry: Entry) -> Object:
    """The object with another entry at sub-index 0."""
    return replace(made, entries=(entry, *made.entries[1:]))


def merged(objects: Iterable[Object]) -> tuple[Object, ...]:
    """In the order of the indices; objects of one index become one with the entries of all."""

    def index(made: Object) -> int:
        return made.index

    return tuple(_joined(list(same)) for _, same in groupby(sorted(objects, key=index), index))


def _joined(same: list[Object]) -> Object:
    if len(same) == 1:
        return same[0]
    entries = {entry.sub: entry for made in same for entry in made.entries if entry.sub}
    return group(same[0].index, same[0].name, same[0].kind, (entries[sub] for sub in sorted(entries)))


def dictionary(objects: Iterable[Object], node_id: int) -> ObjectDictionary:
    """canopen's dictionary for one node."""
    made = ObjectDictionary()
    made.node_id = node_id
    for described in objects:
        made.add_object(_described(described, node_id))
    return made


def _described(described: Object, node_id: int) -> ODVariable | ODArray | ODRecord:
    members = [_variable(described.index, entry, node_id) for entry in described.entries]
    if described.kind == VARIABLE:
        return members[0]
    made = ODRecord(described.name, described.index)  # canopen's arrays invent sub-indices
    for member in members:
        made.add_member(member)
    return made


def _variable(index: int, entry: Entry, node_id: int) -> ODVariable:
    made = ODVariable(entry.name, index, entry.sub)
    made.data_type = DATA_TYPES[entry.code]
    made.access_type = entry.access
    made.min, made.max = entry.low, entry.high
    made.pdo_mappable = entry.mappable
    default = entry.default
    if entry.relative and default is not None and not isinstance(default, str):
        default += node_id
    made.__dict__["default"] = default  # declared as a number, but text is taken as well
    return made
