"""What is written into the records: transactions, each whole or not at all."""

import json
import sqlite3
from typing import NamedTuple

from cylforce.files.checkpoint import packed, unpacked
from cylforce.records.audit import Audit, enter, enter_if_other
from cylforce.service.booking import Weighed
from cylforce.service.loading.cycle import LastBucket
from cylforce.service.loading.truck import KEPT, Bucket, Truck
from cylforce.service.state import Memory, Scale
from cylforce.signals.estimate import Booking

OPERATOR = "operator"  # in the audit trail: commands over SDO that need no code
BY_HAND = "BY_HAND"  # status of a booking that the operator gave
RUNNING, STOPPED, INTERRUPTED = "running", "stopped", "interrupted"
# us: no machine dumps a bucket, fills it and lifts it again sooner; excavators need 15 s and more for a cycle
SHORTEST_CYCLE_US = 12_000_000


class Start(NamedTuple):
    """A start of the service: when [us], cylforce's version, the machine's name; who started it, and what is entered
    into the audit trail if it has changed since the last start: (what it is about, how it is now)."""

    t_us: int
    version: str
    machine: str
    who: str = ""
    now: tuple[tuple[str, str], ...] = ()


class BookedBucket(NamedTuple):
    """A booking with what is kept beside it: `drift` [kg] of the adaptation, `status` of the weight in words."""

    booking: Booking
    cycle: LastBucket
    drift: float
    status: str


class Change(NamedTuple):
    """What the service remembers since `t_us` [us], with the booking that changed it, or words on what did. `final` is
    the last booking as it is when the bucket has returned."""

    t_us: int
    kept: Memory
    booked: BookedBucket | None
    words: str
    final: Booking | None = None


def begin(connection: sqlite3.Connection, start: Start) -> tuple[int, Memory]:
    """A new start: its id, and what was kept. A start that never ended becomes "interrupted"."""
    connection.execute("BEGIN IMMEDIATE")
    connection.execute("UPDATE starts SET how = ? WHERE how = ?", (INTERRUPTED, RUNNING))
    values = (start.t_us, RUNNING, start.version, start.machine)
    row = connection.execute("INSERT INTO starts (begun_us, how, version, machine) VALUES (?, ?, ?, ?)", values)
    for about, how in start.now:
        enter_if_other(connection, Audit(start.t_us, start.who, f"{about}: {how}"), f"{about}: ")
    connection.execute("COMMIT")
    return int(row.lastrowid or 0), restored(connection, start.t_us)


def restored(connection: sqlite3.Connection, t_us: int) -> Memory:
    """What the service remembered when it wrote last. The truck's buckets are those of its bookings. A bucket that hung
    then is still the same at `t_us` [us] if no other can have been filled meanwhile."""
    last = connection.execute(
        "SELECT number, t_us, gross, standard_error, carry_back + zero, standard_error, mass + tare, standard_error "
        "FROM bookings ORDER BY id DESC LIMIT 1"
    )
    booking = next((Booking(*row) for row in last), None)
    kept = "SELECT zero, tare, truck, target, product, attachment, hanging, hanging_us, part, first, trailer FROM kept"
    row = connection.execute(kept).fetchone()
    if row is None:
        return Memory(booking=booking)
    zero, tare, number, target, product, tool, hung, since_us, *parts = row
    hanging = unpacked(Weighed, json.loads(hung)) if hung else None
    sums = (
        "SELECT coalesce(sum(mass), 0.0), count(*), coalesce(sum(mass) FILTER (WHERE part = ?), 0.0) FROM bookings "
        "WHERE truck = ? AND accepted"
    )
    total, filled, in_part = connection.execute(sums, (parts[0], number)).fetchone()
    listed = "SELECT number, mass, accepted, part FROM bookings WHERE truck = ? ORDER BY id DESC LIMIT ?"
    rows = connection.execute(listed, (number, KEPT)).fetchall()
    buckets = tuple(Bucket(found, mass, bool(accepted), part) for found, mass, accepted, part in reversed(rows))
    opened = Truck(number, target, product, total, filled, buckets, parts[0], in_part, *parts[1:])
    memory = Memory(Scale(zero, tare), opened, booking, tool, hanging)
    return memory if 0 <= t_us - since_us <= SHORTEST_CYCLE_US else memory.emptied()


def write(connection: sqlite3.Connection, start: int, change: Change) -> None:
    """One change as one transaction."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        _write(connection, start, change)
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def entered(connection: sqlite3.Connection, said: Audit) -> int:
    """One audit entry as one transaction; its number."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        number = enter(connection, said)
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise
    return number


def _write(connection: sqlite3.Connection, start: int, change: Change) -> None:
    truck = change.kept.truck
    connection.execute(
        "UPDATE trucks SET closed_us = ? WHERE closed_us IS NULL AND number < ?", (change.t_us, truck.number)
    )
    connection.execute(
        "INSERT INTO trucks (number, opened_us, target, trailer) VALUES (?, ?, ?, ?) "
        "ON CONFLICT DO UPDATE SET target = excluded.target, trailer = excluded.trailer",
        (truck.number, change.t_us, truck.first if truck.part > 1 else truck.target, truck.trailer),
    )
    if change.booked is not None:
        _book(connection, start, change.kept, change.booked)
    if change.final is not None:
        _finish(connection, start, change.final)
    for bucket in truck.buckets:
        connection.execute(
            "UPDATE bookings SET accepted = ? WHERE truck = ? AND number = ? AND accepted <> ?",
            (bucket.accepted, truck.number, bucket.number, bucket.accepted),
        )
    hanging = change.kept.hanging
    hung = ("", 0) if hanging is None else (json.dumps(packed(hanging)), change.t_us)
    place = (change.kept.tool, truck.number, truck.target, truck.product)
    values = (*change.kept.scale, *place, truck.part, truck.first, truck.trailer, *hung)
    connection.execute("INSERT OR REPLACE INTO kept VALUES (1, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", values)
    if change.words:
        row = (start, change.t_us, change.words)
        connection.execute("INSERT INTO changes (start, t_us, words) VALUES (?, ?, ?)", row)
        enter(connection, Audit(change.t_us, OPERATOR, change.words))


def _book(connection: sqlite3.Connection, start: int, kept: Memory, booked: BookedBucket) -> None:
    """The same booking a second time changes nothing."""
    booking, (zero, tare) = booked.booking, kept.scale
    weights = (booking.dumped - tare, booking.dumped_error, booking.mass, booking.carry_back - zero)
    place = (start, booking.number, booking.t_us, kept.truck.number, kept.truck.product, kept.truck.part)
    rest = (*booked.cycle, zero, tare, kept.tool, booked.drift, booked.status)
    connection.execute(
        "INSERT OR IGNORE INTO bookings (start, number, t_us, truck, product, part, mass, standard_error, gross, "
        "carry_back, cycle, contact, peak, zero, tare, attachment, drift, status) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, "
        "?, ?, ?, ?, ?, ?, ?, ?, ?)",
        (*place, *weights, *rest),
    )


def _finish(connection: sqlite3.Connection, start: int, booking: Booking) -> None:
    """The weights of a booking as they are at last, with the zero and the tare of its time; once."""
    values = (booking.dumped, booking.dumped_error, booking.mass, booking.carry_back, start, booking.number)
    connection.execute(
        "UPDATE bookings SET mass = ? - tare, standard_error = ?, gross = ?, carry_back = ? - zero, final = 1 "
        "WHERE start = ? AND number = ? AND NOT final",
        values,
    )


def end(connection: sqlite3.Connection, start: int, t_us: int) -> None:
    """The start has ended as it should."""
    connection.execute("UPDATE starts SET ended_us = ?, how = ? WHERE id = ?", (t_us, STOPPED, start))
