"""What is drawn of an arm at a posture: named pins, links as outlines, cylinders and bars as lines; metres."""

from typing import NamedTuple

import numpy as np

from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

Place = complex
NAMES = {"foot": "cylinder foot", "eye": "cylinder eye"}


class NamedPin(NamedTuple):
    """A pin: name, body that it is fixed to (None: none, it moves with a rocker), place in that body's frame."""

    name: str
    body: str | None
    local: Place | None


class Outline(NamedTuple):
    """An arm at one posture [m], x + i z from the first pin: `pins` in the order of `pin_list`, corners of every link,
    cylinders as (foot, eye), rockers as triangles, coupling links as lines, the chassis' pins."""

    pins: tuple[Place, ...]
    links: tuple[tuple[Place, ...], ...]
    cylinders: tuple[tuple[Place, Place], ...]
    rockers: tuple[tuple[Place, ...], ...]
    bars: tuple[tuple[Place, Place], ...]
    chassis: tuple[Place, ...]


def pin_list(machine: Machine) -> tuple[NamedPin, ...]:
    """Every pin of the machine: the links' inner pins and the tool, then those of each cylinder's linkage."""
    bodies = ("chassis", *(link.name for link in machine.links))
    found = [NamedPin(f"{link.name} pin", link.name, 0j) for link in machine.links]
    found.append(NamedPin("tool", machine.links[-1].name, machine.tool))
    middle = machine.pose(np.zeros(machine.size))
    for cylinder in machine.cylinders:
        fixed = dict(zip(("foot", "rocker pin", "link pin"), cylinder.linkage.pins, strict=False))
        if len(cylinder.linkage.pins) == 2:
            fixed = dict(zip(("foot", "eye"), cylinder.linkage.pins, strict=True))
        for name in cylinder.linkage.places(middle):
            body, local = fixed.get(name, (None, None))
            full = f"{cylinder.name} {NAMES.get(name, name)}"
            if name == "rocker end" and cylinder.linkage.places(middle).keys() == {*fixed, name}:
                full += ", cylinder eye"
            found.append(NamedPin(full, None if body is None else bodies[body], local))
    return tuple(found)


def outline(machine: Machine, theta: Array) -> Outline:
    """The arm at joint angles (N,) [rad]."""
    at = machine.pose(theta)
    origins, tool = [complex(z) for z in at.origin[1:]], complex(machine.tool_point(theta).place)
    places = [{name: complex(z) for name, z in c.linkage.places(at).items()} for c in machine.cylinders]
    corners: list[list[Place]] = [[0j], *([a, b] for a, b in zip(origins, [*origins[1:], tool], strict=True))]
    for c in machine.cylinders:
        for body, local in c.linkage.pins:
            corners[body].append(complex(at.origin[body] + at.turn[body] * local))
    four = [p for p in places if "rocker pin" in p]
    return Outline(
        pins=(*origins, tool, *(z for p in places for z in p.values())),
        links=tuple(hull(part) for part in corners[1:]),
        cylinders=tuple((p["foot"], p.get("eye", p.get("rocker end", 0j))) for p in places),
        rockers=tuple((p["rocker pin"], p["rocker end"], p.get("eye", p["rocker end"])) for p in four),
        bars=tuple((p["rocker end"], p["link pin"]) for p in four),
        chassis=tuple(corners[0]),
    )


def hull(points: list[Place]) -> tuple[Place, ...]:
    """Corners of the convex hull, anticlockwise (monotone chain, Andrew 1979)."""
    order = sorted(set(points), key=lambda z: (z.real, z.imag))
    if len(order) < 3:
        return tuple(order)
    lower, upper = _chain(order), _chain(order[::-1])
    return (*lower[:-1], *upper[:-1])


def _chain(order: list[Place]) -> list[Place]:
    found: list[Place] = []
    for z in order:
        while len(found) > 1 and ((found[-1] - found[-2]).conjugate() * (z - found[-1])).imag <= 0.0:
            found.pop()
        found.append(z)
    return found
