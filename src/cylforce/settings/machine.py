"""Machine section of the file as a frozen `Machine`: links, linkages, cylinders."""

from dataclasses import replace
from math import pi

from cylforce.mechanics import chain, linkages
from cylforce.mechanics.gravity import normal_gravity
from cylforce.mechanics.linkages import Linkage
from cylforce.mechanics.machine import TOLERANCE_OVER_ERROR, Cylinder, Link, Machine
from cylforce.settings.arm import (
    AttachmentTable,
    CylinderTable,
    DogboneTable,
    FourBarTable,
    LinkTable,
    MachineTable,
    Pin,
    ToolTable,
    TriangleTable,
)
from cylforce.settings.checks.names import CHASSIS
from cylforce.settings.error import FaultError, Inspection
from cylforce.settings.model import MachineFile
from cylforce.signals.kinds import Signal
from cylforce.signals.units import BAR, DEGREE, MILLIMETRE, STANDARD_GRAVITY

ERROR_OVER_TOLERANCE = 1.0 / TOLERANCE_OVER_ERROR


def machine(file: MachineFile, signals: tuple[Signal, ...], findings: Inspection) -> Machine | None:
    """Return the machine in SI, with the standard tool; None when a link, a cylinder or gravity cannot be used.

    Every error goes to `findings`.
    """
    tool = complex(*file.tool.point_m)
    links = [findings.attempt(_link, file, k) for k in range(len(file.links))]
    cylinders = [findings.attempt(_cylinder, file, k) for k in range(len(file.cylinders))]
    gravity = findings.attempt(_gravity, file.machine)
    if None in links or None in cylinders or gravity is None:
        return None
    return Machine(
        name=file.machine.name,
        links=tuple(link for link in links if link),
        cylinders=tuple(cylinder for cylinder in cylinders if cylinder),
        signals=signals,
        tool=tool,
        rated_payload=file.machine.rated_payload_kg,
        payload_reach=file.machine.payload_reach_m or abs(tool),
        slew_axis=file.machine.slew_axis_m,
        gravity=gravity,
        inertial=complex(*(file.machine.inertial_sensor_m or (0.0, 0.0))),
        curled=_curled(file.tool),
    )


def attachment(file: MachineFile, k: int, standard: Machine) -> Machine:
    """Return the machine with attachment k (from 0) instead of its last link.

    The cylinders and the last joint's range are those of the standard machine. So are the angles at which loads are
    booked with a bucket; with another tool they are booked at any angle. A moment of inertia that the file lacks is
    that of a uniform bar.

    standard: the machine with the standard tool
    """
    table, last = file.attachments[k], standard.links[-1]
    tool = complex(*table.point_m)
    inertia = table.inertia_kg_m2 or table.mass_kg * abs(tool) ** 2 / 12.0
    link = Link(
        name=last.name,
        length=abs(tool),
        mass=table.mass_kg,
        cx=table.centre_m[0],
        cz=table.centre_m[1],
        inertia=inertia,
        angle_low=last.angle_low,
        angle_high=last.angle_high,
        length_error=last.length_error,
        **_errors(table, inertia),
    )
    return replace(
        standard,
        links=(*standard.links[:-1], link),
        tool=tool,
        rated_payload=table.rated_payload_kg,
        payload_reach=table.payload_reach_m or abs(tool),
        curled=standard.curled if table.kind == "bucket" else None,
        opens=table.kind == "grab",
    )


def _curled(table: ToolTable) -> tuple[float, float] | None:
    """Return the angles of the last joint [rad] at which loads are booked; None: any."""
    return None if table.curled_deg is None else (table.curled_deg[0] * DEGREE, table.curled_deg[1] * DEGREE)


def _gravity(table: MachineTable) -> float:
    """Return gravity [m/s^2] where the machine works: as given, or that of its latitude, else the standard one.

    Raises FaultError when both are given, or a height without a latitude.
    """
    if table.gravity_m_s2 is not None and table.latitude_deg is not None:
        problem = "and latitude_deg both say what gravity is: keep gravity_m_s2 if it was measured, else latitude_deg"
        raise FaultError(("machine", "gravity_m_s2"), problem)
    if table.height_m is not None and table.latitude_deg is None:
        problem = "has no effect without a latitude: add latitude_deg, or remove height_m"
        raise FaultError(("machine", "height_m"), problem)
    if table.latitude_deg is None:
        return table.gravity_m_s2 or STANDARD_GRAVITY
    return normal_gravity(table.latitude_deg * DEGREE, table.height_m or 0.0)


def _link(file: MachineFile, k: int) -> Link:
    """Return link k (from 0) in SI. A moment of inertia that the file lacks is that of a uniform bar.

    Tolerances become standard errors. Raises FaultError without a length, see `_length`.
    """
    table = file.links[k]
    length = _length(file, k)
    inertia = table.inertia_kg_m2 or table.mass_kg * length**2 / 12.0
    low, high = table.angle_range_deg
    return Link(
        name=table.name,
        length=length,
        mass=table.mass_kg,
        cx=table.centre_m[0],
        cz=table.centre_m[1],
        inertia=inertia,
        angle_low=low * DEGREE,
        angle_high=high * DEGREE,
        length_error=ERROR_OVER_TOLERANCE * table.tolerance.length_m,
        **_errors(table, inertia),
    )


def _errors(table: LinkTable | AttachmentTable, inertia: float) -> dict[str, float]:
    """Return the standard errors of a link from its tolerances: mass [kg], centre [m], inertia [kg m^2], by field.

    inertia: of the link [kg m^2]
    """
    tolerance = table.tolerance
    return {
        "mass_error": ERROR_OVER_TOLERANCE * tolerance.mass_percent / 100.0 * table.mass_kg,
        "centre_error": ERROR_OVER_TOLERANCE * tolerance.centre_m,
        "inertia_error": ERROR_OVER_TOLERANCE * tolerance.inertia_percent / 100.0 * inertia,
    }


def _length(file: MachineFile, k: int) -> float:
    """Return the length of link k [m]; that of the last link is by default the distance of the tool from its pin.

    Raises FaultError for another link without a length.
    """
    length = file.links[k].length_m
    if length is not None:
        return length
    if k + 1 < len(file.links):
        problem = "lacks the key length_m: add the distance from its inner to its outer pin"
        raise FaultError(("links", k), problem, ("length_m",))
    return abs(complex(*file.tool.point_m))  # nothing is joined to the last link's end: only a measure of its size


def _cylinder(file: MachineFile, k: int) -> Cylinder:
    """Return cylinder k (from 0) in SI, with the areas summed over its `count` parallel cylinders.

    Tolerances become standard errors: relative of the areas, twice that of the bore; of the pins [m]. A rod pressure
    that the file lacks is 0.
    """
    table = file.cylinders[k]
    bore, rod = table.bore_mm * MILLIMETRE, table.rod_mm * MILLIMETRE
    return Cylinder(
        name=table.name,
        linkage=_linkage(file, table),
        area_head=table.count * pi / 4.0 * bore**2,
        area_rod=table.count * pi / 4.0 * (bore**2 - rod**2),
        length_low=table.length_range_m[0],
        length_high=table.length_range_m[1],
        rod_pressure=(table.rod_pressure_bar or 0.0) * BAR,
        area_error=ERROR_OVER_TOLERANCE * 2.0 * table.tolerance.bore_mm / table.bore_mm,
        pin_error=ERROR_OVER_TOLERANCE * table.tolerance.pins_m,
    )


def _linkage(file: MachineFile, table: CylinderTable) -> Linkage:
    """Return the linkage of a cylinder."""
    shape = table.linkage
    if isinstance(shape, TriangleTable):
        return linkages.Triangle(_pin(file, shape.foot), _pin(file, shape.eye))
    if isinstance(shape, DogboneTable):
        return _dogbone(file, shape)
    return _four_bar(file, shape)


def _dogbone(file: MachineFile, shape: DogboneTable) -> Linkage:
    """Return a dogbone as a four-bar whose rocker is the inner bar."""
    return linkages.FourBar(
        foot=_pin(file, shape.foot),
        rocker_pin=_pin(file, shape.inner_pin),
        link_pin=_pin(file, shape.outer_pin),
        rocker_length=shape.inner_m,
        link_length=shape.outer_m,
        side=1 if shape.side == "left" else -1,
    )


def _four_bar(file: MachineFile, shape: FourBarTable) -> Linkage:
    """Return a four-bar, with its eye in units of the rocker's length."""
    return linkages.FourBar(
        foot=_pin(file, shape.foot),
        rocker_pin=_pin(file, shape.rocker_pin),
        link_pin=_pin(file, shape.link_pin),
        rocker_length=shape.rocker_m,
        link_length=shape.link_m,
        side=1 if shape.side == "left" else -1,
        eye=1.0 + 0.0j if shape.eye_m is None else complex(*shape.eye_m) / shape.rocker_m,
    )


def _pin(file: MachineFile, pin: Pin) -> chain.Pin:
    """Return number of the body (0: chassis) and place x + i z [m] in its frame of a pin."""
    return (CHASSIS, *(link.name for link in file.links)).index(pin.body), complex(*pin.at_m)
