"""One loader: the data sheet with deviations within its tolerances, drawn from a seed."""

from dataclasses import dataclass, replace
from math import pi

import numpy as np

from reference_machine.datasheet import Cylinder, Point
from reference_machine.specimen import Bar, Body, drawn_body, without_shares

from .sheet import BARS, FLATNESS, JOINTS, LOADER, SHARES, WIDTH, Bars, LoaderSheet


@dataclass(frozen=True, slots=True)
class Specimen:
    """The true machine."""

    sheet: LoaderSheet
    bodies: dict[str, Body]
    lengths: dict[str, float]
    tool: Point
    cylinders: dict[str, Cylinder]
    zbar: Bars
    bars: dict[str, Bar]

    def areas(self, name: str) -> tuple[float, float]:
        """Piston areas [m^2], head and rod side, of all cylinders of that name."""
        cylinder = self.cylinders[name]
        head = cylinder.count * pi / 4.0 * cylinder.bore**2
        return head, head - cylinder.count * pi / 4.0 * cylinder.rod**2


def draw_specimen(rng: np.random.Generator, *, masses: bool = True, geometry: bool = True) -> Specimen:
    """A loader within the data sheet's tolerances; switched off, masses or geometry are the sheet's own."""
    sheet, near = LOADER, LOADER.tolerances

    def off(half_width: float, on: bool = geometry) -> float:
        drawn = float(rng.uniform(-half_width, half_width))
        return drawn if on else 0.0

    def moved(point: Point) -> Point:
        return point[0] + off(near.pins), point[1] + off(near.pins)

    def made(data: Cylinder) -> Cylinder:
        bore, rod = data.bore + off(near.bore), data.rod + off(near.bore)
        return replace(data, bore=bore, rod=rod, foot=moved(data.foot), eye=moved(data.eye))

    bars = sheet.bars
    pins = (moved(bars.crank_pin), moved(bars.link_pin))
    return Specimen(
        sheet=sheet,
        bodies={joint: _body(rng, joint, drawn=masses) for joint in JOINTS},
        lengths={joint: link.length + off(near.length) for joint, link in sheet.links.items()},
        tool=(sheet.tool[0] + off(near.length), sheet.tool[1] + off(near.length)),
        cylinders={name: made(data) for name, data in sheet.cylinders.items()},
        zbar=Bars(*pins, bars.crank + off(near.pins), bars.link + off(near.pins), moved(bars.eye)),
        bars={name: _bar(bar, 1.0 + off(0.05, masses)) for name, bar in BARS.items()},
    )


def _bar(bar: Bar, factor: float) -> Bar:
    return replace(bar, mass=bar.mass * factor, inertia=bar.inertia * factor)


def _body(rng: np.random.Generator, joint: str, *, drawn: bool) -> Body:
    part = rng.uniform(-1.0, 1.0, 5) * (1.0 if drawn else 0.0)
    bare = without_shares(LOADER.links[joint], SHARES[joint])
    return drawn_body(bare, part, LOADER.tolerances, FLATNESS[joint], WIDTH[joint])
