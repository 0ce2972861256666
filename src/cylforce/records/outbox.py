"""The outbox: bookings that a receiver has not confirmed, in the order in which they changed.

The records themselves are the outbox: every change of a booking gives it a new revision, and for each receiver the last
confirmed one is stored. So nothing is lost while the link is down, and nothing grows without a receiver.
"""

import sqlite3
from typing import NamedTuple

from cylforce.files.atomic import RecordingError
from cylforce.records.queries import JOINED
from cylforce.records.schema import version_of

AT_ONCE = 100  # bookings that are read at once; chosen
SINCE_VERSION = 3  # first version of the records with revisions


class Pending(NamedTuple):
    """A booking that was not confirmed.

    revision: its revision
    booking: its row, with the columns of `queries.JOINED`
    """

    revision: int
    booking: sqlite3.Row


def check_outbox(connection: sqlite3.Connection) -> None:
    """Raise RecordingError for records of an older version, which have no outbox."""
    if version_of(connection) < SINCE_VERSION:
        raise RecordingError("the records are of an older version: start `cylforce run --records` once, it renews them")


def pending(connection: sqlite3.Connection, receiver: str) -> list[Pending]:
    """Return the bookings with changes that a receiver has not confirmed, oldest change first, at most AT_ONCE."""
    rows = connection.execute(
        f"{JOINED} WHERE b.revision > coalesce((SELECT revision FROM passed_on WHERE receiver = ?), 0) "  # noqa: S608  # our own words
        "ORDER BY b.revision LIMIT ?",
        (receiver, AT_ONCE),
    )
    return [Pending(row["revision"], row) for row in rows]


def confirm(connection: sqlite3.Connection, receiver: str, revision: int) -> None:
    """Record that a receiver has confirmed every change up to a revision."""
    connection.execute("INSERT OR REPLACE INTO passed_on VALUES (?, ?)", (receiver, revision))
