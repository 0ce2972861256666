"""Drawing of the arm with every pin in three postures, as self-contained SVG.

It is a picture, part of a page, or a sheet to take to the machine.
"""

from collections.abc import Iterable, Sequence
from html import escape
from itertools import chain
from math import isfinite

from cylforce.mechanics.machine import Machine
from cylforce.mechanics.outline import NamedPin, Outline, Place, outline, pin_list
from cylforce.programs.description.arm import postures

PANEL = 460.0  # pixels: width that the widest posture takes
GAP, MARGIN = 30.0, 46.0
LINE = 17.0  # between two lines of the legend
LABEL = 13.0  # from a pin to the middle of its number
TITLES = ("lowest angles", "middle", "highest angles")
BARS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)  # m, of the scale
BODIES = ("#1668b8", "#e06c00", "#2c8a4b", "#8a4fbf", "#b0404f")
INK, PALE, STEEL = "#1d2733", "#7b8794", "#5a6673"
AROUND = [complex(*z) for z in ((1, 1), (-1, 1), (1, -1), (-1, -1), (1.5, 0), (-1.5, 0), (0, 1.5), (0, -1.5))]


def drawing(machine: Machine) -> str:
    """Return the SVG."""
    seen = [outline(machine, theta) for theta in postures(machine)]
    boxes = [_box(each) for each in seen]
    scale = PANEL / max(*(b[1] - b[0] for b in boxes), *(b[3] - b[2] for b in boxes))
    height = scale * max(b[3] - b[2] for b in boxes) + 2.0 * MARGIN
    parts: list[str] = []
    left = GAP
    for each, box, title in zip(seen, boxes, TITLES, strict=True):
        parts += _panel(each, box, scale, (left, height), title)
        left += scale * (box[1] - box[0]) + GAP + 2.0 * MARGIN
    width = max(left, 3 * 380.0)
    pins, rows = pin_list(machine), -(-len(pin_list(machine)) // 3)
    parts += _scale_bar(scale, height)
    parts += chain.from_iterable(_entry(k, pin, machine, rows, height, width) for k, pin in enumerate(pins))
    total = height + 56.0 + rows * LINE
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {total:.0f}" font-family="sans-serif"'
    name = escape(f"{machine.name}: arm and pins in three postures")
    ground = f'<rect width="{width:.0f}" height="{total:.0f}" fill="white"/>'
    return "\n".join([f'{head} font-size="12" role="img" aria-label="{name}">', ground, *parts, "</svg>\n"])


def _box(each: Outline) -> tuple[float, float, float, float]:
    known = [p for p in each.pins if _closed([p])]
    x, z = [p.real for p in known], [p.imag for p in known]
    return min(x), max(x), min(z), max(z)


def _panel(
    each: Outline, box: tuple[float, float, float, float], scale: float, corner: tuple[float, float], title: str
) -> Iterable[str]:
    left, height = corner

    def on(z: Place) -> Place:
        """Return a position on the sheet, y downwards."""
        x = left + MARGIN + scale * (z.real - box[0])
        return complex(x, height - MARGIN - scale * (z.imag - box[2]))

    middle = left + MARGIN + scale * (box[1] - box[0]) / 2.0
    yield f'<text x="{middle:.1f}" y="18" text-anchor="middle" fill="{PALE}">{title}</text>'
    yield _polygon([on(z) for z in each.chassis], PALE, 0.2)
    for k, corners in enumerate(each.links):
        yield _polygon([on(z) for z in corners], BODIES[k % len(BODIES)], 0.22)
    for corners in filter(_closed, each.rockers):
        yield _polygon([on(z) for z in corners], STEEL, 0.35)
    for a, b in filter(_closed, each.bars):
        yield _line(on(a), on(b), STEEL, 4.0)
    for a, b in filter(_closed, each.cylinders):
        yield _line(on(a), on(b), INK, 2.0)
        yield _line(on(a), on(a + 0.55 * (b - a)), INK, 6.0)
    yield from _marks([on(z) for z in each.pins])


def _closed(places: Sequence[Place]) -> bool:
    """Return whether all positions are finite; they are not where a linkage cannot be closed."""
    return all(isfinite(abs(z)) for z in places)


def _marks(pins: Sequence[Place]) -> Iterable[str]:
    """Yield each pin as a ring with its number on the side with the most room."""
    taken = [pin for pin in pins if _closed([pin])]
    for number, pin in [(k, pin) for k, pin in enumerate(pins, 1) if _closed([pin])]:
        best = max(AROUND, key=lambda d: min(abs(pin + LABEL * d - z) for z in taken if z != pin))
        spot = pin + LABEL * best
        taken.append(spot)
        centre = f'cx="{pin.real:.1f}" cy="{pin.imag:.1f}"'
        yield f'<circle {centre} r="3.2" fill="white" stroke="{INK}" stroke-width="1.4"/>'
        yield (
            f'<text x="{spot.real:.1f}" y="{spot.imag + 4.0:.1f}" text-anchor="middle" fill="{INK}" stroke="white" '
            f'stroke-width="3" paint-order="stroke">{number}</text>'
        )


def _polygon(corners: Sequence[Place], colour: str, opacity: float) -> str:
    shown = " ".join(f"{z.real:.1f},{z.imag:.1f}" for z in corners)
    return (
        f'<polygon points="{shown}" fill="{colour}" fill-opacity="{opacity}" stroke="{colour}" stroke-width="1.5" '
        'stroke-linejoin="round"/>'
    )


def _line(a: Place, b: Place, colour: str, width: float) -> str:
    ends = f'x1="{a.real:.1f}" y1="{a.imag:.1f}" x2="{b.real:.1f}" y2="{b.imag:.1f}"'
    return f'<line {ends} stroke="{colour}" stroke-width="{width}" stroke-linecap="round"/>'


def _scale_bar(scale: float, height: float) -> Iterable[str]:
    length = max(bar for bar in BARS if bar == BARS[0] or bar * scale < 160.0)
    y, end = height + 18.0, GAP + length * scale
    yield _line(complex(GAP, y), complex(end, y), INK, 2.0)
    for x in (GAP, end):
        yield _line(complex(x, y - 5.0), complex(x, y + 5.0), INK, 2.0)
    yield f'<text x="{end + 8.0:.1f}" y="{y + 4.0:.1f}" fill="{INK}">{length:g} m</text>'


def _entry(k: int, pin: NamedPin, machine: Machine, rows: int, height: float, width: float) -> Iterable[str]:
    """Yield a line of the legend: number, name, body and position in its frame [m]."""
    x, y = GAP + (k // rows) * (width - 2.0 * GAP) / 3.0, height + 52.0 + (k % rows) * LINE
    names = [link.name for link in machine.links]
    colour = BODIES[names.index(pin.body) % len(BODIES)] if pin.body in names else PALE
    where = "moves with the rocker"
    if pin.body is not None and pin.local is not None:
        where = f"{pin.body} ({pin.local.real:.3f}, {pin.local.imag:.3f}) m"
    yield (
        f'<text x="{x:.1f}" y="{y:.1f}" fill="{INK}"><tspan font-weight="bold">{k + 1}</tspan> {escape(pin.name)} '
        f'<tspan fill="{colour}">{escape(where)}</tspan></text>'
    )
