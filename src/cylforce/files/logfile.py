"""The event log: a header, then every event in the order in which the service received it, as candump text.

The header is JSON, eight bytes a line, on a pseudo-channel, in frames of an identifier unused by CANopen. Comment lines
would be simpler, but wireshark refuses files that contain any. can-utils plays such a log when the bus is named
(`canplayer -I LOG can0=can0`), which omits the pseudo-channels.
"""

import hashlib
import json
import platform
import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib.metadata import version
from io import FileIO
from itertools import takewhile
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from types import TracebackType
from typing import NamedTuple, Self

from pydantic import BaseModel, ConfigDict, JsonValue

import cylforce
from cylforce.files.atomic import RecordingError, Report, warn
from cylforce.files.candump import HEAD, SENT, TICK, Line, Sent, event_lines
from cylforce.files.rotation import Rotation, check_room, lost_its_name, opened
from cylforce.signals.events import Event, Frame

FORMAT = 1  # version of the header's format
FLUSH_US = 500_000  # us of events that are lost at most when the program is killed; chosen
BLOCK_LINES = 4096  # lines that are passed to the writing thread at once; chosen
BACKLOG_BYTES = 16_000_000  # minutes of a busy bus: a disk that stalls for longer has failed; chosen
CLOSE_S = 5.0  # s for which closing waits for the disk; chosen
RETRY_US = 10_000_000  # us after a failure until a new file is tried; chosen
_HEAD_ID = 0x7FF  # identifier of the header's frames
_CHANNEL = re.compile(r"[A-Za-z][\w.-]{0,14}", re.ASCII)  # names of a bus that candump text can carry


class Header(BaseModel):
    """Data for a replay, before the first event.

    versions: versions on which the last digit of a result depends
    machine: path of the machine file, as given to the program that logged
    machine_sha256: hash of the machine file
    identified_sha256: hash of the identified file; None: without one
    state: state from which the service started, as JSON: `zero` and `tare` [kg]; in a log that continues an earlier one
        also `service`, the whole state at that moment (see `checkpoint`)
    bus: name of the bus, as given to the program that logged
    node_id: number of our node
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    versions: dict[str, str]
    machine: str
    machine_sha256: str
    identified_sha256: str | None
    state: dict[str, JsonValue]
    bus: str
    node_id: int


def running_versions() -> dict[str, str]:
    """Return the versions on which the last digit of a result depends, besides the events."""
    libraries = {name: version(name) for name in ("numpy", "scipy")}
    return {
        "cylforce": cylforce.__version__,
        "python": platform.python_version(),
        "processor": platform.machine(),
        **libraries,
    }


def file_sha256(path: Path) -> str:
    """Return the hash of a file's bytes, as `sha256sum` prints it."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def header_lines(header: Header, t_us: int) -> str:
    """Return the header as lines of candump text, all stamped with the time at which the log begins [us]."""
    text = json.dumps({"format": FORMAT, **header.model_dump()}, allow_nan=False).encode()
    text += b" " * (-len(text) % 8)
    return event_lines((Frame(t_us, _HEAD_ID, text[k : k + 8]) for k in range(0, len(text), 8)), HEAD)


def header_from(path: Path, lines: Iterable[Line]) -> Header | None:
    """Return the header in the first lines of a log; None when it has none.

    Raises RecordingError when the header is cut off, or of another format than this version's.
    """
    text = b"".join(line.data for line in takewhile(lambda line: line.channel == HEAD, lines))
    if not text:
        return None
    try:
        fields = json.loads(text)
        if (written := fields.pop("format")) != FORMAT:
            raise RecordingError(f"{path}: is a log of format {written}, this cylforce reads format {FORMAT} only")
        return Header.model_validate(fields)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise RecordingError(f"{path}: the log's header is broken, so its start is lost; record anew") from error


class _NewFile(NamedTuple):
    """An order to the writing thread: begin a new file.

    header: returns its header
    t_us: time at which it begins [us]
    again: whether the last file failed
    """

    header: Callable[[], Header]
    t_us: int
    again: bool


class LogWriter:
    """Writes a log and never makes the event loop wait: blocks of lines go to a thread, which alone waits for the disk.

    When the disk fails, or stalls for minutes, logging ends: a log with a hole could not be replayed. This is reported
    once, on the caller's thread. With a rotation the writer `needs_new_file` when the file is full, when it no longer
    has its name, and, after a failure, every RETRY_US. The caller then calls `begin_file`, because only the caller has
    the header of the next file, and decides when it can begin. A file that cannot be opened at the start is then a
    failure like any other; without a rotation it raises RecordingError.

    header: header of the first file
    failure: why logging stopped; None: it works
    """

    def __init__(
        self,
        path: Path,
        header: Header,
        t_us: int,
        channel: str,
        report: Report = warn,
        rotation: Rotation | None = None,
        backlog_bytes: int = BACKLOG_BYTES,
        close_s: float = CLOSE_S,
    ) -> None:
        """Open the file and start the thread.

        path: the file
        header: its header
        t_us: time at which the log begins [us]
        channel: name of the bus; a name that candump text cannot carry is written as can0
        report: called with a sentence about a failure
        rotation: limits of size and number of files; None: one file
        backlog_bytes: size of unwritten lines from which on the disk counts as failed
        close_s: time for which closing waits for the disk [s]
        """
        writable = _CHANNEL.fullmatch(channel) and channel not in (HEAD, TICK, SENT)
        self._path, self._channel, self._report = path, channel if writable else "can0", report
        self.header, self._rotation = header, rotation
        self._backlog_bytes, self._close_s = backlog_bytes, close_s
        self._room = rotation.size if rotation else 0  # bytes until the file is full; used with a rotation only
        self.failure: str | None = None
        self._logged = self._passed = 0  # counted by the loop: events logged, bytes passed to the thread
        self._written = self._done = 0  # counted by the thread: events written, bytes processed
        self._events: list[Event | Sent] = []  # not yet passed to the thread
        self._block_us = self._now_us = self._failed_us = t_us  # times: of the last block, event, failure
        self._reported = False  # whether the present failure was reported
        self._lost_name = self._resumed = False  # set by the thread: the file lost its name; a failure is over
        self._file, self._error = self._first()
        self._blocks: SimpleQueue[tuple[bytes, int] | _NewFile | None] = SimpleQueue()
        self._thread = Thread(target=self._drain, name="event log", daemon=True)
        self._thread.start()
        self._pass(header_lines(header, t_us).encode("ascii"), 0)
        if self._error is not None:
            self._fail(self._error)

    def _first(self) -> tuple[FileIO | None, OSError | None]:
        """Open the first file; return the file or, with a rotation, the error.

        Without a rotation an error is raised as RecordingError.
        """
        try:
            return opened(self._path, self._rotation), None
        except OSError as error:
            if self._rotation is None:
                raise RecordingError(f"{self._path}: cannot be written: {error.strerror or error}") from error
            return None, error

    @property
    def lost(self) -> int:
        """Return the number of events since the start that did not reach a file; 0 while logging works."""
        return self._logged - self._written if self.failure else 0

    @property
    def backlog(self) -> int:
        """Return the number of bytes that wait for the writing thread."""
        return self._passed - self._done

    def log(self, event: Event | Sent) -> None:
        """Log an event, before the service processes it, or a frame that our node sent."""
        self._logged += 1
        self._now_us = event.t_us
        if self.failure is None:
            self._events.append(event)
            if len(self._events) >= BLOCK_LINES or not 0 <= event.t_us - self._block_us < FLUSH_US:
                self._block_us = event.t_us
                self.flush()

    @property
    def needs_new_file(self) -> bool:
        """Return whether the caller should call `begin_file`: the file is full, lost its name, or a failure may be
        over.
        """
        if self._rotation is None:
            return False
        if self.failure is not None:
            stalled = self.backlog > self._backlog_bytes // 2
            return not stalled and not 0 <= self._now_us - self._failed_us < RETRY_US
        return self._room <= 0 or self._lost_name

    def begin_file(self, header: Callable[[], Header], t_us: int) -> None:
        """Begin a new file; the events logged so far stay in the old one. Without a rotation nothing happens.

        header: returns the header, called on the writing thread
        t_us: time at which it begins [us]
        """
        if self._rotation is None:
            return
        if self.failure is None:
            self.flush()
        again, self.failure, self._error = self.failure is not None, None, None
        self._room, self._lost_name = self._rotation.size, False
        self._blocks.put(_NewFile(header, t_us, again))

    def flush(self) -> None:
        """Pass the events logged so far to the writing thread, as lines.

        A failure of that thread, or a backlog above the limit, is reported once and stops logging: the events are then
        dropped. When logging continues in a new file, that is reported.
        """
        block, events = event_lines(self._events, self._channel).encode("ascii"), len(self._events)
        self._events.clear()
        if self._resumed:
            self._resumed = self._reported = False
            self._report(f"{self._path}: logging continues")
        if self.backlog > self._backlog_bytes:
            self._error = self._error or TimeoutError(None, "the disk does not keep up")
        if self._error is None:
            self._pass(block, events)
        else:
            self._fail(self._error)

    def _pass(self, block: bytes, events: int) -> None:
        """Pass a block of lines to the writing thread; `events`: number of events in it."""
        self._passed += len(block)
        self._room -= len(block)
        self._blocks.put((block, events))

    def _fail(self, error: OSError) -> None:
        """Stop logging because of an error, and report it once until logging works again."""
        if self.failure is not None:
            return
        again = "" if self._rotation is None else f", and is tried again every {RETRY_US // 1_000_000} s"
        self.failure = f"{self._path}: logging stopped: {error.strerror or error}; all else goes on{again}"
        self._failed_us = self._now_us
        if not self._reported:
            self._reported = True
            self._report(self.failure)

    def close(self) -> None:
        """Write the remaining events, and wait for that at most `close_s`; a longer wait is reported as a failure."""
        self.flush()
        self._blocks.put(None)
        self._thread.join(self._close_s)
        if self._thread.is_alive():
            self._error = self._error or TimeoutError(None, "the disk does not keep up")
        if self._error is not None:
            self._fail(self._error)

    def _drain(self) -> None:
        """Run the writing thread.

        An error makes a gap in its file: nothing is written until a new file begins.
        """
        while (order := self._blocks.get()) is not None:
            if isinstance(order, _NewFile):
                self._begin(order)
            else:
                self._put(*order)
        if self._file is not None:
            self._file.close()

    def _begin(self, new_file: _NewFile) -> None:
        """Close the file and begin a new one with its header, in the writing thread.

        After a failure this requires room on the disk. An error is stored; a file without its whole header is deleted.
        """
        try:
            self._close_file()
            if new_file.again and self._rotation is not None:
                check_room(self._path, self._rotation)
            self._file = opened(self._path, self._rotation)
        except OSError as error:
            self._broken(error)
            return
        try:
            self._write(self._file, header_lines(new_file.header(), new_file.t_us).encode("ascii"))
            self._resumed = new_file.again
        except OSError as error:
            self._broken(error)
            with suppress(OSError):
                self._path.unlink()  # otherwise each attempt would push an older log out

    def _put(self, block: bytes, events: int) -> None:
        """Write a block of lines, in the writing thread.

        block: the lines
        events: number of events in them
        """
        self._done += len(block)
        if self._file is None:
            return
        try:
            self._write(self._file, block)
            self._lost_name = self._rotation is not None and lost_its_name(self._path, self._file)
        except OSError as error:
            self._broken(error)
        else:
            self._written += events

    def _broken(self, error: OSError) -> None:
        """Close the file after an error, in the writing thread.

        The error is stored; `flush` reports it in the caller's thread.
        """
        self._error = error
        with suppress(OSError):
            self._close_file()

    def _close_file(self) -> None:
        """Close the file, in the writing thread."""
        file, self._file = self._file, None
        if file is not None:
            file.close()

    @staticmethod
    def _write(file: FileIO, block: bytes) -> None:
        """Write all bytes: one call may write fewer."""
        rest = memoryview(block)
        while rest:
            rest = rest[file.write(rest) :]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
