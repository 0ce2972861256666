"""Small drawings of courses, as SVG: hundreds of them are drawn in a second."""

from collections.abc import Sequence
from html import escape
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from cylforce.fleet.coordinates import Coordinate
from cylforce.signals.estimate import Array

WIDE, HIGH, EDGE = 320.0, 120.0, 6.0
LEFT, BELOW = 58.0, 15.0  # of the drawing with its scales
SPARK = (120.0, 26.0)
SHOWN = {"Pa": (1e-5, "bar"), "rad": (float(np.degrees(1.0)), "deg"), "s": (1e3, "ms"), "1": (100.0, "%")}
WORDS = {
    "J": "inertia",
    "X": "first moment, along",
    "Z": "first moment, across",
    "coulomb": "dry friction",
    "viscous": "viscous friction",
    "delay": "delay of the angle",
    "load_dependent": "friction under load",
    "stribeck": "extra friction at creep",
    "rocker": "bars of the linkage",
    "cylinder": "weight of the cylinder",
    "pressure_zero": "zero of the pressures",
    "angle_offset": "zero of the angle",
    "D_excess": "centrifugal term D",
    "E": "centrifugal term E",
}


class Curve(NamedTuple):
    """Course of a quantity, n values.

    t:     times [d]
    y:     values
    error: standard errors
    usual: mean and standard deviation of the type
    marks: times of changes
    ends:  names of the first and the last time
    daily: standard deviation from day to day of a healthy machine
    """

    t: Array
    y: Array
    error: Array
    usual: tuple[float, float]
    marks: Sequence[float] = ()
    ends: tuple[str, str] = ("", "")
    daily: float = 0.0


def factor_of(quantity: Coordinate) -> tuple[float, str]:
    """Return the factor on an SI value that is shown, and its unit."""
    return SHOWN.get(quantity.unit, (1.0, quantity.unit))


def title_of(quantity: Coordinate) -> str:
    """Return the quantity in words, with its unit."""
    return f"{quantity.at}: {WORDS.get(quantity.quantity, quantity.quantity)} [{factor_of(quantity)[1]}]"


def _scaled(values: Array, low: float, high: float, begin: float, end: float) -> Array:
    return np.asarray(begin + (values - low) / max(high - low, 1e-30) * (end - begin))


def _range(curve: Curve) -> tuple[float, float]:
    low, high = float(np.min(curve.y - curve.error)), float(np.max(curve.y + curve.error))
    room = 0.1 * max(high - low, 1e-9 * abs(high), 1e-30)
    return low - room, high + room


def course_svg(title: str, curve: Curve) -> Markup:
    """Return values with error bars over time.

    The type's usual range is behind them, changes are lines, a bar at the left is the usual difference from day to day.
    """
    low, high = _range(curve)
    first, last = float(curve.t[0]), float(max(curve.t[-1], curve.t[0] + 1e-9))
    x = _scaled(curve.t, first, last, LEFT + EDGE, WIDE - EDGE)
    y, up, down = (_scaled(v, low, high, HIGH - EDGE, EDGE) for v in _with_errors(curve))
    mean, spread = curve.usual
    band = np.clip(_scaled(np.array([mean + spread, mean - spread]), low, high, HIGH - EDGE, EDGE), 0.0, HIGH)
    parts = [
        f'<rect class="usual" x="{LEFT}" y="{band[0]:.1f}" width="{WIDE - LEFT}" height="{band[1] - band[0]:.1f}"/>'
    ]
    half = min(curve.daily / max(high - low, 1e-30) * (HIGH - 2.0 * EDGE), HIGH / 2.0)
    parts.append(f'<rect class="days" x="{LEFT}" y="{HIGH / 2.0 - half:.1f}" width="4" height="{2.0 * half:.1f}"/>')
    for mark in curve.marks:
        at = float(_scaled(np.array([mark]), first, last, LEFT + EDGE, WIDE - EDGE)[0])
        parts.append(f'<line class="mark" x1="{at:.1f}" x2="{at:.1f}" y1="0" y2="{HIGH}"/>')
    for k in range(len(x)):
        parts.append(f'<line class="error" x1="{x[k]:.1f}" x2="{x[k]:.1f}" y1="{up[k]:.1f}" y2="{down[k]:.1f}"/>')
        parts.append(f'<circle cx="{x[k]:.1f}" cy="{y[k]:.1f}" r="2.6"/>')
    for value, at in ((high, EDGE + 8.0), (low, HIGH - EDGE)):
        parts.append(f'<text x="{LEFT - 4.0}" y="{at:.1f}">{_number(value)}</text>')
    for called, place in zip(curve.ends, (f'class="low" x="{LEFT}"', f'x="{WIDE}"'), strict=True):
        parts.append(f'<text {place} y="{HIGH + 12.0}">{escape(called)}</text>')
    inside, box = "".join(parts), f"0 0 {WIDE} {HIGH + BELOW}"
    named = f'<svg class="course" viewBox="{box}" role="img" aria-label="{escape(title)}">{inside}</svg>'
    return Markup(named)  # noqa: S704 - our own drawing; the title is escaped


def _number(value: float) -> str:
    """Return a short text of a number, without a power of ten as long as it fits."""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:.3g}"


def _with_errors(curve: Curve) -> tuple[Array, Array, Array]:
    return curve.y, curve.y + curve.error, curve.y - curve.error


def spark_svg(curve: Curve) -> Markup:
    """Return a course small enough for a line of text."""
    wide, high = SPARK
    low, most = _range(curve)
    x = _scaled(curve.t, float(curve.t[0]), float(max(curve.t[-1], curve.t[0] + 1e-9)), 3.0, wide - 3.0)
    y = _scaled(curve.y, low, most, high - 3.0, 3.0)
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    ends = f'<circle cx="{x[-1]:.1f}" cy="{y[-1]:.1f}" r="2.4"/>'
    drawn = (
        f'<svg class="spark" viewBox="0 0 {wide} {high}" aria-hidden="true"><polyline points="{points}"/>{ends}</svg>'
    )
    return Markup(drawn)  # noqa: S704 - numbers only


def spread_svg(title: str, values: Array, usual: tuple[float, float, float], far: Sequence[bool]) -> Markup:
    """Return machines of a type along a line, with the usual range between machines and from day to day.

    far: whether each machine changed
    """
    mean, between, days = usual
    low = float(min(np.min(values), mean - 2.0 * between))
    high = float(max(np.max(values), mean + 2.0 * between))
    room = 0.05 * max(high - low, 1e-30)
    low, high = low - room, high + room
    x = _scaled(values, low, high, EDGE, WIDE - EDGE)
    bars = _scaled(np.array([mean - between, mean + between, mean - days, mean + days]), low, high, EDGE, WIDE - EDGE)
    parts = [
        f'<rect class="usual" x="{bars[0]:.1f}" y="4" width="{bars[1] - bars[0]:.1f}" height="30"/>',
        f'<rect class="days" x="{bars[2]:.1f}" y="28" width="{max(bars[3] - bars[2], 0.8):.1f}" height="6"/>',
    ]
    for k in range(len(x)):
        kind = ' class="far"' if far[k] else ""
        parts.append(f'<circle{kind} cx="{x[k]:.1f}" cy="{12.0 + 9.0 * ((k * 7) % 3) / 2.0:.1f}" r="2.4"/>')
    parts.append(
        f'<text class="low" x="{EDGE}" y="48">{_number(low)}</text>'
        f'<text x="{WIDE - EDGE}" y="48">{_number(high)}</text>'
    )
    inside = "".join(parts)
    named = f'<svg class="course" viewBox="0 0 {WIDE} 52" role="img" aria-label="{escape(title)}">{inside}</svg>'
    return Markup(named)  # noqa: S704 - our own drawing; the title is escaped
