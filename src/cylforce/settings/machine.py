"""The machine part of the file as a frozen `Machine`: links, linkages, cylinders; impossible geometry is
refused."""

from math import pi, sqrt

import numpy as np

from cylforce.mechanics import chain, linkages
from cylforce.mechanics.linkages import Linkage
from cylforce.mechanics.machine import Cylinder, Link, Machine
from cylforce.settings.arm import CylinderTable, DogboneTable, FourBarTable, LinkTable, Pin, TriangleTable
from cylforce.settings.error import FaultError, Key
from cylforce.settings.model import MachineFile
from cylforce.signals.kinds import Signal
from cylforce.signals.units import BAR, DEGREE, MILLIMETRE

LIMIT = 1.0 / sqrt(3.0)  # a tolerance is the half-width of a uniform distribution (GUM 4.3.7): its standard deviation
CHASSIS = "chassis"
SCAN = 361


def machine(file: MachineFile, signals: tuple[Signal, ...]) -> Machine:
    """The Machine. Raises FaultError."""
    tool = complex(*file.tool.point_m)
    built = Machine(
        name=file.machine.name,
        links=tuple(_link(file, k) for k in range(len(file.links))),
        cylinders=tuple(_cylinder(file, k) for k in range(len(file.cylinders))),
        signals=signals,
        tool=tool,
        rated_payload=file.machine.rated_payload_kg,
        payload_reach=file.machine.payload_reach_m or abs(tool),
        slew_axis=file.machine.slew_axis_m,
    )
    for c in range(len(built.cylinders)):
        _check_linkage(built, c)
    return built


def _link(file: MachineFile, k: int) -> Link:
    table = file.links[k]
    length = _length(file, k)
    inertia = table.inertia_kg_m2 or table.mass_kg * length**2 / 12.0
    low, high = table.angle_range_deg
    if high - low > 360.0:
        raise FaultError(("links", k, "angle_range_deg"), "spans more than a turn: give the joint's mechanical range")
    return Link(
        name=table.name,
        length=length,
        mass=table.mass_kg,
        cx=table.centre_m[0],
        cz=table.centre_m[1],
        inertia=inertia,
        angle_low=low * DEGREE,
        angle_high=high * DEGREE,
        **_errors(table, inertia),
    )


def _errors(table: LinkTable, inertia: float) -> dict[str, float]:
    near = table.tolerance
    return {
        "mass_error": LIMIT * near.mass_percent / 100.0 * table.mass_kg,
        "centre_error": LIMIT * near.centre_m,
        "inertia_error": LIMIT * near.inertia_percent / 100.0 * inertia,
        "length_error": LIMIT * near.length_m,
    }


def _length(file: MachineFile, k: int) -> float:
    length = file.links[k].length_m
    if length is not None:
        return length
    if k + 1 < len(file.links):
        raise FaultError(("links", k), "lacks the key length_m: add the distance from its inner to its outer pin")
    return abs(complex(*file.tool.point_m))  # beyond the last link nothing hangs: its length is a name for its size


def _cylinder(file: MachineFile, k: int) -> Cylinder:
    table = file.cylinders[k]
    if table.rod_mm >= table.bore_mm:
        raise FaultError(("cylinders", k, "rod_mm"), "is not smaller than bore_mm: exchange or correct them")
    bore, rod = table.bore_mm * MILLIMETRE, table.rod_mm * MILLIMETRE
    return Cylinder(
        name=table.name,
        linkage=_linkage(file, k, table),
        area_head=table.count * pi / 4.0 * bore**2,
        area_rod=table.count * pi / 4.0 * (bore**2 - rod**2),
        length_low=table.length_range_m[0],
        length_high=table.length_range_m[1],
        rod_pressure=(table.rod_pressure_bar or 0.0) * BAR,
        area_error=LIMIT * 2.0 * table.tolerance.bore_mm / table.bore_mm,
        pin_error=LIMIT * table.tolerance.pins_m,
    )


def _linkage(file: MachineFile, k: int, table: CylinderTable) -> Linkage:
    shape, key = table.linkage, ("cylinders", k, "linkage")
    if isinstance(shape, TriangleTable):
        return linkages.Triangle(_pin(file, key, "foot", shape.foot), _pin(file, key, "eye", shape.eye))
    if isinstance(shape, DogboneTable):
        return _dogbone(file, key, shape)
    return _four_bar(file, key, shape)


def _dogbone(file: MachineFile, key: Key, shape: DogboneTable) -> Linkage:
    return linkages.FourBar(
        foot=_pin(file, key, "foot", shape.foot),
        rocker_pin=_pin(file, key, "inner_pin", shape.inner_pin),
        link_pin=_pin(file, key, "outer_pin", shape.outer_pin),
        rocker_length=shape.inner_m,
        link_length=shape.outer_m,
        side=1 if shape.side == "left" else -1,
    )


def _four_bar(file: MachineFile, key: Key, shape: FourBarTable) -> Linkage:
    return linkages.FourBar(
        foot=_pin(file, key, "foot", shape.foot),
        rocker_pin=_pin(file, key, "rocker_pin", shape.rocker_pin),
        link_pin=_pin(file, key, "link_pin", shape.link_pin),
        rocker_length=shape.rocker_m,
        link_length=shape.link_m,
        side=1 if shape.side == "left" else -1,
        eye=1.0 + 0.0j if shape.eye_m is None else complex(*shape.eye_m) / shape.rocker_m,
    )


def _pin(file: MachineFile, key: Key, name: str, pin: Pin) -> chain.Pin:
    bodies = (CHASSIS, *(link.name for link in file.links))
    if pin.body not in bodies:
        raise FaultError((*key, name, "body"), f"is {pin.body!r}, which is no link: write one of {', '.join(bodies)}")
    return bodies.index(pin.body), complex(*pin.at_m)


def _check_linkage(built: Machine, c: int) -> None:
    """Refuses a linkage that moves nothing, does not close in its joint's range, or never fits its
    cylinder."""
    key, span = ("cylinders", c, "linkage"), built.spans[c]
    if not span:
        raise FaultError(key, "has all its pins on one body: it moves no joint; correct the bodies of its pins")
    if len(span) > 1:
        return  # several joints: which of their postures occur together, the file does not say
    joint = built.links[span[0]]
    theta = np.zeros((SCAN, built.size))
    theta[:, span[0]] = np.linspace(joint.angle_low, joint.angle_high, SCAN)
    length = built.cylinders[c].linkage.stretch(built.pose(theta)).length
    open_at = np.flatnonzero(np.isnan(length))
    if open_at.size:
        angle = theta[open_at[0], span[0]] / DEGREE
        raise FaultError(
            key,
            f"cannot be closed at {angle:.1f} deg: correct its dimensions or {joint.name}'s angle_range_deg",
        )
    low, high = built.cylinders[c].length_low, built.cylinders[c].length_high
    if length.max() < low or length.min() > high:
        found = f"{length.min():.3f}-{length.max():.3f} m"
        raise FaultError(key, f"makes lengths of {found}, all outside length_range_m: correct the pins or the range")
