"""Object dictionaries as tables of entries, from which canopen's dictionary and EDS text are made."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import groupby
from operator import attrgetter
from typing import NamedTuple

from canopen.objectdictionary import ObjectDictionary, ODArray, ODRecord, ODVariable

VARIABLE, ARRAY, RECORD = 7, 8, 9  # object types of CiA 301
TEXT = "s"  # in addition to the struct codes of `signals.layout.CODES`
# Data types of CiA 301 by struct code.
DATA_TYPES = {"b": 2, "h": 3, "i": 4, "B": 5, "H": 6, "I": 7, "f": 8, TEXT: 9}


class Entry(NamedTuple):
    """One value: an object, or a sub-index of one.

    sub: sub-index
    name: name in the EDS
    code: data type, a struct code or TEXT
    access: "ro", "rw", "wo" or "const"
    default: default value; None: none
    relative: whether the node number is added to the default
    low: lower limit; None: none
    high: upper limit; None: none
    mappable: whether it may be mapped into a PDO
    """

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
    """An object of the dictionary.

    index: its index
    name: name in the EDS
    kind: VARIABLE, ARRAY or RECORD
    entries: its values; of an array or record the first one is the highest sub-index
    """

    index: int
    name: str
    kind: int
    entries: tuple[Entry, ...]


def variable(index: int, name: str, code: str, access: str, default: float | str | None) -> Object:
    """Return an object with one value, at sub-index 0; `code`: its data type, a struct code or TEXT."""
    return Object(index, name, VARIABLE, (Entry(0, name, code, access, default),))


def group(index: int, name: str, kind: int, entries: Iterable[Entry]) -> Object:
    """Return an object of `kind` ARRAY or RECORD with these entries, and at sub-index 0 the highest sub-index."""
    entries = tuple(entries)
    highest = Entry(0, "Highest sub-index supported", "B", "ro", max(entry.sub for entry in entries))
    return Object(index, name, kind, (highest, *entries))


def with_first_entry(item: Object, entry: Entry) -> Object:
    """Return an object with another entry at sub-index 0."""
    return replace(item, entries=(entry, *item.entries[1:]))


def merged(objects: Iterable[Object]) -> tuple[Object, ...]:
    """Return objects in the order of their indices; those of one index become one with the entries of all.

    It has name and kind of the first of them; of entries with the same sub-index the last counts.
    """
    by_index = attrgetter("index")
    groups = groupby(sorted(objects, key=by_index), by_index)
    return tuple(_joined(list(of_index)) for index, of_index in groups)


def _joined(objects: list[Object]) -> Object:
    """Return one object with the entries of all `objects`, which have the same index, see `merged`."""
    first = objects[0]
    if len(objects) == 1:
        return first
    entries = {entry.sub: entry for item in objects for entry in item.entries if entry.sub}
    return group(first.index, first.name, first.kind, (entries[sub] for sub in sorted(entries)))


def dictionary(objects: Iterable[Object], node_id: int) -> ObjectDictionary:
    """Return canopen's dictionary for one node."""
    described = ObjectDictionary()
    described.node_id = node_id
    for item in objects:
        described.add_object(_described(item, node_id))
    return described


def _described(item: Object, node_id: int) -> ODVariable | ODArray | ODRecord:
    """Return canopen's description of an object."""
    members = [_variable(item.index, entry, node_id) for entry in item.entries]
    if item.kind == VARIABLE:
        return members[0]
    record = ODRecord(item.name, item.index)  # for arrays as well: canopen's arrays invent sub-indices
    for member in members:
        record.add_member(member)
    return record


def _variable(index: int, entry: Entry, node_id: int) -> ODVariable:
    """Return canopen's description of one value."""
    variable = ODVariable(entry.name, index, entry.sub)
    variable.data_type = DATA_TYPES[entry.code]
    variable.access_type = entry.access
    variable.min, variable.max = entry.low, entry.high
    variable.pdo_mappable = entry.mappable
    default = entry.default
    if entry.relative and default is not None and not isinstance(default, str):
        default += node_id
    variable.__dict__["default"] = default  # declared as a number, but text works as well
    return variable
