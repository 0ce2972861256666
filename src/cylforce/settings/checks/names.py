"""Check names and numbers in a machine file that must differ, and references that must exist.

Works on the parsed TOML, before values are checked, so that a wrong value elsewhere does not hide these errors.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from cylforce.estimation.model import FRICTION
from cylforce.mechanics.installation import STANDARD
from cylforce.settings.arm import NAME
from cylforce.settings.error import FaultError, Key, shown
from cylforce.signals.kinds import Kind

Raw = Mapping[str, Any]
CHASSIS = "chassis"
RESERVED = ("t_s", "t_us")  # names of the time in a recording
AT_CYLINDER = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE, Kind.FORCE_PIN, Kind.CYLINDER_LENGTH)
AT_LINK = (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION)
OWN_NODE = 64  # default of publication.node_id


class RawTable(NamedTuple):
    """A table of an array.

    key: its key in the file
    table: its content
    """

    key: Key
    table: Raw


def name_faults(raw: Raw) -> Iterator[FaultError]:
    """Yield all faults of names, node-IDs and references, of nodes without a sensor, and of sensors that measure the
    same.

    raw: content of the file as parsed from TOML
    """
    for table in ("links", "attachments", "cylinders", "nodes", "sensors"):
        yield from _taken_names(raw, table)
    yield from _taken_node_ids(raw)
    yield from _idle_nodes(raw)
    for entry in entries(raw, "sensors"):
        yield from _references(raw, entry)
    yield from _same_places(raw)
    yield from _bodies(raw)
    yield from _laws(raw)
    yield from _columns(raw)


def entries(raw: Raw, table: str) -> list[RawTable]:
    """Return the tables of an array of the file with their keys; what is no table in it is omitted.

    raw: content of the file as parsed from TOML
    table: name of the array, such as "sensors"
    """
    array = raw.get(table)
    if not isinstance(array, list):
        return []
    return [RawTable(key=(table, k), table=entry) for k, entry in enumerate(array) if isinstance(entry, dict)]


def _names(raw: Raw, table: str) -> list[str]:
    """Return all names of an array's tables; none when one is missing, wrong, reserved or used twice.

    A reference that seems to be wrong may mean that one.
    """
    given = [entry.table.get("name") for entry in entries(raw, table)]
    names = [name for name in given if isinstance(name, str) and re.match(NAME, name)]
    return names if len(set(names) - _reserved(table)) == len(given) else []


def _reserved(table: str) -> set[str]:
    """Return the names that no table of an array may have; `table`: name of the array."""
    return {"links": {CHASSIS}, "sensors": set(RESERVED), "attachments": {STANDARD}}.get(table, set())


def _taken_names(raw: Raw, table: str) -> Iterator[FaultError]:
    """Yield a fault for each name in the tables of an array that an earlier one has, or that is reserved.

    table: name of the array
    """
    taken = _reserved(table)
    for entry in entries(raw, table):
        name = entry.table.get("name")
        if isinstance(name, str):
            if name in taken:
                yield FaultError((*entry.key, "name"), f"is {shown(name)}, which is taken: choose another")
            taken.add(name)


def _taken_node_ids(raw: Raw) -> Iterator[FaultError]:
    """Yield a fault for each node-ID of a sensor node that an earlier one, or cylforce's own node, has."""
    publication = raw.get("publication")
    number = publication.get("node_id", OWN_NODE) if isinstance(publication, dict) else OWN_NODE
    taken = {number: "cylforce's own node"} if isinstance(number, int) else {}
    for entry in entries(raw, "nodes"):
        number = entry.table.get("node_id")
        if not isinstance(number, int):
            continue
        if number in taken:
            problem = f"is {number}, which is also that of {taken[number]}: give each node its own"
            yield FaultError((*entry.key, "node_id"), problem)
        taken.setdefault(number, str(entry.table.get("name")))


def _idle_nodes(raw: Raw) -> Iterator[FaultError]:
    """Yield a fault for each node without a sensor."""
    used, names = [entry.table.get("node") for entry in entries(raw, "sensors")], _names(raw, "nodes")
    if not all(node in names for node in used):
        return  # a wrong reference may mean any node
    for entry in entries(raw, "nodes"):
        name = entry.table.get("name")
        if isinstance(name, str) and name not in used:
            yield FaultError(entry.key, "has no sensor: add one or remove the node")


def _references(raw: Raw, sensor: RawTable) -> Iterator[FaultError]:
    """Yield the faults of a sensor's keys `node` and `at`: they name nothing of the file, or what it cannot be at.

    They are not compared with names of which one is missing, wrong, reserved or used twice (`_names`).
    """
    node, names = sensor.table.get("node"), _names(raw, "nodes")
    if isinstance(node, str) and names and node not in names:
        yield FaultError((*sensor.key, "node"), f"is {shown(node)}, which is no node: write one of {', '.join(names)}")
    kind, at = sensor.table.get("kind"), sensor.table.get("at")
    if not isinstance(kind, str) or kind not in set(Kind) or not isinstance(at, str | None):
        return
    if kind in AT_CYLINDER + AT_LINK:
        yield from _place(raw, sensor.key, kind, at)
    elif at not in (None, CHASSIS):
        problem = f"is {shown(at)}, but {kind} belongs to the chassis: remove it"
        yield FaultError((*sensor.key, "at"), problem)


def _place(raw: Raw, key: Key, kind: str, at: str | None) -> Iterator[FaultError]:
    """Yield the fault of a sensor's key `at`: it is missing, or names no cylinder or link of the file.

    raw: the whole file
    key: key of the sensor's table
    kind: kind of the sensor, which decides between cylinder and link
    at: value of its key `at`; None: missing
    """
    table = "cylinders" if kind in AT_CYLINDER else "links"
    names = _names(raw, table)
    if at is None:
        yield FaultError(key, f"lacks the key at: write one of {', '.join(names)}", ("at",))
    elif names and at not in names:
        problem = f"is {shown(at)}, which is no {table[:-1]}: write one of {', '.join(names)}"
        yield FaultError((*key, "at"), problem)


def _same_places(raw: Raw) -> Iterator[FaultError]:
    """Yield a fault for each sensor of the same kind at the same cylinder, link or chassis as an earlier one."""
    first: dict[tuple[str, str], object] = {}
    for entry in entries(raw, "sensors"):
        kind, at = entry.table.get("kind"), entry.table.get("at", CHASSIS)
        if not isinstance(kind, str) or not isinstance(at, str):
            continue
        name = entry.table.get("name")
        other = first.setdefault((kind, at), name)
        if other != name:
            problem = f"measures the same as {other} ({kind}): remove one or correct kind and at"
            yield FaultError(entry.key, problem)


def _bodies(raw: Raw) -> Iterator[FaultError]:
    """Yield a fault for each pin of a linkage whose body is neither a link nor the chassis.

    Nothing is yielded while a link's name is missing, wrong, reserved or used twice (`_names`): a pin may mean it.
    """
    names = _names(raw, "links")
    bodies = (CHASSIS, *names)
    for cylinder in entries(raw, "cylinders"):
        linkage = cylinder.table.get("linkage")
        for name, pin in linkage.items() if names and isinstance(linkage, dict) else ():
            body = pin.get("body") if isinstance(pin, dict) else None
            if isinstance(body, str) and body not in bodies:
                problem = f"is {shown(body)}, which is no link: write one of {', '.join(bodies)}"
                yield FaultError((*cylinder.key, "linkage", name, "body"), problem)


def _laws(raw: Raw) -> Iterator[FaultError]:
    """Yield a fault for each unknown name of a friction law, and one where Coulomb friction is missing."""
    table = raw.get("friction")
    laws = table.get("effects") if isinstance(table, dict) else None
    if not isinstance(laws, list):
        return
    for law in laws:
        if isinstance(law, str) and law not in FRICTION:
            yield FaultError(("friction", "effects"), f"name {shown(law)}: choose among {', '.join(FRICTION)}")
    if FRICTION[0] not in laws:
        problem = (
            f"lack {FRICTION[0]!r}, without which the standard error of a weight at rest would be too small: add it"
        )
        yield FaultError(("friction", "effects"), problem)


def _columns(raw: Raw) -> Iterator[FaultError]:
    """Yield a fault for each column of recordings that belongs to no sensor.

    Nothing is yielded while a sensor's name is missing, wrong, reserved or used twice (`_names`): a column may mean it.
    """
    table, names = raw.get("table"), _names(raw, "sensors")
    signals = table.get("signals") if isinstance(table, dict) else None
    for name in signals if names and isinstance(signals, dict) else ():
        if name not in names:
            yield FaultError(("table", "signals", name), f"is no sensor: write one of {', '.join(names)}")
