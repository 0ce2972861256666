"""The sensors of the file as signals: where each belongs, whether they are enough, a recording's columns."""

from math import sqrt

import numpy as np
from pydantic import ValidationError

from cylforce.files.tables import ColumnMap, TableMap
from cylforce.mechanics.machine import Machine
from cylforce.settings.bus import period_s
from cylforce.settings.error import FaultError
from cylforce.settings.model import MachineFile, SensorTable, SignalColumn
from cylforce.settings.units import in_si
from cylforce.signals.kinds import UNIT, Kind, Signal

AT_CYLINDER = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE, Kind.FORCE_PIN, Kind.CYLINDER_LENGTH)
AT_LINK = (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION)


def signals(file: MachineFile) -> tuple[Signal, ...]:
    """The signals in the order of the file. Raises FaultError."""
    found = tuple(_signal(file, k) for k in range(len(file.sensors)))
    first: dict[tuple[Kind, int], str] = {}
    for k, signal in enumerate(found):
        other = first.setdefault((signal.kind, signal.index), signal.name)
        if other != signal.name:
            problem = f"measures the same as {other} ({signal.kind}): remove one or correct kind and at"
            raise FaultError(("sensors", k), problem)
    return found


def _signal(file: MachineFile, k: int) -> Signal:
    table = file.sensors[k]
    error = table.standard_error
    if error is None and table.type == "f32":
        raise FaultError(
            ("sensors", k), "lacks standard_error with a unit: a REAL32 value has no digit to guess it from"
        )
    return Signal(
        name=table.name,
        kind=table.kind,
        index=_index(file, k, table),
        low=table.range[0],
        high=table.range[1],
        period_s=period_s(file, table),
        standard_error=abs(table.scale) / sqrt(12.0) if error is None else error,
    )


def _index(file: MachineFile, k: int, table: SensorTable) -> int:
    key = ("sensors", k, "at")
    if table.kind not in AT_CYLINDER + AT_LINK:
        if table.at not in (None, "chassis"):
            raise FaultError(key, f"is {table.at!r}, but {table.kind} belongs to the chassis: remove it")
        return 0
    what = "cylinder" if table.kind in AT_CYLINDER else "link"
    names = [entry.name for entry in (file.cylinders if table.kind in AT_CYLINDER else file.links)]
    if table.at not in names:
        said = "is missing" if table.at is None else f"is {table.at!r}, which is no {what}"
        raise FaultError(key if table.at else key[:-1], f"(at) {said}: write one of {', '.join(names)}")
    return names.index(table.at)


def check_enough(file: MachineFile, machine: Machine) -> None:
    """Refuses a machine of which an angle or every torque is unknown."""
    lengths = {s.index for s in machine.signals if s.kind is Kind.CYLINDER_LENGTH}
    for c in lengths:
        _check_inverse(machine, c)
    by_length = {machine.spans[c][0] for c in lengths}
    direct = {s.index for s in machine.signals if s.kind in AT_LINK}
    for j, link in enumerate(machine.links):
        if j not in by_length | direct:
            raise FaultError(
                ("links", j),
                "has no source of its angle, and all absolute angles beyond it are lost: add a sensor of "
                f"kind joint_angle or link_inclination at {link.name}, or cylinder_length at its cylinder",
            )
    _check_forces(file, machine)
    if not machine.rows:
        raise FaultError(
            ("sensors",), "measure no torque: add head_pressure (and rod_pressure) or force_pin at a cylinder"
        )


def _check_inverse(machine: Machine, c: int) -> None:
    k = next(n for n, s in enumerate(machine.signals) if s.kind is Kind.CYLINDER_LENGTH and s.index == c)
    cylinder = machine.cylinders[c]
    table = machine.tables[c]
    if table is None:
        raise FaultError(
            ("sensors", k),
            f"is of no use: the length of {cylinder.name} depends on several joints; remove it",
        )
    if np.any(np.diff(table[0]) <= 0.0):
        joint = machine.links[machine.spans[c][0]].name
        raise FaultError(
            ("sensors", k),
            f"gives no one angle: {cylinder.name} has a dead point in {joint}'s angle_range_deg; narrow it",
        )


def _check_forces(file: MachineFile, machine: Machine) -> None:
    seen = {(s.kind, s.index) for s in machine.signals}
    for c, cylinder in enumerate(file.cylinders):
        head, rod = (Kind.HEAD_PRESSURE, c) in seen, (Kind.ROD_PRESSURE, c) in seen
        if rod and not head:
            k = next(n for n, s in enumerate(machine.signals) if (s.kind, s.index) == (Kind.ROD_PRESSURE, c))
            raise FaultError(("sensors", k), f"is alone: add a head_pressure sensor at {cylinder.name}")
        if head and (Kind.FORCE_PIN, c) in seen:
            raise FaultError(("cylinders", c), "has a force pin and pressure sensors: keep one of them")
        if rod and cylinder.rod_pressure_bar is not None:
            raise FaultError(("cylinders", c, "rod_pressure_bar"), "is measured by a sensor: remove this key")


def columns(file: MachineFile) -> TableMap | None:
    """Where a recording's table has time and signals, or None where the file has no [table]. Raises
    FaultError."""
    if file.table is None:
        return None
    kinds = {sensor.name: sensor.kind for sensor in file.sensors}
    unknown = next((name for name in file.table.signals if name not in kinds), None)
    if unknown is not None:
        problem = f"is no sensor: write one of {', '.join(kinds)}"
        raise FaultError(("table", "signals", unknown), problem)
    found = tuple(_column(name, raw, kinds[name]) for name, raw in file.table.signals.items())
    return TableMap(file.table.time.column, file.table.time.scale, found)


def _column(name: str, raw: dict[str, object], kind: Kind) -> ColumnMap:
    key = ("table", "signals", name)
    try:
        table = SignalColumn.model_validate(in_si(raw, UNIT[kind], ("scale", "offset")))
    except ValidationError as error:
        first = error.errors()[0]
        raise FaultError((*key, *first["loc"]), f"is wrong ({first['msg']}): correct it") from None
    except ValueError as error:
        raise FaultError(key, str(error)) from None
    return ColumnMap(name, table.column, table.scale, table.offset)
