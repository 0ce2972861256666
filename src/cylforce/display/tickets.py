"""A ticket as a page to print, with a QR code of its figures."""

from datetime import UTC, datetime
from html import escape

import segno
from babel.dates import format_datetime
from babel.numbers import format_decimal

from cylforce.display.words import catalogue
from cylforce.records.export import iso
from cylforce.records.ticket import Ticket

PAGE = """<!doctype html>
<html lang="{language}"><head><meta charset="utf-8"><title>{title}</title>
<link rel="icon" href="/static/icon.svg"><link rel="stylesheet" href="/static/ticket.css"></head>
<body><main><h1>{title}</h1>{head}{qr}<table><thead><tr>{names}</tr></thead><tbody>{rows}</tbody></table>
<p class="total">{total}</p><p class="screen"><button id="print">{button}</button></p></main>
<script type="module" src="/static/ticket.js"></script></body></html>
"""


def ticket_page(made: Ticket, language: str) -> str:
    """The page."""
    say = catalogue(language).gettext
    copy = f" ({say('Copy')} {made.printed - 1})" if made.printed > 1 else ""
    head = {say("Machine"): made.machine, say("Truck"): str(made.truck), say("Time"): _time(made.t_us, language)}
    labels = {name: text for name, text in made.labels.items() if text}
    head |= {say(name.capitalize()): text for name, text in labels.items()}
    total = f"{say('Total')}: {_kg(made.mass, language)} kg ± {_kg(made.standard_error, language)} kg"
    return PAGE.format(
        language=language,
        title=f"{say('Ticket')} {made.number}{copy}",
        head="".join(f"<p><b>{escape(name)}:</b> {escape(text)}</p>" for name, text in head.items()),
        qr=segno.make(summary(made), error="m").svg_inline(scale=3, svgclass="qr"),
        names="".join(f"<th>{say(name)}</th>" for name in ("Number", "Time", "Product", "Weight")),
        rows="".join(_rows(made, language)),
        total=total,
        button=say("Print"),
    )


def _rows(made: Ticket, language: str) -> list[str]:
    say = catalogue(language).gettext
    marks = [f" ({say('by hand')})" if line.by_hand else "" for line in made.lines]
    cells = [
        (str(line.number), _time(line.t_us, language), line.product, f"{_kg(line.mass, language)} kg{mark}")
        for line, mark in zip(made.lines, marks, strict=True)
    ]
    return [f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in cells]


def summary(made: Ticket) -> str:
    """What the QR code says, as plain text that any reader shows."""
    figures = f"{made.mass:.1f} kg +- {made.standard_error:.1f} kg, {len(made.lines)} buckets"
    return f"cylforce ticket {made.number}\ntruck {made.truck}\n{figures}\n{iso(made.t_us)}"


def _kg(mass: float, language: str) -> str:
    return format_decimal(mass, "#,##0.0", locale=language)


def _time(t_us: int, language: str) -> str:
    return format_datetime(datetime.fromtimestamp(1e-6 * t_us, UTC), "short", locale=language) + " UTC"
