"""Write the records in transactions, each whole or not at all, and restore the service's memory from them."""

import json
import sqlite3
from typing import NamedTuple

from cylforce.files.checkpoint import packed, unpacked
from cylforce.records.audit import Audit, append, append_if_changed
from cylforce.service.booking import Weighed
from cylforce.service.commands import Scale
from cylforce.service.loading.cycle import LastBucket
from cylforce.service.loading.truck import KEPT, Bucket, Truck
from cylforce.service.memory import Memory
from cylforce.signals.estimate import Booking

OPERATOR = "operator"  # in the audit trail: commands over SDO that need no code
BY_HAND = "BY_HAND"  # status of a booking that the operator entered
RUNNING, STOPPED, INTERRUPTED = "running", "stopped", "interrupted"  # how a start is or ended
# us in which no machine dumps a bucket, fills it and lifts it again; excavators need 15 s and more for a cycle.
SHORTEST_CYCLE_US = 12_000_000


class Start(NamedTuple):
    """A start of the service.

    t_us: time [us]
    version: cylforce's version
    machine: name of the machine
    who: user that started it
    now: (subject, present value) to be entered into the audit trail if it has changed since the last start
    """

    t_us: int
    version: str
    machine: str
    who: str = ""
    now: tuple[tuple[str, str], ...] = ()


class BookedBucket(NamedTuple):
    """A booking with further recorded values.

    booking: the booking
    cycle: length of its cycle [s], time in contact [s], largest soil force [N]
    drift: weight that the empty bucket would show without the adaptation [kg]
    status: status of the weight in words
    """

    booking: Booking
    cycle: LastBucket
    drift: float
    status: str


class Change(NamedTuple):
    """A change of the service's memory.

    t_us: time of the change [us]
    kept: memory after the change
    booked: the booking that changed it; None: another change
    words: changes by an operator; "": none
    final: the last booking, when the bucket has returned and its weight is final
    """

    t_us: int
    kept: Memory
    booked: BookedBucket | None
    words: str
    final: Booking | None = None


def begin(connection: sqlite3.Connection, start: Start) -> tuple[int, Memory]:
    """Record a new start; return its id and the restored memory. A start that never ended becomes "interrupted".

    Values of `start.now` that have changed since the last start are entered into the audit trail.
    """
    connection.execute("BEGIN IMMEDIATE")
    connection.execute("UPDATE starts SET how = ? WHERE how = ?", (INTERRUPTED, RUNNING))
    values = (start.t_us, RUNNING, start.version, start.machine)
    row = connection.execute("INSERT INTO starts (begun_us, how, version, machine) VALUES (?, ?, ?, ?)", values)
    for subject, value in start.now:
        append_if_changed(connection, Audit(start.t_us, start.who, f"{subject}: {value}"), f"{subject}: ")
    connection.execute("COMMIT")
    return int(row.lastrowid or 0), restore(connection, start.t_us)


def restore(connection: sqlite3.Connection, t_us: int) -> Memory:
    """Return the service's memory as it was written last.

    The truck's buckets are those of its bookings. A bucket that was weighed and not yet booked counts as the same at
    the present time `t_us` [us] if no other can have been filled meanwhile, within SHORTEST_CYCLE_US. Otherwise its
    mass becomes `Memory.lost`. The records have only the standard error of the dumped mass: the restored booking has it
    for all three of its masses.
    """
    last = connection.execute(
        "SELECT number, t_us, gross, standard_error, carry_back + zero, standard_error, mass + tare, standard_error "
        "FROM bookings ORDER BY id DESC LIMIT 1"
    )
    booking = next((Booking(*row) for row in last), None)
    kept = "SELECT zero, tare, truck, target, product, attachment, hanging, hanging_us, part, first, trailer FROM kept"
    row = connection.execute(kept).fetchone()
    if row is None:
        return Memory(booking=booking)
    zero, tare, number, target, product, tool, weighed, since_us, part, first, trailer = row
    found = json.loads(weighed) if weighed else None
    # earlier versions wrote a list that begins with the mass: such a load is reported as not booked
    hanging = unpacked(Weighed, found) if isinstance(found, dict) else None
    lost = float(found[0]) if isinstance(found, list) else 0.0
    sums = (
        "SELECT coalesce(sum(mass), 0.0), count(*), coalesce(sum(mass) FILTER (WHERE part = ?), 0.0) FROM bookings "
        "WHERE truck = ? AND accepted"
    )
    total, filled, in_part = connection.execute(sums, (part, number)).fetchone()
    listed = "SELECT number, mass, accepted, part FROM bookings WHERE truck = ? ORDER BY id DESC LIMIT ?"
    rows = connection.execute(listed, (number, KEPT)).fetchall()
    buckets = tuple(
        Bucket(number=booked, mass=mass, accepted=bool(accepted), part=into)
        for booked, mass, accepted, into in reversed(rows)
    )
    truck = Truck(
        number=number,
        target=target,
        product=product,
        total=total,
        filled=filled,
        buckets=buckets,
        part=part,
        in_part=in_part,
        first=first,
        trailer=trailer,
    )
    scale = Scale(zero=zero, tare=tare)
    memory = Memory(scale=scale, truck=truck, booking=booking, tool=tool, hanging=hanging, lost=lost)
    return memory if 0 <= t_us - since_us <= SHORTEST_CYCLE_US else memory.emptied()


def write(connection: sqlite3.Connection, start: int, change: Change) -> None:
    """Write one change as one transaction; `start`: id of the start of the service, as from `begin`."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        _write(connection, start, change)
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def write_audit(connection: sqlite3.Connection, audit: Audit) -> int:
    """Write one audit entry as one transaction; return its number."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        number = append(connection, audit)
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise
    return number


def _write(connection: sqlite3.Connection, start: int, change: Change) -> None:
    """Write a change inside a transaction: truck, booking, final weights, cancelled buckets, memory, audit entry.

    Trucks with a lower number than the present one are closed.

    start: id of the start of the service, as from `begin`
    """
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
    scale, hanging = change.kept.scale, change.kept.hanging
    connection.execute(
        "INSERT OR REPLACE INTO kept (id, zero, tare, attachment, truck, target, product, part, first, trailer, "
        "hanging, hanging_us) VALUES (1, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        (
            scale.zero,
            scale.tare,
            change.kept.tool,
            truck.number,
            truck.target,
            truck.product,
            truck.part,
            truck.first,
            truck.trailer,
            "" if hanging is None else json.dumps(packed(hanging)),
            0 if hanging is None else change.t_us,
        ),
    )
    if change.words:
        row = (start, change.t_us, change.words)
        connection.execute("INSERT INTO changes (start, t_us, words) VALUES (?, ?, ?)", row)
        append(connection, Audit(change.t_us, OPERATOR, change.words))


def _book(connection: sqlite3.Connection, start: int, kept: Memory, booked: BookedBucket) -> None:
    """Record a booking, with the net mass [kg]: dumped mass less tare. A second time it changes nothing.

    start: id of the start of the service, as from `begin`
    kept: memory after the booking: scale (zero and tare [kg]), truck, attachment
    """
    booking, cycle, scale, truck = booked.booking, booked.cycle, kept.scale, kept.truck
    connection.execute(
        "INSERT OR IGNORE INTO bookings (start, number, t_us, truck, product, part, mass, standard_error, gross, "
        "carry_back, cycle, contact, peak, zero, tare, attachment, drift, status) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, "
        "?, ?, ?, ?, ?, ?, ?, ?, ?)",
        (
            start,
            booking.number,
            booking.t_us,
            truck.number,
            truck.product,
            truck.part,
            booking.dumped - scale.tare,
            booking.dumped_error,
            booking.mass,
            booking.carry_back - scale.zero,
            cycle.cycle,
            cycle.contact,
            cycle.peak,
            scale.zero,
            scale.tare,
            kept.tool,
            booked.drift,
            booked.status,
        ),
    )


def _finish(connection: sqlite3.Connection, start: int, booking: Booking) -> None:
    """Replace the weights [kg] of a booking by the final ones, once, with the zero and the tare of its time.

    start: id of the start of the service, as from `begin`
    """
    values = (booking.dumped, booking.dumped_error, booking.mass, booking.carry_back, start, booking.number)
    connection.execute(
        "UPDATE bookings SET mass = ? - tare, standard_error = ?, gross = ?, carry_back = ? - zero, final = 1 "
        "WHERE start = ? AND number = ? AND NOT final",
        values,
    )


def end(connection: sqlite3.Connection, start: int, t_us: int) -> None:
    """Record that a start has ended properly, at the time `t_us` [us]; `start`: its id, as from `begin`."""
    connection.execute("UPDATE starts SET ended_us = ?, how = ? WHERE id = ?", (t_us, STOPPED, start))
