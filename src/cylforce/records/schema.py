"""The tables of the records, and their migration from older versions."""

import sqlite3
from pathlib import Path

from cylforce.files.atomic import RecordingError, Report

# One entry a version, applied in order; an entry never changes once it was released. Masses in kg, forces in N, times
# in microseconds since 1970. `accepted` is 0 for a cancelled booking. A trigger, not a program, updates the totals.
MIGRATIONS = (
    """
    CREATE TABLE starts (id INTEGER PRIMARY KEY, begun_us INTEGER NOT NULL, ended_us INTEGER, how TEXT NOT NULL,
        version TEXT NOT NULL, machine TEXT NOT NULL) STRICT;
    CREATE TABLE trucks (number INTEGER PRIMARY KEY, opened_us INTEGER NOT NULL, closed_us INTEGER,
        target REAL NOT NULL, customer TEXT NOT NULL DEFAULT '', job TEXT NOT NULL DEFAULT '',
        operator TEXT NOT NULL DEFAULT '', note TEXT NOT NULL DEFAULT '') STRICT;
    CREATE TABLE products (number INTEGER PRIMARY KEY, name TEXT NOT NULL) STRICT;
    CREATE TABLE bookings (id INTEGER PRIMARY KEY, start INTEGER NOT NULL REFERENCES starts (id),
        number INTEGER NOT NULL, t_us INTEGER NOT NULL, truck INTEGER NOT NULL, product INTEGER NOT NULL,
        mass REAL NOT NULL, standard_error REAL NOT NULL, gross REAL NOT NULL, carry_back REAL, cycle REAL NOT NULL,
        contact REAL NOT NULL, peak REAL NOT NULL, zero REAL NOT NULL, tare REAL NOT NULL, attachment TEXT NOT NULL,
        drift REAL NOT NULL, status TEXT NOT NULL, accepted INTEGER NOT NULL DEFAULT 1, UNIQUE (start, number)) STRICT;
    CREATE INDEX bookings_by_time ON bookings (t_us);
    CREATE INDEX bookings_by_truck ON bookings (truck, number);
    CREATE TABLE totals (product INTEGER PRIMARY KEY, loads INTEGER NOT NULL, mass REAL NOT NULL) STRICT;
    CREATE TRIGGER booked AFTER INSERT ON bookings WHEN new.accepted BEGIN
        INSERT INTO totals VALUES (new.product, 1, new.mass)
        ON CONFLICT DO UPDATE SET loads = loads + 1, mass = mass + new.mass; END;
    CREATE TRIGGER judged AFTER UPDATE OF accepted ON bookings WHEN new.accepted <> old.accepted BEGIN
        UPDATE totals SET loads = loads + new.accepted - old.accepted,
        mass = mass + (new.accepted - old.accepted) * new.mass WHERE product = new.product; END;
    CREATE TABLE marks (name TEXT PRIMARY KEY, booking INTEGER NOT NULL, t_us INTEGER NOT NULL) STRICT;
    CREATE TABLE kept (id INTEGER PRIMARY KEY CHECK (id = 1), zero REAL NOT NULL, tare REAL NOT NULL,
        attachment TEXT NOT NULL, truck INTEGER NOT NULL, target REAL NOT NULL, product INTEGER NOT NULL) STRICT;
    CREATE TABLE tickets (number INTEGER PRIMARY KEY AUTOINCREMENT, truck INTEGER NOT NULL UNIQUE,
        t_us INTEGER NOT NULL, printed INTEGER NOT NULL) STRICT;
    CREATE TABLE changes (id INTEGER PRIMARY KEY, start INTEGER NOT NULL, t_us INTEGER NOT NULL, words TEXT NOT NULL)
        STRICT;
    """,
    # `final`: the bucket has returned, so that the weight that remained in it is final.
    """
    ALTER TABLE bookings ADD COLUMN final INTEGER NOT NULL DEFAULT 0;
    CREATE TRIGGER refined AFTER UPDATE OF mass ON bookings WHEN new.accepted AND new.mass <> old.mass BEGIN
        UPDATE totals SET mass = mass + new.mass - old.mass WHERE product = new.product; END;
    """,
    # `revision`: counts the changes of all bookings; for each receiver the last confirmed one is stored.
    """
    ALTER TABLE bookings ADD COLUMN revision INTEGER NOT NULL DEFAULT 0;
    UPDATE bookings SET revision = id;
    CREATE INDEX bookings_by_revision ON bookings (revision);
    CREATE TABLE passed_on (receiver TEXT PRIMARY KEY, revision INTEGER NOT NULL) STRICT;
    CREATE TRIGGER made AFTER INSERT ON bookings BEGIN
        UPDATE bookings SET revision = (SELECT max(revision) + 1 FROM bookings) WHERE id = new.id; END;
    CREATE TRIGGER changed AFTER UPDATE OF mass, accepted, final ON bookings
        WHEN (new.mass, new.accepted, new.final) <> (old.mass, old.accepted, old.final) BEGIN
        UPDATE bookings SET revision = (SELECT max(revision) + 1 FROM bookings) WHERE id = new.id; END;
    """,
    # A weighed bucket that is not booked yet, as JSON (files/checkpoint.py), and the time of its weight; empty: none.
    # Parts of a truck: its trailer, or the rest of it for another product; targets of the first part and the next one.
    """
    ALTER TABLE bookings ADD COLUMN part INTEGER NOT NULL DEFAULT 1;
    ALTER TABLE trucks ADD COLUMN trailer REAL NOT NULL DEFAULT 0.0;
    ALTER TABLE kept ADD COLUMN part INTEGER NOT NULL DEFAULT 1;
    ALTER TABLE kept ADD COLUMN first REAL NOT NULL DEFAULT 0.0;
    ALTER TABLE kept ADD COLUMN trailer REAL NOT NULL DEFAULT 0.0;
    ALTER TABLE kept ADD COLUMN hanging TEXT NOT NULL DEFAULT '';
    ALTER TABLE kept ADD COLUMN hanging_us INTEGER NOT NULL DEFAULT 0;
    """,
    # The audit trail (records/audit.py): nothing of it is changed or removed.
    """
    CREATE TABLE audit (number INTEGER PRIMARY KEY, t_us INTEGER NOT NULL, who TEXT NOT NULL, what TEXT NOT NULL,
        digest TEXT NOT NULL) STRICT;
    CREATE TRIGGER audit_stays BEFORE DELETE ON audit BEGIN SELECT raise(ABORT, 'the audit trail stays'); END;
    CREATE TRIGGER audit_is_so BEFORE UPDATE ON audit BEGIN SELECT raise(ABORT, 'the audit trail is as it is'); END;
    """,
)
VERSION = len(MIGRATIONS)
AUDITED = 5  # the first version with an audit trail
BUSY_S = 10.0  # s for which the writer waits for another program that writes labels; chosen


class UnreadableError(Exception):
    """Error for a file that is no database of ours, or one of a newer version; the text names which."""


def version_of(connection: sqlite3.Connection) -> int:
    """Return the version of the tables; 0: there are none yet."""
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def migrate(connection: sqlite3.Connection) -> None:
    """Bring the tables to the present version, each step whole or not at all."""
    for number in range(version_of(connection), VERSION):
        connection.executescript(f"BEGIN IMMEDIATE; {MIGRATIONS[number]} PRAGMA user_version = {number + 1}; COMMIT;")


def check(connection: sqlite3.Connection) -> None:
    """Raise UnreadableError for a file that must not be written: damaged, no database, or of a newer version.

    Raises sqlite3.OperationalError where the file cannot be read now, such as one that is locked.
    """
    try:
        if version_of(connection) > VERSION:
            raise UnreadableError(f"is of version {version_of(connection)}, this cylforce knows up to {VERSION}")
        result = str(connection.execute("PRAGMA quick_check(1)").fetchone()[0])
    except sqlite3.DatabaseError as error:
        if isinstance(error, sqlite3.OperationalError):
            raise
        raise UnreadableError(f"is damaged or no database ({error})") from error
    if result != "ok":
        raise UnreadableError(f"is damaged ({result})")


def open_writing(path: Path, report: Report) -> sqlite3.Connection:
    """Open the database for the one writer; create its tables or bring them to the present version.

    A damaged file, or one of a newer version, is kept under another name, and new records begin. Raises sqlite3.Error
    or OSError where nothing can be written.

    report: called with one sentence where a file was kept
    """
    try:
        return _ready(path)
    except UnreadableError as error:
        aside = _kept_aside(path)
        report(f"{path}: {error}: it was kept as {aside.name}, and new records begin")
        return _ready(path)


def _ready(path: Path) -> sqlite3.Connection:
    """Open, check and migrate the database. Raises UnreadableError, sqlite3.Error or OSError."""
    connection = sqlite3.connect(path, BUSY_S, isolation_level=None, check_same_thread=False)
    try:
        check(connection)
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = FULL")
        migrate(connection)
    except BaseException:
        connection.close()
        raise
    return connection


def _kept_aside(path: Path) -> Path:
    """Rename the database with its other files; return the new path. Nothing of that name is replaced."""
    number = 1
    while (aside := path.with_name(f"{path.stem}.kept-{number}{path.suffix}")).exists():
        number += 1
    for ending in ("-wal", "-shm", ""):
        part = path.with_name(path.name + ending)
        if part.exists():
            part.rename(aside.with_name(aside.name + ending))
    return aside


def open_reading(path: Path) -> sqlite3.Connection:
    """Open the database for a command that only reads. Raises RecordingError with a sentence."""
    return _for_command(path, "ro")


def open_labels(path: Path) -> sqlite3.Connection:
    """Open the database for a command that changes names, notes, marks or tickets; the service may write meanwhile.

    Raises RecordingError with a sentence.
    """
    return _for_command(path, "rw")


def _for_command(path: Path, mode: str) -> sqlite3.Connection:
    """Open the database in a mode of SQLite, "ro" or "rw".

    Raises RecordingError where there is no such file, or it holds no records, or those of a newer version. Records of
    an older version are opened as they are.
    """
    if not path.is_file():
        raise RecordingError(f"{path}: there are no records: name the file that `cylforce run --records` writes")
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode={mode}", 5.0, isolation_level=None, uri=True)
    try:
        if not 0 < (version := version_of(connection)) <= VERSION:
            raise RecordingError(f"{path}: has records of version {version}, this cylforce reads 1 to {VERSION}")
    except sqlite3.DatabaseError as error:
        connection.close()
        raise RecordingError(f"{path}: cannot be read as records ({error}): name another file") from error
    except RecordingError:
        connection.close()
        raise
    connection.row_factory = sqlite3.Row
    return connection
