"""The audit trail: who changed what and when, as a chain of hashes. An entry that was changed, removed or put in
between breaks the chain from there on; how long it must be at least is said on the bus (21A0h:4)."""

import hashlib
import json
import sqlite3
from collections.abc import Iterator
from typing import NamedTuple


class Audit(NamedTuple):
    """What is to be entered: when [us], who, what."""

    t_us: int
    who: str
    what: str


class Entry(NamedTuple):
    """One entry: its number, from 1 on without gaps; `digest`: SHA-256 of the entry before and all of this one."""

    number: int
    t_us: int
    who: str
    what: str
    digest: str


BEGIN = "0" * 64  # the digest before the first entry


def digest(before: str, number: int, said: Audit) -> str:
    """The chain's next hash."""
    text = json.dumps([before, number, *said], separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def enter(connection: sqlite3.Connection, said: Audit) -> int:
    """Append an entry inside the caller's transaction, or as one of its own; its number."""
    last = connection.execute("SELECT number, digest FROM audit ORDER BY number DESC LIMIT 1").fetchone()
    number, before = (last[0] + 1, last[1]) if last else (1, BEGIN)
    row = (number, *said, digest(before, number, said))
    connection.execute("INSERT INTO audit (number, t_us, who, what, digest) VALUES (?, ?, ?, ?, ?)", row)
    return int(number)


def enter_if_other(connection: sqlite3.Connection, said: Audit, about: str) -> None:
    """Append an entry whose text begins with `about`, unless the last one about it says the same."""
    found = "SELECT what FROM audit WHERE substr(what, 1, length(?)) = ? ORDER BY number DESC LIMIT 1"
    last = connection.execute(found, (about, about)).fetchone()
    if last is None or last[0] != said.what:
        enter(connection, said)


def entries(connection: sqlite3.Connection) -> Iterator[Entry]:
    """All entries, oldest first."""
    for row in connection.execute("SELECT number, t_us, who, what, digest FROM audit ORDER BY number"):
        yield Entry(*row)


def length(connection: sqlite3.Connection) -> int:
    """Number of the last entry."""
    return int(connection.execute("SELECT coalesce(max(number), 0) FROM audit").fetchone()[0])


def first_broken(connection: sqlite3.Connection) -> int | None:
    """Number of the first entry that does not follow from those before it; None: the chain is whole."""
    before, expected = BEGIN, 1
    for entry in entries(connection):
        said = Audit(entry.t_us, entry.who, entry.what)
        if entry.number != expected or entry.digest != digest(before, expected, said):
            return expected
        before, expected = entry.digest, expected + 1
    return None
