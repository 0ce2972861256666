"""The pins of a proposed machine: moved as little as possible until each cylinder's stroke covers its joint's range."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from cylforce.mechanics import linkages
from cylforce.mechanics.fitting import fitted, lengths, range_postures
from cylforce.mechanics.linkages import Linkage
from cylforce.mechanics.machine import Cylinder, Link, Machine
from cylforce.settings.proposal.types import Range, Raw
from cylforce.signals.estimate import Array
from cylforce.signals.units import DEGREE

ROOM = 0.01  # of the stroke, left at either end of the joint's range
STIFF = 0.25  # times as easily as a cylinder's foot are rocker and link changed: makers keep a linkage; chosen
MOST_MOVED = 0.5  # of a linkage's size: how far pins may come from the typical ones
LEAST_LEVER = 0.25  # of the largest lever over the range: below it the force no longer shows the load well
LEAST_TRANSMISSION = 0.3  # sine of the angle between rocker and link
LONGEST = 1.91  # open over closed length: a closed cylinder is at least 1.1 strokes long, for piston, gland and eyes


def fit_pins(tables: dict[str, Any], k: int, wanted: Range | None, shown: Range) -> None:
    """Give cylinder k of the `tables` pins with which it is as long as `wanted` (closed, open) [m], room of ROOM kept,
    at the ends of its joint's range; None: the pins stay, and its lengths follow from them. `shown`: that range [deg]
    as `angle_range_deg` of a data sheet gives it.

    Raises ValueError, in a sentence, where there are no such pins near the typical ones."""
    cylinder = tables["cylinders"][k]
    machine, name, shape = bare_machine(tables), cylinder["name"], cylinder["linkage"]
    cure = f"check {name}.stroke_mm, {name}.closed_mm and the joint's angle_range_deg"
    if wanted is None:
        cure = f"narrow the range, or give {name}.stroke_mm and {name}.closed_mm from the data sheet"
        found = lengths(machine, k, machine.cylinders[k].linkage)
        room = ROOM * (found[1] - found[0])
        wanted = found[0] - room, found[1] + room
    else:
        room = ROOM * (wanted[1] - wanted[0])
        _move(machine, tables, k, (wanted[0] + room, wanted[1] - room))
    _round(shape)
    cylinder["length_range_m"] = [round(length, 3) for length in wanted]
    if problem := _problem(bare_machine(tables), k):
        link = tables["links"][driven(tables, k)]["name"]
        raise ValueError(
            f"{link}.angle_range_deg is {shown[0]:g}:{shown[1]:g}, and the {name} cylinder {problem}: {cure}"
        )


def driven(tables: Raw, k: int) -> int:
    """The number of the joint that cylinder k moves."""
    return max(bare_machine(tables).spans[k])


def _move(machine: Machine, tables: dict[str, Any], k: int, inner: Range) -> None:
    cylinder = tables["cylinders"][k]
    shape, start = cylinder["linkage"], _adjustable(cylinder["linkage"])

    def ends(x: Array) -> Range:
        _set_adjustable(shape, x)
        return lengths(machine, k, linkage(tables, shape))

    try:
        found = fitted(start, _ease(shape), ends, inner)
    except ValueError as error:
        raise ValueError(_misfit(cylinder["name"], inner, lengths(machine, k, machine.cylinders[k].linkage))) from error
    _set_adjustable(shape, found)
    if np.max(np.abs(found - start)) > MOST_MOVED * np.max(np.abs(start)):
        raise ValueError(_misfit(cylinder["name"], inner, lengths(machine, k, machine.cylinders[k].linkage)))


def _misfit(name: str, inner: Range, typical: Range) -> str:
    asked, found = (f"{1e3 * low:.0f}-{1e3 * high:.0f} mm" for low, high in (inner, typical))
    return (
        f"{name}.stroke_mm and {name}.closed_mm ask for lengths of {asked} in the joint's range, typical pins give "
        f"{found}, and none near them fit: check both, and the joint's angle_range_deg"
    )


def _adjustable(shape: Mapping[str, Any]) -> Array:
    """The numbers [m] that may change: foot and eye; of a four-bar foot and, where the eye sits aside, that, else the
    lengths of rocker and link."""
    if shape["kind"] == "triangle":
        return np.array([*shape["foot"]["at_m"], *shape["eye"]["at_m"]])
    rest = shape["eye_m"] if "eye_m" in shape else (shape["rocker_m"], shape["link_m"])
    return np.array([*shape["foot"]["at_m"], *rest])


def _ease(shape: Mapping[str, Any]) -> Array:
    """How easily each of these numbers changes."""
    bars = shape["kind"] != "triangle" and "eye_m" not in shape
    return np.array([1.0, 1.0, STIFF, STIFF] if bars else [1.0, 1.0, 1.0, 1.0])


def _set_adjustable(shape: dict[str, Any], x: Array) -> None:
    foot, (a, b) = x[:2].tolist(), x[2:].tolist()
    shape["foot"] = {**shape["foot"], "at_m": foot}
    if shape["kind"] == "triangle":
        shape["eye"] = {**shape["eye"], "at_m": [a, b]}
    elif "eye_m" in shape:
        shape["eye_m"] = [a, b]
    else:
        shape |= {"rocker_m": a, "link_m": b}


def _round(shape: dict[str, Any]) -> None:
    """To millimetres."""
    for key, part in shape.items():
        if isinstance(part, Mapping):
            shape[key] = {**part, "at_m": [round(p, 3) for p in part["at_m"]]}
        elif key.endswith("_m"):
            shape[key] = [round(p, 3) for p in part] if isinstance(part, list) else round(part, 3)


def _problem(machine: Machine, k: int) -> str | None:
    """What is wrong with cylinder k in its joint's range."""
    cylinder = machine.cylinders[k]
    found = cylinder.linkage.stretch(machine.pose(range_postures(machine, k)))
    lever = found.gradient[:, max(machine.spans[k])]
    if not np.all(np.isfinite(lever)):
        return "has a linkage that cannot be closed all over it"
    if np.min(lever) * np.max(lever) <= 0.0 or np.min(np.abs(lever)) < LEAST_LEVER * np.max(np.abs(lever)):
        return f"has levers of {np.min(lever):.2f} to {np.max(lever):.2f} m in it"
    if np.min(found.transmission) < LEAST_TRANSMISSION:
        return "comes near a dead point in it"
    if cylinder.length_high > LONGEST * cylinder.length_low:
        ends = f"{cylinder.length_low:.2f} to {cylinder.length_high:.2f} m"
        return f"is {ends} long in it, more than {LONGEST:g} times as long open as closed"
    return None


def bare_machine(tables: Raw) -> Machine:
    """The geometry alone: links, linkages, lengths; angles of no sensor."""
    links = tuple(
        Link(
            link["name"],
            link.get("length_m", tables["tool"]["point_m"][0]),
            *(link["mass_kg"], 0.0, 0.0, 0.0),
            *(link["angle_range_deg"][0] * DEGREE, link["angle_range_deg"][1] * DEGREE),
            *(0.0, 0.0, 0.0),
        )
        for link in tables["links"]
    )
    cylinders = tuple(
        Cylinder(cylinder["name"], linkage(tables, cylinder["linkage"]), 1.0, 0.5, *cylinder["length_range_m"])
        for cylinder in tables["cylinders"]
    )
    return Machine("", links, cylinders, (), complex(*tables["tool"]["point_m"]), 1.0, 1.0, 0.0)


def linkage(tables: Raw, shape: Mapping[str, Any]) -> Linkage:
    """The linkage of a table as the machine file has it."""
    bodies = ["chassis", *(link["name"] for link in tables["links"])]

    def pin(key: str) -> tuple[int, complex]:
        return bodies.index(shape[key]["body"]), complex(*shape[key]["at_m"])

    if shape["kind"] == "triangle":
        return linkages.Triangle(pin("foot"), pin("eye"))
    eye = complex(*shape["eye_m"]) / shape["rocker_m"] if "eye_m" in shape else 1.0 + 0.0j
    side = 1 if shape["side"] == "left" else -1
    return linkages.FourBar(
        pin("foot"), pin("rocker_pin"), pin("link_pin"), shape["rocker_m"], shape["link_m"], side, eye
    )
