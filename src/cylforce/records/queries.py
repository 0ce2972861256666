"""Read bookings, totals and trucks from the records."""

import sqlite3
from typing import NamedTuple

SHORT, SHIFT, GRAND = "short", "shift", "grand"  # totals
# Bookings, with how the run of the service is or ended, the data of the truck and the product's name.
JOINED = (
    "SELECT b.*, s.how AS start_how, t.customer, t.job, t.operator, t.note, p.name AS product_name FROM bookings b "
    "JOIN starts s ON s.id = b.start LEFT JOIN trucks t ON t.number = b.truck "
    "LEFT JOIN products p ON p.number = b.product"
)


class Total(NamedTuple):
    """Loads of a product, without cancelled ones.

    product: its number
    name: its name
    loads: number of loads
    mass: their mass [kg]
    """

    product: int
    name: str
    loads: int
    mass: float


class Cumulated(NamedTuple):
    """Sum of all loads ever, without cancelled ones.

    mass: their mass [kg]
    loads: number of loads
    t_us: time of the last booking [us]; None: never
    """

    mass: float
    loads: int
    t_us: int | None


def bookings(
    connection: sqlite3.Connection, since_us: int = 0, truck: int | None = None, last: int = -1
) -> list[sqlite3.Row]:
    """Return bookings, cancelled ones too, oldest first, with the columns of JOINED.

    since_us: from this time on [us]
    truck: of this truck only; None: of all
    last: so many of the latest ones; -1: all
    """
    where, values = " WHERE b.t_us >= ?", [since_us]
    if truck is not None:
        where, values = where + " AND b.truck = ?", [*values, truck]
    rows = connection.execute(f"{JOINED}{where} ORDER BY b.id DESC LIMIT ?", [*values, last])
    return rows.fetchall()[::-1]


def totals(connection: sqlite3.Connection, which: str = GRAND) -> list[Total]:
    """Return the number of loads and their mass [kg] for each product, in the order of the products' numbers.

    Cancelled bookings do not count.

    which: GRAND: all loads; SHORT or SHIFT: those since the operator set this total to zero
    """
    values: tuple[str, ...] = ()
    if which == GRAND:
        source = "totals"
    else:
        source = (
            "(SELECT product, count(*) AS loads, sum(mass) AS mass FROM bookings WHERE accepted AND id > "
            "coalesce((SELECT booking FROM marks WHERE name = ?), 0) GROUP BY product)"
        )
        values = (which,)
    rows = connection.execute(
        f"SELECT x.product, coalesce(p.name, ''), x.loads, x.mass FROM {source} x "  # noqa: S608  # our own words
        "LEFT JOIN products p ON p.number = x.product ORDER BY x.product",
        values,
    )
    return [Total(*row) for row in rows]


def cumulated(connection: sqlite3.Connection) -> Cumulated:
    """Return mass [kg] and number of all loads ever, the two figures that telematics requires."""
    mass, loads = connection.execute("SELECT coalesce(sum(mass), 0.0), coalesce(sum(loads), 0) FROM totals").fetchone()
    last = connection.execute("SELECT t_us FROM bookings WHERE accepted ORDER BY id DESC LIMIT 1").fetchone()
    return Cumulated(mass, loads, None if last is None else last[0])


def truck(connection: sqlite3.Connection, number: int) -> sqlite3.Row | None:
    """Return the row of the table `trucks` of a truck; None if there is none of this number."""
    row: sqlite3.Row | None = connection.execute("SELECT * FROM trucks WHERE number = ?", (number,)).fetchone()
    return row


def last_truck(connection: sqlite3.Connection) -> int | None:
    """Return the highest number of a truck with a booking, which is the one loaded last; None: there is none."""
    number = connection.execute("SELECT max(truck) FROM bookings").fetchone()[0]
    return None if number is None else int(number)
