"""Fit the pins of a proposed machine: move them as little as possible until each stroke covers its joint's range."""

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

ROOM = 0.01  # share of the stroke that remains at either end of the joint's range; chosen
STIFF = 0.25  # how far rocker and link change, relative to a cylinder's foot: makers keep a linkage; chosen
MOST_MOVED = 0.5  # largest change of a number of `_adjustable`, times the largest of these numbers; chosen
LEAST_LEVER = 0.25  # least lever over the range, times the largest: below it the force hardly shows the load; chosen
LEAST_TRANSMISSION = 0.3  # least sine of the angle between rocker and link; chosen
LONGEST = 1.91  # open over closed length: a closed cylinder is at least 1.1 strokes long, for piston, gland and eyes


def fit_pins(tables: dict[str, Any], k: int, wanted: Range | None, shown: Range) -> None:
    """Give cylinder k of the tables pins with which its stroke covers its joint's range, room of ROOM kept.

    Its linkage and its length_range_m are changed in `tables`, rounded to millimetres. Raises ValueError, a sentence,
    where there are no such pins near the typical ones, or where lever, dead point or lengths are bad (`_problem`).

    wanted: closed and open length [m]; None: the pins stay, and its lengths follow from them
    shown: the joint's range as `angle_range_deg` of a data sheet gives it [deg]
    """
    cylinder = tables["cylinders"][k]
    machine, name, shape = bare_machine(tables), cylinder["name"], cylinder["linkage"]
    cure = f"check {name}.stroke_mm, {name}.closed_mm and the joint's angle_range_deg"
    if wanted is None:
        cure = f"narrow the range, or give {name}.stroke_mm and {name}.closed_mm from the data sheet"
        shortest, longest = lengths(machine, k, machine.cylinders[k].linkage)
        room = ROOM * (longest - shortest)
        wanted = shortest - room, longest + room
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
    """Return the number of the joint that cylinder k moves."""
    return max(bare_machine(tables).spans[k])


def _move(machine: Machine, tables: dict[str, Any], k: int, inner: Range) -> None:
    """Move the pins of cylinder k until its shortest and longest length over the joint's range are `inner` [m].

    They are changed in `tables`. Raises ValueError, in a sentence, where no pins near the typical ones do so.

    machine: the machine with the typical pins
    """
    cylinder = tables["cylinders"][k]
    shape, start = cylinder["linkage"], _adjustable(cylinder["linkage"])

    def ends(x: Array) -> Range:
        """Return the shortest and longest length [m] with the numbers x of `_adjustable`, which are written."""
        _set_adjustable(shape, x)
        return lengths(machine, k, linkage(tables, shape))

    try:
        moved = fitted(start, _ease(shape), ends, inner)
    except ValueError as error:
        raise ValueError(_misfit(cylinder["name"], inner, lengths(machine, k, machine.cylinders[k].linkage))) from error
    _set_adjustable(shape, moved)
    if np.max(np.abs(moved - start)) > MOST_MOVED * np.max(np.abs(start)):
        raise ValueError(_misfit(cylinder["name"], inner, lengths(machine, k, machine.cylinders[k].linkage)))


def _misfit(name: str, inner: Range, typical: Range) -> str:
    """Return the sentence about a cylinder for which no pins fit.

    inner: lengths that it needs over the joint's range [m]
    typical: lengths that the typical pins give it [m]
    """
    required, given = (f"{1e3 * low:.0f}-{1e3 * high:.0f} mm" for low, high in (inner, typical))
    return (
        f"{name}.stroke_mm and {name}.closed_mm require lengths of {required} in the joint's range, typical pins give "
        f"{given}, and none near them fit: check both, and the joint's angle_range_deg"
    )


def _adjustable(shape: Mapping[str, Any]) -> Array:
    """Return the numbers [m] that may change: foot and eye of a triangle; foot of a four-bar and its eye or lengths.

    A four-bar whose eye is not at the rocker's end keeps its bars and moves the eye; otherwise rocker and link change.
    """
    if shape["kind"] == "triangle":
        return np.array([*shape["foot"]["at_m"], *shape["eye"]["at_m"]])
    rest = shape["eye_m"] if "eye_m" in shape else (shape["rocker_m"], shape["link_m"])
    return np.array([*shape["foot"]["at_m"], *rest])


def _ease(shape: Mapping[str, Any]) -> Array:
    """Return how far each number of `_adjustable` may change relative to the others (1: freely)."""
    bars = shape["kind"] != "triangle" and "eye_m" not in shape
    return np.array([1.0, 1.0, STIFF, STIFF] if bars else [1.0, 1.0, 1.0, 1.0])


def _set_adjustable(shape: dict[str, Any], x: Array) -> None:
    """Write the numbers x [m] of `_adjustable`, in its order, into the table of a linkage."""
    foot, (a, b) = x[:2].tolist(), x[2:].tolist()
    shape["foot"] = {**shape["foot"], "at_m": foot}
    if shape["kind"] == "triangle":
        shape["eye"] = {**shape["eye"], "at_m": [a, b]}
    elif "eye_m" in shape:
        shape["eye_m"] = [a, b]
    else:
        shape |= {"rocker_m": a, "link_m": b}


def _round(shape: dict[str, Any]) -> None:
    """Round the coordinates and lengths [m] in the table of a linkage to millimetres."""
    for key, part in shape.items():
        if isinstance(part, Mapping):
            shape[key] = {**part, "at_m": [round(p, 3) for p in part["at_m"]]}
        elif key.endswith("_m"):
            shape[key] = [round(p, 3) for p in part] if isinstance(part, list) else round(part, 3)


def _problem(machine: Machine, k: int) -> str | None:
    """Return what is wrong with cylinder k in its joint's range, as the end of a sentence; None: nothing."""
    cylinder = machine.cylinders[k]
    stretch = cylinder.linkage.stretch(machine.pose(range_postures(machine, k)))
    lever = stretch.gradient[:, max(machine.spans[k])]
    if not np.all(np.isfinite(lever)):
        return "has a linkage that cannot be closed all over it"
    if np.min(lever) * np.max(lever) <= 0.0 or np.min(np.abs(lever)) < LEAST_LEVER * np.max(np.abs(lever)):
        return f"has levers of {np.min(lever):.2f} to {np.max(lever):.2f} m in it"
    if np.min(stretch.transmission) < LEAST_TRANSMISSION:
        return "comes near a dead point in it"
    if cylinder.length_high > LONGEST * cylinder.length_low:
        ends = f"{cylinder.length_low:.2f} to {cylinder.length_high:.2f} m"
        return f"is {ends} long in it, more than {LONGEST:g} times as long open as closed"
    return None


def bare_machine(tables: Raw) -> Machine:
    """Return a machine for its geometry only: links, linkages, and lengths of the cylinders.

    It has no signals. Centres, inertias, piston areas and payload are no true values.
    """
    links = tuple(
        Link(
            name=link["name"],
            length=link.get("length_m", tables["tool"]["point_m"][0]),
            mass=link["mass_kg"],
            cx=0.0,
            cz=0.0,
            inertia=0.0,
            angle_low=link["angle_range_deg"][0] * DEGREE,
            angle_high=link["angle_range_deg"][1] * DEGREE,
            mass_error=0.0,
            centre_error=0.0,
            inertia_error=0.0,
        )
        for link in tables["links"]
    )
    cylinders = tuple(
        Cylinder(
            name=cylinder["name"],
            linkage=linkage(tables, cylinder["linkage"]),
            area_head=1.0,
            area_rod=0.5,
            length_low=cylinder["length_range_m"][0],
            length_high=cylinder["length_range_m"][1],
        )
        for cylinder in tables["cylinders"]
    )
    return Machine(
        name="",
        links=links,
        cylinders=cylinders,
        signals=(),
        tool=complex(*tables["tool"]["point_m"]),
        rated_payload=1.0,
        payload_reach=1.0,
        slew_axis=0.0,
    )


def linkage(tables: Raw, shape: Mapping[str, Any]) -> Linkage:
    """Return the linkage of a table of the machine file: a triangle or a four-bar, no dogbone."""
    bodies = ["chassis", *(link["name"] for link in tables["links"])]

    def pin(key: str) -> tuple[int, complex]:
        """Return number of the body (0: chassis) and place x + i z [m] in its frame of a pin."""
        return bodies.index(shape[key]["body"]), complex(*shape[key]["at_m"])

    if shape["kind"] == "triangle":
        return linkages.Triangle(pin("foot"), pin("eye"))
    eye = complex(*shape["eye_m"]) / shape["rocker_m"] if "eye_m" in shape else 1.0 + 0.0j
    side = 1 if shape["side"] == "left" else -1
    return linkages.FourBar(
        pin("foot"), pin("rocker_pin"), pin("link_pin"), shape["rocker_m"], shape["link_m"], side, eye
    )
