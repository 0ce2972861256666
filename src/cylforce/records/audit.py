"""The audit trail: who changed what and when, as a chain of hashes.

An entry that was changed, removed or inserted breaks the chain from there on. The number of the last entry is shown on
the bus (21A0h:4), so that a trail that was cut off is detected as well.
"""

import hashlib
import json
import sqlite3
from collections.abc import Iterator
from typing import NamedTuple


class Audit(NamedTuple):
    """Change to be entered.

    t_us: time [us]
    who: user or role
    what: the change in words
    """

    t_us: int
    who: str
    what: str


class AuditEntry(NamedTuple):
    """One entry.

    number: from 1 on without gaps
    t_us: time [us]
    who: user or role
    what: the change in words
    digest: SHA-256 of the entry before and all of this one
    """

    number: int
    t_us: int
    who: str
    what: str
    digest: str


BEGIN = "0" * 64  # the digest before the first entry


def digest(before: str, number: int, audit: Audit) -> str:
    """Return the next hash of the chain: SHA-256, in hex, of the digest before, number, time, who and what.

    before: digest of the entry before; BEGIN before the first one
    number: number of the entry
    audit: content of the entry
    """
    text = json.dumps([before, number, audit.t_us, audit.who, audit.what], separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def append(connection: sqlite3.Connection, audit: Audit) -> int:
    """Append an entry inside the caller's transaction, or as one of its own; return its number."""
    last = connection.execute("SELECT number, digest FROM audit ORDER BY number DESC LIMIT 1").fetchone()
    number, before = (last[0] + 1, last[1]) if last else (1, BEGIN)
    row = (number, audit.t_us, audit.who, audit.what, digest(before, number, audit))
    connection.execute("INSERT INTO audit (number, t_us, who, what, digest) VALUES (?, ?, ?, ?, ?)", row)
    return int(number)


def append_if_changed(connection: sqlite3.Connection, audit: Audit, subject: str) -> None:
    """Append an entry whose text begins with `subject`, unless the last entry about it is the same."""
    query = "SELECT what FROM audit WHERE substr(what, 1, length(?)) = ? ORDER BY number DESC LIMIT 1"
    last = connection.execute(query, (subject, subject)).fetchone()
    if last is None or last[0] != audit.what:
        append(connection, audit)


def entries(connection: sqlite3.Connection) -> Iterator[AuditEntry]:
    """Yield all entries, oldest first."""
    for row in connection.execute("SELECT number, t_us, who, what, digest FROM audit ORDER BY number"):
        yield AuditEntry(*row)


def last_number(connection: sqlite3.Connection) -> int:
    """Return the number of the last entry; 0: none."""
    return int(connection.execute("SELECT coalesce(max(number), 0) FROM audit").fetchone()[0])


def first_broken(connection: sqlite3.Connection) -> int | None:
    """Return the number of the first entry that is missing or does not follow from those before it.

    None: the chain is whole. Entries missing at its end are not detected.
    """
    before, expected = BEGIN, 1
    for entry in entries(connection):
        audit = Audit(t_us=entry.t_us, who=entry.who, what=entry.what)
        if entry.number != expected or entry.digest != digest(before, expected, audit):
            return expected
        before, expected = entry.digest, expected + 1
    return None
