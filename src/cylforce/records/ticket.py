"""Ticket of a truck: its loads and labels, their standard error, and whether it is a copy."""

import sqlite3
from typing import NamedTuple

from cylforce.files.atomic import RecordingError
from cylforce.records.queries import bookings, truck
from cylforce.records.writing import BY_HAND


class TicketLine(NamedTuple):
    """A bucket on a ticket.

    number: number of the booking
    t_us: time of the booking [us]
    product: name or number of the product
    mass: its mass [kg]
    standard_error: of the mass [kg]
    by_hand: whether the operator entered the mass
    part: part of the truck
    """

    number: int
    t_us: int
    product: str
    mass: float
    standard_error: float
    by_hand: bool = False
    part: int = 1


class PartSum(NamedTuple):
    """Load of one product in one part of a truck.

    part: number of the part
    product: name or number of the product
    mass: its mass [kg]
    loads: number of buckets
    """

    part: int
    product: str
    mass: float
    loads: int


class Ticket(NamedTuple):
    """A ticket.

    number: its number
    t_us: time at which it was first made [us]
    printed: 1 for the original, more for a copy
    machine: name of the machine
    truck: number of the truck
    target: target of the truck [kg]
    labels: labels of the truck, by name
    lines: buckets that count
    mass: their mass [kg]
    standard_error: sum of the buckets' standard errors, of which most is common to all [kg]
    trailer: target of the trailer [kg]
    """

    number: int
    t_us: int
    printed: int
    machine: str
    truck: int
    target: float
    labels: dict[str, str]
    lines: tuple[TicketLine, ...]
    mass: float
    standard_error: float
    trailer: float = 0.0

    @property
    def shares(self) -> tuple[PartSum, ...]:
        """Return mass and number of the buckets of each part and product, in the order in which they first came.

        There is one entry where nothing was split.
        """
        masses: dict[tuple[int, str], list[float]] = {}
        for line in self.lines:
            masses.setdefault((line.part, line.product), []).append(line.mass)
        return tuple(
            PartSum(part=part, product=product, mass=sum(of_both), loads=len(of_both))
            for (part, product), of_both in masses.items()
        )


def ticket(connection: sqlite3.Connection, number: int, t_us: int, printing: bool = True) -> Ticket:
    """Return the ticket of a truck, without its cancelled buckets; the first printing gives it its number.

    Each printing is counted in the records. Raises RecordingError for a truck without accepted buckets, or without a
    ticket where nothing is printed.

    number: number of the truck
    t_us: present time [us]
    printing: whether it is printed now
    """
    loaded, rows = truck(connection, number), [row for row in bookings(connection, truck=number) if row["accepted"]]
    if loaded is None or not rows:
        raise RecordingError(f"truck {number}: has no booked bucket, so there is no ticket")
    ticket_number, first_us, printed = _numbered(connection, number, t_us, printing)
    lines = tuple(
        TicketLine(
            number=row["number"],
            t_us=row["t_us"],
            product=row["product_name"] or _product(row["product"]),
            mass=row["mass"],
            standard_error=row["standard_error"],
            by_hand=row["status"] == BY_HAND,
            part=row["part"],
        )
        for row in rows
    )
    return Ticket(
        number=ticket_number,
        t_us=first_us,
        printed=printed,
        machine=connection.execute("SELECT machine FROM starts ORDER BY id DESC LIMIT 1").fetchone()[0],
        truck=number,
        target=loaded["target"],
        labels={name: loaded[name] for name in ("customer", "job", "operator", "note")},
        lines=lines,
        mass=sum(line.mass for line in lines),
        standard_error=sum(line.standard_error for line in lines),
        trailer=loaded["trailer"],
    )


def _product(number: int) -> str:
    """Return the number of a product as text; "" for none."""
    return str(number) if number else ""


def _numbered(connection: sqlite3.Connection, number: int, t_us: int, printing: bool) -> tuple[int, int, int]:
    """Return number of the ticket, time of its first printing [us], and how often it was printed, this time included.

    Raises RecordingError where it was never printed.

    number: number of the truck
    t_us: present time [us]
    printing: whether it is printed now, which is counted
    """
    if printing:
        connection.execute(
            "INSERT INTO tickets (truck, t_us, printed) VALUES (?, ?, 1) ON CONFLICT (truck) DO UPDATE SET "
            "printed = printed + 1",
            (number, t_us),
        )
    row = connection.execute("SELECT number, t_us, printed FROM tickets WHERE truck = ?", (number,)).fetchone()
    if row is None:
        raise RecordingError(f"truck {number}: no ticket was printed yet")
    return row[0], row[1], row[2]
