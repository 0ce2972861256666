"""One machine of the model: the data sheet with deviations within its tolerances, drawn from a seed."""

from dataclasses import dataclass, replace
from math import cos, radians, sin

import numpy as np
from numpy.typing import NDArray

from .datasheet import EXCAVATOR, JOINTS, BucketBars, Cylinder, Link, Point, Sheet, Tolerances
from .linkage import Bars, Direct


@dataclass(frozen=True, slots=True)
class Body:
    """A rigid body: mass, centre of gravity, and the integrals of x^2, z^2, xz, y^2 over its mass about the centre."""

    mass: float
    centre: Point
    xx: float
    zz: float
    xz: float
    yy: float

    @property
    def inertia(self) -> float:
        """Moment of inertia about the centre, for turning in the arm's plane [kg m^2]."""
        return self.xx + self.zz


@dataclass(frozen=True, slots=True)
class Bar:
    """A part of the linkages: mass, distance of its centre from its pin along its line, inertia about the centre."""

    mass: float
    centre: float
    inertia: float


BARS = {
    "boom_barrel": Bar(220.0, 0.62, 31.0),
    "boom_rod": Bar(150.0, 0.62, 24.0),
    "stick_barrel": Bar(150.0, 0.85, 40.0),
    "stick_rod": Bar(95.0, 0.85, 28.0),
    "bucket_barrel": Bar(90.0, 0.62, 15.0),
    "bucket_rod": Bar(60.0, 0.62, 12.0),
    "rocker": Bar(75.0, 0.34, 3.5),
    "link": Bar(65.0, 0.33, 3.0),
}
# How the data sheet shares them out among the links: kg at a place.
SHARES: dict[str, tuple[tuple[float, Point], ...]] = {
    "boom": ((185.0, (2.40, 0.70)), (122.5, (2.75, 1.00))),
    "stick": (
        (122.5, (-0.85, 0.12)),
        (75.0, (0.20, 0.70)),
        (75.0, (2.40, 0.50)),
        (75.0, (2.45, 0.30)),
        (32.5, (2.40, 0.50)),
    ),
    "bucket": ((32.5, (-0.13, 0.41)),),
}
FLATNESS = {"boom": 0.05, "stick": 0.06, "bucket": 0.40}  # share of z^2 in a link's inertia
WIDTH = {"boom": 0.15, "stick": 0.12, "bucket": 0.33}  # m, radius of gyration across the arm's plane


@dataclass(frozen=True, slots=True)
class Specimen:
    """The true machine. `bars` is empty when its linkages are massless; their mass is then the links'."""

    sheet: Sheet
    bodies: dict[str, Body]
    lengths: dict[str, float]
    tool: Point
    cylinders: dict[str, Cylinder]
    bucket_bars: BucketBars
    slew_axis: float
    bars: dict[str, Bar]

    def linkage(self, joint: str) -> Direct | Bars:
        """The kinematics of a joint's cylinder."""
        cylinder = self.cylinders[joint]
        if joint == "boom":
            return Direct(cylinder.foot, cylinder.eye, (0.0, 0.0))
        if joint == "stick":
            return Direct(cylinder.foot, cylinder.eye, (self.lengths["boom"], 0.0))
        return self.bucket_linkage()

    def bucket_linkage(self) -> Bars:
        """The four-bar of the bucket."""
        cylinder, four = self.cylinders["bucket"], self.bucket_bars
        pin = (self.lengths["stick"], 0.0)
        return Bars(cylinder.foot, four.rocker_pin, four.link_pin, (four.rocker, four.link), pin)

    def areas(self, joint: str) -> tuple[float, float]:
        """Piston areas [m^2], head and rod side, of all cylinders at the joint."""
        cylinder = self.cylinders[joint]
        head = cylinder.count * np.pi / 4.0 * cylinder.bore**2
        return float(head), float(head - cylinder.count * np.pi / 4.0 * cylinder.rod**2)


def draw_specimen(
    rng: np.random.Generator, *, masses: bool = True, geometry: bool = True, linkage_masses: bool = True
) -> Specimen:
    """A machine within the data sheet's tolerances; switched off, masses or geometry are the sheet's own."""
    sheet, near = EXCAVATOR, EXCAVATOR.tolerances

    def off(half_width: float, on: bool = geometry) -> float:
        drawn = float(rng.uniform(-half_width, half_width))
        return drawn if on else 0.0

    def moved(point: Point) -> Point:
        return point[0] + off(near.pins), point[1] + off(near.pins)

    bodies = {joint: _body(rng, sheet, joint, masses, linkage_masses) for joint in JOINTS}
    cylinders = {
        joint: replace(
            data,
            bore=data.bore + off(near.bore),
            rod=data.rod + off(near.bore),
            foot=moved(data.foot),
            eye=data.eye if joint == "bucket" else moved(data.eye),
        )
        for joint, data in sheet.cylinders.items()
    }
    bars = sheet.bars
    return Specimen(
        sheet=sheet,
        bodies=bodies,
        lengths={joint: link.length + off(near.length) for joint, link in sheet.links.items()},
        tool=(sheet.tool[0] + off(near.length), sheet.tool[1] + off(near.length)),
        cylinders=cylinders,
        bucket_bars=BucketBars(
            moved(bars.rocker_pin), moved(bars.link_pin), bars.rocker + off(near.pins), bars.link + off(near.pins)
        ),
        slew_axis=sheet.slew_axis + off(near.length),
        bars={name: _bar(bar, 1.0 + off(0.05, masses)) for name, bar in BARS.items()} if linkage_masses else {},
    )


def _bar(bar: Bar, factor: float) -> Bar:
    return replace(bar, mass=bar.mass * factor, inertia=bar.inertia * factor)


def _body(rng: np.random.Generator, sheet: Sheet, joint: str, drawn: bool, own: bool) -> Body:
    """A link; `own`: without the shares of the linkages, which are bodies of their own then."""
    link = sheet.links[joint]
    bare = without_shares(link, SHARES[joint]) if own else (link.mass, *link.centre, link.inertia)
    part = rng.uniform(-1.0, 1.0, 5) if drawn else rng.uniform(-1.0, 1.0, 5) * 0.0
    return drawn_body(bare, part, sheet.tolerances, FLATNESS[joint], WIDTH[joint])


def drawn_body(
    bare: tuple[float, float, float, float], part: NDArray[np.float64], near: Tolerances, flat: float, width: float
) -> Body:
    """A body near the `bare` mass, centre and inertia: off by the shares `part` (5,) of the tolerances. `flat`: share
    of z^2 in its inertia; `width`: radius of gyration across the arm's plane [m]."""
    mass, cx, cz, inertia = bare
    mass *= 1.0 + near.mass * float(part[0])
    centre = (cx + near.centre * float(part[1]), cz + near.centre * float(part[2]))
    inertia *= 1.0 + near.inertia * float(part[3])
    tilt = radians(4.0 * float(part[4]))  # of the body's long axis against the line of pins
    long, thin = inertia * (1.0 - flat), inertia * flat
    xx = long * cos(tilt) ** 2 + thin * sin(tilt) ** 2
    return Body(mass, centre, xx, inertia - xx, (long - thin) * sin(tilt) * cos(tilt), mass * width**2)


def without_shares(link: Link, shares: tuple[tuple[float, Point], ...]) -> tuple[float, float, float, float]:
    """Mass, centre and inertia of the bare link, whose data with the shares are the sheet's."""
    about_pin = link.inertia + link.mass * (link.centre[0] ** 2 + link.centre[1] ** 2)
    mass = link.mass - sum(kg for kg, _ in shares)
    cx = (link.mass * link.centre[0] - sum(kg * at[0] for kg, at in shares)) / mass
    cz = (link.mass * link.centre[1] - sum(kg * at[1] for kg, at in shares)) / mass
    about_pin -= sum(kg * (at[0] ** 2 + at[1] ** 2) for kg, at in shares)
    return mass, cx, cz, about_pin - mass * (cx * cx + cz * cz)
