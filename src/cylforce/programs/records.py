"""`cylforce records`: list, totals, ticket, labels and exports of the service's bookings."""

import json
import sqlite3
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from cylforce.can.clock import now_us
from cylforce.files.atomic import RecordingError, check_outputs
from cylforce.records.audit import entries, first_broken
from cylforce.records.export import export, iso, telematics
from cylforce.records.labels import label_truck, name_product, set_to_zero
from cylforce.records.queries import Total, bookings, last_truck, totals
from cylforce.records.schema import AUDITED, open_labels, open_reading, version_of
from cylforce.records.ticket import PartSum, Ticket, TicketLine, ticket
from cylforce.signals.units import KILOGRAM, MassUnit


def microseconds(text: str) -> int:
    """Return a time [us] from ISO text; without a zone it is UTC. Raises RecordingError."""
    if not text:
        return 0
    try:
        when = datetime.fromisoformat(text)
    except ValueError as error:
        raise RecordingError(f"--since {text}: is no time: write for example 2026-03-31 or 2026-03-31T06:00") from error
    return round(1e6 * (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp())


def list_bookings(path: Path, since: str, truck: int | None, last: int, unit: MassUnit = KILOGRAM) -> None:
    """Print a table of bookings."""
    with closing(open_reading(path)) as connection:
        rows = bookings(connection, microseconds(since), truck, last)
    names = ("booking", "time (UTC)", "truck", "product", unit.symbol, "+-", "cycle s", "peak kN", "status")
    table = _table(names)
    for row in rows:
        table.add_row(*_cells(row, unit))
    Console(highlight=False).print(table)


def _cells(row: sqlite3.Row, unit: MassUnit) -> list[str]:
    status = row["status"] if row["accepted"] else "cancelled"
    product = row["product_name"] or (str(row["product"]) if row["product"] else "")
    weights = (unit.text(row["mass"]), unit.text(row["standard_error"]))
    cycle = (f"{row['cycle']:.1f}", f"{1e-3 * row['peak']:.1f}")
    return [str(row["number"]), iso(row["t_us"]), str(row["truck"]), product, *weights, *cycle, status]


def _table(names: tuple[str, ...]) -> Table:
    table = Table()
    for name in names:
        table.add_column(name, justify="right")
    return table


def show_totals(path: Path, which: str, zero: bool, unit: MassUnit = KILOGRAM) -> None:
    """Print totals per product and over all; with `zero` they restart afterwards."""
    with closing(open_labels(path) if zero else open_reading(path)) as connection:
        found = totals(connection, which)
        if zero:
            set_to_zero(connection, which, now_us())
    table = _table(("product", "loads", unit.symbol))
    for line in [*found, Total(0, "all", sum(t.loads for t in found), sum(t.mass for t in found))]:
        name = line.name or (str(line.product) if line.product else "none")
        table.add_row(name, str(line.loads), unit.text(line.mass))
    Console(highlight=False).print(table)


def export_bookings(path: Path, output: Path, since: str) -> None:
    """Write the bookings to a file."""
    check_outputs((output,), (path,))
    with closing(open_reading(path)) as connection:
        print(f"{export(connection, output, microseconds(since))} bookings written to {output}")


def show_telematics(path: Path) -> None:
    """Print the two payload figures of ISO 15143-3 as JSON."""
    with closing(open_reading(path)) as connection:
        print(json.dumps(telematics(connection), indent=1))


def show_audit(path: Path, last: int) -> bool:
    """Print the audit trail, and return whether it is whole.

    last: number of entries; 0: all
    """
    with closing(open_reading(path)) as connection:
        if version_of(connection) < AUDITED:
            raise RecordingError(f"{path}: is older than the audit trail: it begins when the service runs with it")
        found, at = list(entries(connection)), first_broken(connection)
    table = _table(("entry", "time (UTC)", "who", "what"))
    for entry in found[-last:]:
        table.add_row(str(entry.number), iso(entry.t_us), entry.who, escape(entry.what))
    console = Console(highlight=False)
    console.print(table)
    whole = "the chain is whole" if at is None else f"[bold red]entry {at} is missing or was changed[/bold red]"
    console.print(f"{len(found)} entries; {whole}")
    return at is None


def print_ticket(path: Path, truck: int | None, unit: MassUnit = KILOGRAM) -> None:
    """Print a ticket as text; it counts as printed."""
    with closing(open_labels(path)) as connection:
        number = last_truck(connection) if truck is None else truck
        if number is None:
            raise RecordingError(f"{path}: has no booking yet, so there is no ticket")
        print(ticket_text(ticket(connection, number, now_us()), unit))


def ticket_text(made: Ticket, unit: MassUnit = KILOGRAM) -> str:
    """Return the ticket as lines."""
    copy = "" if made.printed == 1 else f" (copy {made.printed - 1})"
    head = [f"Ticket {made.number}{copy}, truck {made.truck}", f"{made.machine}, {iso(made.t_us)}"]
    labels = [f"{name}: {text}" for name, text in made.labels.items() if text]
    lines = [_line(x, unit) for x in made.lines]
    shares = [_share(x, made, unit) for x in made.shares] if len(made.shares) > 1 else []
    mass, error = (f"{unit.text(x)} {unit.symbol}" for x in (made.mass, made.standard_error))
    total = f"Total: {mass} +- {error} in {len(made.lines)} buckets"
    return "\n".join([*head, *labels, *lines, *shares, total])


def _line(x: TicketLine, unit: MassUnit) -> str:
    mark = "by hand" if x.by_hand else ""
    return f"{x.number:6d}  {iso(x.t_us)}  {unit.text(x.mass):>8} {unit.symbol}  {x.product} {mark}".rstrip()


def _share(x: PartSum, made: Ticket, unit: MassUnit) -> str:
    aim = made.target if x.part == 1 else made.trailer
    words = f"  target {unit.text(aim)} {unit.symbol}" if aim and len({s.part for s in made.shares}) > 1 else ""
    return f"Part {x.part}  {x.product}  {unit.text(x.mass)} {unit.symbol} in {x.loads} buckets{words}"


def label(path: Path, truck: int | None, labels: dict[str, str], product: tuple[int, str] | None) -> None:
    """Write the labels of a truck (of the last one without a number), or the name of a product."""
    with closing(open_labels(path)) as connection:
        if product is not None:
            name_product(connection, *product)
        if labels:
            number = last_truck(connection) if truck is None else truck
            label_truck(connection, 0 if number is None else number, labels)


def given(**labels: str | None) -> dict[str, Any]:
    """Return the labels that were given."""
    return {name: text for name, text in labels.items() if text is not None}
