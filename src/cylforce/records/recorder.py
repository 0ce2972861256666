"""The one writer of the records: a thread that alone waits for the disk."""

import fcntl
import sqlite3
from contextlib import suppress
from io import TextIOWrapper
from pathlib import Path
from queue import Empty, Full, Queue
from threading import Thread

from cylforce.files.atomic import RecordingError, Report, warn
from cylforce.records.audit import Audit, length
from cylforce.records.queries import cumulated
from cylforce.records.schema import open_writing
from cylforce.records.writing import Change, Start, begin, end, entered, write
from cylforce.service.state import NOTHING_KEPT, Memory

BACKLOG = 1000  # changes: hours of work; a disk that stalls for longer has failed
CLOSE_S = 5.0


class Recorder:
    """Takes changes and never makes its caller wait. `kept`: what was kept from before; `recorded`: number of the last
    booking that is safe on the disk; `audited`: of the last audit entry; `lifetime` [kg]: all that was ever loaded
    (None: not known). When the disk is full, read-only or fails, recording ends with `failure`, which `tell` is given
    once, on the caller's thread; nothing else ends.

    Raises RecordingError only when another service writes the same file."""

    def __init__(self, path: Path, start: Start, tell: Report = warn) -> None:
        self._path, self._tell, self.failure, self._error = path, tell, "", ""
        self.kept: Memory = NOTHING_KEPT
        self.lifetime: float | None = None
        self.audited = 0
        self._connection: sqlite3.Connection | None = None
        self._changes: Queue[Change | Audit | int] = Queue(BACKLOG)
        self._begun, self._last_us = 0, start.t_us
        self._lock = _locked(path)
        try:
            self._connection = open_writing(path, tell)
            self._begun, self.kept = begin(self._connection, start)
            self.lifetime = cumulated(self._connection).mass
            self.audited = length(self._connection)
        except (sqlite3.Error, OSError) as error:
            self._error = f"{error}"
        self.recorded = self.kept.booking.number if self.kept.booking else 0
        self._thread = Thread(target=self._drain, name="records", daemon=True)
        self._thread.start()
        self.look()

    def put(self, change: Change | Audit) -> None:
        """Hand over a change; it is written soon."""
        self._last_us = change.t_us
        if not self._error:
            try:
                self._changes.put_nowait(change)
            except Full:
                self._error = "the disk does not keep up"
        self.look()

    def look(self) -> None:
        """Report a failure of the writing thread, once."""
        if self._error and not self.failure:
            self.failure = (
                f"{self._path}: no more bookings are recorded ({self._error}); weighing goes on: free the disk"
            )
            self._tell(self.failure)

    def close(self) -> None:
        """Write the rest, and wait for it a few seconds."""
        with suppress(Full):
            self._changes.put_nowait(self._last_us)
            self._thread.join(CLOSE_S)
        self.look()
        if self._lock is not None:
            self._lock.close()

    def _drain(self) -> None:
        while not self._error and self._connection is not None:
            with suppress(Empty):
                change = self._changes.get(timeout=1.0)
                try:
                    self._write(self._connection, change)
                except (sqlite3.Error, OSError) as error:
                    self._error = f"{error}"
                if isinstance(change, int):
                    break
        if self._connection is not None:
            with suppress(sqlite3.Error):
                self._connection.close()

    def _write(self, connection: sqlite3.Connection, change: Change | Audit | int) -> None:
        if isinstance(change, int):
            end(connection, self._begun, change)
            return
        if isinstance(change, Audit):
            self.audited = entered(connection, change)
            return
        write(connection, self._begun, change)
        self.lifetime = cumulated(connection).mass
        self.audited = length(connection)
        if change.booked is not None:
            self.recorded = change.booked.booking.number


def _locked(path: Path) -> TextIOWrapper | None:
    """A lock beside the database; None where there is no writing. Raises RecordingError when another has it."""
    try:
        file = path.with_name(path.name + ".lock").open("w")
    except OSError:
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        file.close()
        raise RecordingError(f"{path}: another service writes these records: stop it, or name another file") from error
    return file
