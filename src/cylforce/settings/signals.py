"""The sensors of the file as signals: where each is mounted, whether they suffice, which columns of a recording they
have.
"""

from collections.abc import Iterator
from math import sqrt

import numpy as np
from pydantic import ValidationError

from cylforce.files.tables import ColumnMap, TableMap
from cylforce.mechanics.machine import Machine
from cylforce.settings.bus import period_s
from cylforce.settings.checks.names import AT_CYLINDER, AT_LINK
from cylforce.settings.error import FaultError, Inspection
from cylforce.settings.model import MachineFile, SensorTable, SignalColumn
from cylforce.settings.sections import fault
from cylforce.settings.units import COLUMN, in_si
from cylforce.signals.kinds import INERTIAL, UNIT, Kind, Signal


def signals(file: MachineFile, findings: Inspection) -> tuple[Signal, ...]:
    """Return the signals of all sensors without an error, in the order of the file; every error goes to `findings`."""
    all_signals = [findings.attempt(_signal, file, k) for k in range(len(file.sensors))]
    return tuple(signal for signal in all_signals if signal is not None)


def _signal(file: MachineFile, k: int) -> Signal:
    """Return the signal of sensor k; its standard error is that of rounding where the file has none.

    Raises FaultError for a REAL32 without a standard error, and for a wrong period of its TPDO (`bus.period_s`).
    """
    table = file.sensors[k]
    error = table.standard_error
    if error is None and table.type == "f32":
        raise FaultError(
            ("sensors", k), "lacks standard_error with a unit: a REAL32 value has no digit to guess it from"
        )
    return Signal(
        name=table.name,
        kind=table.kind,
        index=_index(file, table),
        low=table.range[0],
        high=table.range[1],
        period_s=period_s(file, table),
        standard_error=abs(table.scale) / sqrt(12.0) if error is None else error,
    )


def _index(file: MachineFile, table: SensorTable) -> int:
    """Return the number of the cylinder or link at which a sensor is mounted; 0 for one of the chassis."""
    if table.kind not in AT_CYLINDER + AT_LINK:
        return 0
    return [entry.name for entry in (file.cylinders if table.kind in AT_CYLINDER else file.links)].index(str(table.at))


def measurement_faults(file: MachineFile, machine: Machine) -> Iterator[FaultError]:
    """Yield faults of joints without an angle, of a machine without any torque, and of sensors that contradict each
    other, give no unique angle, or need another sensor.

    machine: the machine, with the signals of the file
    """
    lengths = sorted({s.index for s in machine.signals if s.kind is Kind.CYLINDER_LENGTH})
    for c in lengths:
        yield from _inverse_faults(machine, c)
    by_length = {machine.spans[c][0] for c in lengths}
    direct = {s.index for s in machine.signals if s.kind in AT_LINK}
    for j, link in enumerate(machine.links):
        if j not in by_length | direct:
            yield FaultError(
                ("links", j),
                "has no source of its angle, and all absolute angles beyond it are lost: add a sensor of "
                f"kind joint_angle or link_inclination at {link.name}, or cylinder_length at its cylinder",
            )
    yield from _force_faults(file, machine)
    yield from _inertial_faults(file, machine)
    if not machine.rows:
        yield FaultError(
            ("sensors",), "measure no torque: add head_pressure (and rod_pressure) or force_pin at a cylinder"
        )


def _inertial_faults(file: MachineFile, machine: Machine) -> Iterator[FaultError]:
    """Yield faults of the base's inertial sensor: missing axes, a wrong axis, or a missing position."""
    number = {s.kind: k for k, s in enumerate(machine.signals) if s.kind in INERTIAL}
    if not number:
        if file.machine.inertial_sensor_m is not None:
            problem = "is of no use without sensors of kind " + ", ".join(INERTIAL) + ": add them, or remove it"
            yield FaultError(("machine", "inertial_sensor_m"), problem)
        return
    missing = [kind for kind in INERTIAL if kind not in number]
    if missing:
        problem = f"measures the base's motion in part only: add {' and '.join(missing)}, or remove it"
        yield FaultError(("sensors", min(number.values()), "kind"), problem)
    if file.machine.inertial_sensor_m is None:
        yield FaultError(("machine",), "lacks inertial_sensor_m: add where the base's inertial sensor sits, [x, z]")
    for kind, at_rest in ((Kind.FORWARD_ACCELERATION, 0.0), (Kind.UPWARD_ACCELERATION, machine.gravity)):
        signal = machine.signals[number[kind]] if kind in number else None
        if signal and not signal.low < at_rest < signal.high:
            problem = (
                f"is {signal.low:g} to {signal.high:g} m/s^2, but at rest on level ground {kind} is {at_rest:.3g}: the "
                "sensor lies on another axis; exchange forward and upward, or correct the sign"
            )
            yield FaultError(("sensors", number[kind], "range"), problem)


def _inverse_faults(machine: Machine, c: int) -> Iterator[FaultError]:
    """Yield why the measured length of a cylinder gives no unique angle."""
    k = next(n for n, s in enumerate(machine.signals) if s.kind is Kind.CYLINDER_LENGTH and s.index == c)
    cylinder, table = machine.cylinders[c], machine.tables[c]
    if table is None:
        yield FaultError(
            ("sensors", k),
            f"is of no use: the length of {cylinder.name} depends on several joints; remove it",
        )
    elif np.any(np.diff(table[0]) <= 0.0):
        joint = machine.links[machine.spans[c][0]].name
        yield FaultError(
            ("sensors", k),
            f"gives no unique angle: {cylinder.name} has a dead point in {joint}'s angle_range_deg; narrow it",
        )


def _force_faults(file: MachineFile, machine: Machine) -> Iterator[FaultError]:
    """Yield sensors of a cylinder's force that lack another one or contradict each other."""
    measured = {(s.kind, s.index) for s in machine.signals}
    for c, cylinder in enumerate(file.cylinders):
        head, rod = (Kind.HEAD_PRESSURE, c) in measured, (Kind.ROD_PRESSURE, c) in measured
        if rod and not head:
            k = next(n for n, s in enumerate(machine.signals) if (s.kind, s.index) == (Kind.ROD_PRESSURE, c))
            yield FaultError(
                ("sensors", k), f"gives no force without the head side: add a head_pressure sensor at {cylinder.name}"
            )
        if head and (Kind.FORCE_PIN, c) in measured:
            yield FaultError(("cylinders", c), "has a force pin and pressure sensors: keep one of them")
        if rod and cylinder.rod_pressure_bar is not None:
            yield FaultError(("cylinders", c, "rod_pressure_bar"), "is measured by a sensor: remove this key")


def columns(file: MachineFile, findings: Inspection) -> TableMap | None:
    """Return where a recording's table has time and signals; None without [table]. Every error goes to `findings`."""
    if file.table is None:
        return None
    kinds = {sensor.name: sensor.kind for sensor in file.sensors}
    known = [(name, raw) for name, raw in file.table.signals.items() if name in kinds]
    by_signal = tuple(column for name, raw in known if (column := _column(name, raw, kinds[name], findings)))
    return TableMap(time_column=file.table.time.column, time_scale_s=file.table.time.scale, columns=by_signal)


def _column(name: str, raw: dict[str, object], kind: Kind, findings: Inspection) -> ColumnMap | None:
    """Return the column of a recording's table that has a signal; None where it is wrong: errors go to `findings`.

    name, kind: of the signal
    raw: its table in table.signals, with units in its keys
    """
    key = ("table", "signals", name)
    before = len(findings.errors)
    converted = in_si(raw, UNIT[kind], COLUMN, key, findings)
    try:
        table = SignalColumn.model_validate(converted)
    except ValidationError as error:
        findings.errors.extend(fault(detail, (*key, *detail["loc"]), SignalColumn) for detail in error.errors())
        return None
    if len(findings.errors) > before:
        return None
    return ColumnMap(signal=name, column=table.column, scale=table.scale, offset=table.offset)
