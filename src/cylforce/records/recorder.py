"""The one writer of the records: a thread that alone waits for the disk."""

import fcntl
import sqlite3
from contextlib import suppress
from io import TextIOWrapper
from pathlib import Path
from queue import Empty, Full, Queue
from threading import Thread

from cylforce.files.atomic import RecordingError, Report, warn
from cylforce.records.audit import Audit, last_number
from cylforce.records.queries import cumulated
from cylforce.records.schema import open_writing
from cylforce.records.writing import Change, Start, begin, end, write, write_audit
from cylforce.service.memory import NOTHING_KEPT, Memory

BACKLOG = 1000  # changes, those of hours of work: a disk that stalls for longer has failed; chosen
CLOSE_S = 5.0  # s for which closing waits for the disk; chosen


class Recorder:
    """Records changes and never makes its caller wait.

    When the disk is full, read-only or fails, recording ends, which is reported once, on the caller's thread; weighing
    continues. Raises RecordingError only when another service writes the same file.

    path: the file
    start: the start of the service
    report: called with a sentence about a failure
    close_s: time for which closing waits for the disk [s]
    kept: memory that was restored from the records
    recorded: number of the last booking that is safe on the disk; 0: none
    audited: number of the last audit entry that is safe on the disk; 0: none
    lifetime: mass of all loads ever, without cancelled ones [kg]; None: unknown
    failure: sentence about a failure; "": none
    """

    def __init__(self, path: Path, start: Start, report: Report = warn, close_s: float = CLOSE_S) -> None:
        self._close_s = close_s
        self._path, self._report, self.failure, self._error = path, report, "", ""
        self.kept: Memory = NOTHING_KEPT
        self.lifetime: float | None = None
        self.audited = 0
        self._connection: sqlite3.Connection | None = None
        self._changes: Queue[Change | Audit | int] = Queue(BACKLOG)  # int: the end of the start, at this time [us]
        self._begun, self._last_us = 0, start.t_us  # id of the start of the service; time of the last change [us]
        self._lock = _locked(path)
        try:
            self._connection = open_writing(path, report)
            self._begun, self.kept = begin(self._connection, start)
            self.lifetime = cumulated(self._connection).mass
            self.audited = last_number(self._connection)
        except (sqlite3.Error, OSError) as error:
            self._error = f"{error}"
        self.recorded = self.kept.booking.number if self.kept.booking else 0
        self._thread = Thread(target=self._drain, name="records", daemon=True)
        self._thread.start()
        self.report_failure()

    def put(self, change: Change | Audit) -> None:
        """Queue a change for the writing thread; after a failure it is dropped."""
        self._last_us = change.t_us
        if not self._error:
            try:
                self._changes.put_nowait(change)
            except Full:
                self._error = "the disk does not keep up"
        self.report_failure()

    def report_failure(self) -> None:
        """Report a failure of the writing thread, once."""
        if self._error and not self.failure:
            self.failure = (
                f"{self._path}: no more bookings are recorded ({self._error}); weighing continues: free the disk"
            )
            self._report(self.failure)

    def close(self) -> None:
        """Write the remaining changes and the end of the start, and wait for that at most `close_s`."""
        with suppress(Full):
            self._changes.put_nowait(self._last_us)
            self._thread.join(self._close_s)
        self.report_failure()
        if self._lock is not None:
            self._lock.close()

    def _drain(self) -> None:
        """Run the writing thread, until an error or the end."""
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
        """Write a change, an audit entry, or the end of the start at a time [us], on the thread."""
        if isinstance(change, int):
            end(connection, self._begun, change)
            return
        if isinstance(change, Audit):
            self.audited = write_audit(connection, change)
            return
        write(connection, self._begun, change)
        self.lifetime = cumulated(connection).mass
        self.audited = last_number(connection)
        if change.booked is not None:
            self.recorded = change.booked.booking.number


def _locked(path: Path) -> TextIOWrapper | None:
    """Lock a file beside the database, and return it: the lock holds while it is open.

    None: nothing can be written there. Raises RecordingError when another service has the lock.
    """
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
