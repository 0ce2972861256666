"""The ticket of a truck: what was loaded for whom, with its standard error, and whether it is a copy."""

import sqlite3
from typing import NamedTuple

from cylforce.files.atomic import RecordingError
from cylforce.records.queries import bookings, truck
from cylforce.records.writing import BY_HAND


class TicketLine(NamedTuple):
    """A bucket on a ticket: booking number, time [us], product, mass and standard error [kg], whether the operator gave
    the mass, and the part of the truck."""

    number: int
    t_us: int
    product: str
    mass: float
    standard_error: float
    by_hand: bool = False
    part: int = 1


class PartSum(NamedTuple):
    """What went into one part of a truck of one product: mass [kg], number of buckets."""

    part: int
    product: str
    mass: float
    loads: int


class Ticket(NamedTuple):
    """A ticket: number, when it was first made [us], 1 for the original and more for a copy; machine, truck, labels,
    buckets that count, their mass [kg]. `standard_error` [kg]: the sum of the buckets', of which most is common."""

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
        """The buckets by part and product, in the order of their coming; one where nothing was split."""
        found: dict[tuple[int, str], list[float]] = {}
        for line in self.lines:
            found.setdefault((line.part, line.product), []).append(line.mass)
        return tuple(PartSum(*place, sum(masses), len(masses)) for place, masses in found.items())


def ticket(connection: sqlite3.Connection, number: int, t_us: int, printing: bool = True) -> Ticket:
    """The ticket of truck `number`; the first `printing` gives it its number. Raises RecordingError for a truck without
    buckets, or without a ticket where nothing is printed."""
    found, rows = truck(connection, number), [row for row in bookings(connection, truck=number) if row["accepted"]]
    if found is None or not rows:
        raise RecordingError(f"truck {number}: has no booked bucket, so there is no ticket")
    made = _numbered(connection, number, t_us, printing)
    lines = tuple(
        TicketLine(
            r["number"],
            r["t_us"],
            r["product_name"] or _product(r["product"]),
            r["mass"],
            r["standard_error"],
            r["status"] == BY_HAND,
            r["part"],
        )
        for r in rows
    )
    machine = connection.execute("SELECT machine FROM starts ORDER BY id DESC LIMIT 1").fetchone()[0]
    labels = {name: found[name] for name in ("customer", "job", "operator", "note")}
    sums = sum(line.mass for line in lines), sum(line.standard_error for line in lines)
    return Ticket(*made, machine, number, found["target"], labels, lines, *sums, found["trailer"])


def _product(number: int) -> str:
    return str(number) if number else ""


def _numbered(connection: sqlite3.Connection, number: int, t_us: int, printing: bool) -> tuple[int, int, int]:
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
