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


def ticket_page(ticket: Ticket, language: str, unit: MassUnit = KILOGRAM) -> str:
    """Return the page of a ticket in a language, with masses in a unit."""
    translate = catalogue(language).gettext
    copy = f" ({translate('Copy')} {ticket.printed - 1})" if ticket.printed > 1 else ""
    head = {
        translate("Machine"): ticket.machine,
        translate("Truck"): str(ticket.truck),
        translate("Time"): _time(ticket.t_us, language),
    }
    labels = {name: text for name, text in ticket.labels.items() if text}
    head |= {translate(name.capitalize()): text for name, text in labels.items()}
    total = (
        f"{translate('Total')}: {_mass(ticket.mass, language, unit)} ± {_mass(ticket.standard_error, language, unit)}"
    )
    return PAGE.format(
        language=language,
        title=f"{translate('Ticket')} {ticket.number}{copy}",
        head="".join(f"<p><b>{escape(name)}:</b> {escape(text)}</p>" for name, text in head.items()),
        qr=segno.make(summary(ticket, unit), error="m").svg_inline(scale=3, svgclass="qr"),
        names="".join(f"<th>{translate(name)}</th>" for name in ("Number", "Time", "Product", "Weight")),
        rows="".join(_rows(ticket, language, unit)),
        shares=_shares(ticket, language, unit),
        total=total,
        button=translate("Print"),
    )


def _rows(ticket: Ticket, language: str, unit: MassUnit) -> list[str]:
    """Return a row of the table for each bucket."""
    translate = catalogue(language).gettext
    marks = [f" ({translate('by hand')})" if line.by_hand else "" for line in ticket.lines]
    cells = [
        (str(line.number), _time(line.t_us, language), line.product, f"{_mass(line.mass, language, unit)}{mark}")
        for line, mark in zip(ticket.lines, marks, strict=True)
    ]
    return [f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in cells]


def _shares(ticket: Ticket, language: str, unit: MassUnit) -> str:
    """Return a table of the mass of each product in each part of the truck; "" where nothing was split."""
    if len(ticket.shares) < 2:
        return ""
    translate = catalogue(language).gettext
    names = (translate("Part"), translate("Product"), translate("Buckets"), translate("Target"), translate("Weight"))
    rows = []
    for share in ticket.shares:
        aim = ticket.target if share.part == 1 else ticket.trailer
        cells = (str(share.part), share.product, str(share.loads), _mass(aim, language, unit) if aim else "–")
        rows.append("".join(f"<td>{escape(cell)}</td>" for cell in (*cells, _mass(share.mass, language, unit))))
    head = "".join(f"<th>{name}</th>" for name in names)
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    return f'<table class="shares"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'


def summary(ticket: Ticket, unit: MassUnit = KILOGRAM) -> str:
    """Return the content of the QR code, as plain text that any reader shows."""
    mass, error = (f"{unit.text(kg)} {unit.symbol}" for kg in (ticket.mass, ticket.standard_error))
    figures = f"{mass} +- {error}, {len(ticket.lines)} buckets"
    return f"cylforce ticket {ticket.number}\ntruck {ticket.truck}\n{figures}\n{iso(ticket.t_us)}"


def _mass(mass: float, language: str, unit: MassUnit) -> str:
    """Return a mass [kg] as text in a unit and language."""
    shape = "#,##0" + ("." + "0" * unit.fine if unit.fine else "")
    return f"{format_decimal(mass / unit.kg, shape, locale=language)} {unit.symbol}"


def _time(t_us: int, language: str) -> str:
    """Return a time [us] as text in a language."""
    return format_datetime(datetime.fromtimestamp(1e-6 * t_us, UTC), "short", locale=language) + " UTC"
