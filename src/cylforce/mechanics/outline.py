"""Outline of an arm at a posture, for drawings: named pins, links as polygons, cylinders and bars as lines [m]."""

from typing import NamedTuple

import numpy as np

from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

Place = complex
NAMES = {"foot": "cylinder foot", "eye": "cylinder eye"}  # names in a drawing of the two pins of the cylinder itself


class NamedPin(NamedTuple):
    """A pin of the machine.

    name: e.g. "boom pin", "stick cylinder foot"
    body: name of the body to which it is fixed; None: it moves with a rocker
    local: place x + i z in that body's frame [m]; None with a rocker
    """

    name: str
    body: str | None
    local: Place | None


class Outline(NamedTuple):
    """An arm at one posture, places x + i z from the first pin [m].

    pins: all pins, in the order of `pin_list`
    links: for every link the corners of the convex hull of its pins (of the last one with the tool), anticlockwise
    cylinders: (foot, eye) of every cylinder
    rockers: of every four-bar rocker pin, rocker end and cylinder eye (the rocker end again where the eye is there)
    bars: of every four-bar both ends of the link: at the rocker's end and at the link pin
    chassis: pins on the chassis, the first pin first
    """

    pins: tuple[Place, ...]
    links: tuple[tuple[Place, ...], ...]
    cylinders: tuple[tuple[Place, Place], ...]
    rockers: tuple[tuple[Place, ...], ...]
    bars: tuple[tuple[Place, Place], ...]
    chassis: tuple[Place, ...]


def pin_list(machine: Machine) -> tuple[NamedPin, ...]:
    """Return every pin of the machine: the links' inner pins, the tool, then the pins of each cylinder's linkage."""
    bodies = ("chassis", *(link.name for link in machine.links))
    pins = [NamedPin(f"{link.name} pin", link.name, 0j) for link in machine.links]
    pins.append(NamedPin("tool", machine.links[-1].name, machine.tool))
    straight = machine.pose(np.zeros(machine.size))  # any pose gives the names of the pins
    for cylinder in machine.cylinders:
        fixed_pins = dict(zip(("foot", "rocker pin", "link pin"), cylinder.linkage.pins, strict=False))
        if len(cylinder.linkage.pins) == 2:
            fixed_pins = dict(zip(("foot", "eye"), cylinder.linkage.pins, strict=True))
        for name in cylinder.linkage.places(straight):
            body, local = fixed_pins.get(name, (None, None))
            full = f"{cylinder.name} {NAMES.get(name, name)}"
            if name == "rocker end" and cylinder.linkage.places(straight).keys() == {*fixed_pins, name}:
                full += ", cylinder eye"
            pins.append(NamedPin(full, None if body is None else bodies[body], local))
    return tuple(pins)


def outline(machine: Machine, theta: Array) -> Outline:
    """Return the outline of the arm at joint angles theta (N,) [rad]."""
    at = machine.pose(theta)
    origins, tool = [complex(z) for z in at.origin[1:]], complex(machine.tool_point(theta).place)
    places = [{name: complex(z) for name, z in c.linkage.places(at).items()} for c in machine.cylinders]
    corners: list[list[Place]] = [[0j], *([a, b] for a, b in zip(origins, [*origins[1:], tool], strict=True))]
    for c in machine.cylinders:
        for body, local in c.linkage.pins:
            corners[body].append(complex(at.origin[body] + at.turn[body] * local))
    four_bars = [p for p in places if "rocker pin" in p]
    return Outline(
        pins=(*origins, tool, *(z for p in places for z in p.values())),
        links=tuple(hull(part) for part in corners[1:]),
        cylinders=tuple((p["foot"], p.get("eye", p.get("rocker end", 0j))) for p in places),
        rockers=tuple((p["rocker pin"], p["rocker end"], p.get("eye", p["rocker end"])) for p in four_bars),
        bars=tuple((p["rocker end"], p["link pin"]) for p in four_bars),
        chassis=tuple(corners[0]),
    )


def hull(points: list[Place]) -> tuple[Place, ...]:
    """Return the corners of the convex hull of places x + i z, anticlockwise (monotone chain, Andrew 1979)."""
    order = sorted(set(points), key=lambda z: (z.real, z.imag))
    if len(order) < 3:
        return tuple(order)
    lower, upper = _chain(order), _chain(order[::-1])
    return (*lower[:-1], *upper[:-1])


def _chain(order: list[Place]) -> list[Place]:
    """Return the corners of one side of the hull, from places x + i z sorted along x: only left turns remain."""
    corners: list[Place] = []
    for z in order:
        while len(corners) > 1 and ((corners[-1] - corners[-2]).conjugate() * (z - corners[-1])).imag <= 0.0:
            corners.pop()
        corners.append(z)
    return corners
