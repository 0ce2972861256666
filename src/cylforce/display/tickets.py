"""A ticket as a page to print, with a QR code of its figures."""

from datetime import UTC, datetime
from html import escape

import segno
from babel.dates import format_datetime
from babel.numbers import format_decimal

from cylforce.display.words import catalogue
from cylforce.records.export import iso
from cylforce.records.ticket import Ticket
from cylforce.signals.units import KILOGRAM, MassUnit

PAGE = """<!doctype html>
<html lang="{language}"><head><meta charset="utf-8"><title>{title}</title>
<link rel="icon" href="/static/icon.svg"><link rel="stylesheet" href="/static/ticket.css"></head>
<body><main><h1>{title}</h1>{head}{qr}<table><thead><tr>{names}</tr></thead><tbody>{rows}</tbody></table>{shares}
<p class="total">{total}</p><p class="screen"><button id="print">{button}</button></p></main>
<script type="module" src="/static/ticket.js"></script></body></html>
"""


def ticket_page(made: Ticket, language: str, unit: MassUnit = KILOGRAM) -> str:
    """The page."""
    say = catalogue(language).gettext
    copy = f" ({say('Copy')} {made.printed - 1})" if made.printed > 1 else ""
    head = {say("Machine"): made.machine, say("Truck"): str(made.truck), say("Time"): _time(made.t_us, language)}
    labels = {name: text for name, text in made.labels.items() if text}
    head |= {say(name.capitalize()): text for name, text in labels.items()}
    total = f"{say('Total')}: {_mass(made.mass, language, unit)} ± {_mass(made.standard_error, language, unit)}"
    return PAGE.format(
        language=language,
        title=f"{say('Ticket')} {made.number}{copy}",
        head="".join(f"<p><b>{escape(name)}:</b> {escape(text)}</p>" for name, text in head.items()),
        qr=segno.make(summary(made, unit), error="m").svg_inline(scale=3, svgclass="qr"),
        names="".join(f"<th>{say(name)}</th>" for name in ("Number", "Time", "Product", "Weight")),
        rows="".join(_rows(made, language, unit)),
        shares=_shares(made, language, unit),
        total=total,
        button=say("Print"),
    )


def _rows(made: Ticket, language: str, unit: MassUnit) -> list[str]:
    say = catalogue(language).gettext
    marks = [f" ({say('by hand')})" if line.by_hand else "" for line in made.lines]
    cells = [
        (str(line.number), _time(line.t_us, language), line.product, f"{_mass(line.mass, language, unit)}{mark}")
        for line, mark in zip(made.lines, marks, strict=True)
    ]
    return [f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in cells]


def _shares(made: Ticket, language: str, unit: MassUnit) -> str:
    """What each part of the truck has got of each product, where it was split."""
    if len(made.shares) < 2:
        return ""
    say = catalogue(language).gettext
    names = (say("Part"), say("Product"), say("Buckets"), say("Target"), say("Weight"))
    rows = []
    for x in made.shares:
        aim = made.target if x.part == 1 else made.trailer
        cells = (str(x.part), x.product, str(x.loads), _mass(aim, language, unit) if aim else "–")
        rows.append("".join(f"<td>{escape(cell)}</td>" for cell in (*cells, _mass(x.mass, language, unit))))
    head = "".join(f"<th>{name}</th>" for name in names)
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    return f'<table class="shares"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'


def summary(made: Ticket, unit: MassUnit = KILOGRAM) -> str:
    """What the QR code says, as plain text that any reader shows."""
    mass, error = (f"{unit.text(x)} {unit.symbol}" for x in (made.mass, made.standard_error))
    figures = f"{mass} +- {error}, {len(made.lines)} buckets"
    return f"cylforce ticket {made.number}\ntruck {made.truck}\n{figures}\n{iso(made.t_us)}"


def _mass(mass: float, language: str, unit: MassUnit) -> str:
    shape = "#,##0" + ("." + "0" * unit.fine if unit.fine else "")
    return f"{format_decimal(mass / unit.kg, shape, locale=language)} {unit.symbol}"


def _time(t_us: int, language: str) -> str:
    return format_datetime(datetime.fromtimestamp(1e-6 * t_us, UTC), "short", locale=language) + " UTC"
