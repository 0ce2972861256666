"""The event log: a header, then every event in the order in which the service received it, as candump text.

The header is JSON, eight bytes a line, on a pseudo-channel, in frames of an identifier unused by CANopen.
Comment lines would be simpler, but wireshark refuses files that contain any. can-utils plays such a log when the bus is
named (`canplayer -I LOG can0=can0`), which leaves the pseudo-channels out.
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
from cylforce.files.atomic import RecordingError, Tell, warn
from cylforce.files.candump import HEAD, SENT, TICK, Line, Sent, event_lines
from cylforce.files.rotation import Rotation, check_room, is_elsewhere, opened
from cylforce.signals.events import Event, Frame

FORMAT = 1
FLUSH_US = 500_000  # when the program is killed, no more than this is lost
BLOCK_LINES = 4096
BACKLOG_BYTES = 16_000_000  # minutes of a busy bus: a disk that stalls for longer has failed
CLOSE_S = 5.0
RETRY_US = 10_000_000  # after a failure, until a new file is tried; chosen
_HEAD_ID = 0x7FF
_CHANNEL = re.compile(r"[A-Za-z][\w.-]{0,14}", re.ASCII)


class Header(BaseModel):
    """What a replay needs to know before the first event; `machine` and `bus` as given to the program that logged.

    `state`: where the service started from, as JSON: `zero` and `tare` [kg]; in a log that continues an earlier one
    also `service`, all that it remembered at that moment (see `checkpoint`)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    versions: dict[str, str]
    machine: str
    machine_sha256: str
    identified_sha256: str | None
    state: dict[str, JsonValue]
    bus: str
    node_id: int


def running_versions() -> dict[str, str]:
    """Versions on which the last digit of a result depends, besides the events."""
    libraries = {name: version(name) for name in ("numpy", "scipy")}
    return {
        "cylforce": cylforce.__version__,
        "python": platform.python_version(),
        "processor": platform.machine(),
        **libraries,
    }


def file_sha256(path: Path) -> str:
    """Hash of a file's bytes, as `sha256sum` prints it."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def header_lines(header: Header, t_us: int) -> str:
    """The header as lines of candump text, all at the time that the log begins."""
    text = json.dumps({"format": FORMAT, **header.model_dump()}, allow_nan=False).encode()
    text += b" " * (-len(text) % 8)
    return event_lines((Frame(t_us, _HEAD_ID, text[k : k + 8]) for k in range(0, len(text), 8)), HEAD)


def header_from(path: Path, lines: Iterable[Line]) -> Header | None:
    """The header in the first lines of a log; None when it has none.

    Raises
    ------
    RecordingError
        When it is cut off, or of another format than this version's.
    """
    text = b"".join(said.data for said in takewhile(lambda said: said.channel == HEAD, lines))
    if not text:
        return None
    try:
        fields = json.loads(text)
        if (written := fields.pop("format")) != FORMAT:
            raise RecordingError(f"{path}: is a log of format {written}, this cylforce reads format {FORMAT} only")
        return Header.model_validate(fields)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise RecordingError(f"{path}: the log's header is broken, so its start is lost; record anew") from error


class _Turn(NamedTuple):
    """An order to the writing thread: a new file, which begins with this header at this time; `again`: after a
    failure."""

    header: Callable[[], Header]
    t_us: int
    again: bool


class LogWriter:
    """Writes a log and never makes the loop wait: blocks of lines go to a thread, which alone waits for the disk.

    When the disk fails, or stalls for minutes, logging ends: a log with a hole could not be replayed. `tell` is called
    once about it, on the caller's thread; `lost` counts the events that are not in the file.

    With a `rotation` the writer `wants_turn` when the file is full, when it no longer has its name, and, after a
    failure, every RETRY_US: the caller then gives a `turn`, for only the caller knows the header that the next file
    needs, and when it can begin. A file that cannot be opened at the start is then a failure like any other; without a
    rotation it raises RecordingError.
    """

    def __init__(
        self,
        path: Path,
        header: Header,
        t_us: int,
        channel: str,
        tell: Tell = warn,
        rotation: Rotation | None = None,
    ) -> None:
        """`channel` is the bus's name; names that candump text cannot carry are written as can0."""
        writable = _CHANNEL.fullmatch(channel) and channel not in (HEAD, TICK, SENT)
        self._path, self._channel, self._tell = path, channel if writable else "can0", tell
        self.header, self._rotation = header, rotation
        self._room = rotation.size if rotation else 0
        self.failure: str | None = None
        self._logged = self._handed = 0  # the loop's counts: events, bytes
        self._kept = self._done = 0  # the thread's
        self._events: list[Event | Sent] = []
        self._begun = self._now_us = self._failed_us = t_us
        self._told = False  # that it fails
        self._elsewhere = self._resumed = False  # the thread's: the file lost its name; a failure is over
        self._file, self._error = self._first()
        self._blocks: SimpleQueue[tuple[bytes, int] | _Turn | None] = SimpleQueue()
        self._thread = Thread(target=self._drain, name="event log", daemon=True)
        self._thread.start()
        self._hand(header_lines(header, t_us).encode("ascii"), 0)
        if self._error is not None:
            self._fail(self._error)

    def _first(self) -> tuple[FileIO | None, OSError | None]:
        try:
            return opened(self._path, self._rotation), None
        except OSError as error:
            if self._rotation is None:
                raise RecordingError(f"{self._path}: cannot be written: {error.strerror or error}") from error
            return None, error

    @property
    def lost(self) -> int:
        """Events that did not reach a file; known once logging has failed or ended."""
        return self._logged - self._kept if self.failure else 0

    def log(self, event: Event | Sent) -> None:
        """Log an event, before the service processes it, or a frame that our node sent."""
        self._logged += 1
        self._now_us = event.t_us
        if self.failure is None:
            self._events.append(event)
            if len(self._events) >= BLOCK_LINES or not 0 <= event.t_us - self._begun < FLUSH_US:
                self._begun = event.t_us
                self.flush()

    @property
    def wants_turn(self) -> bool:
        """Whether the caller should give a `turn`: the file is full, lost its name, or a failure may be over."""
        if self._rotation is None:
            return False
        if self.failure is not None:
            stalled = self._handed - self._done > BACKLOG_BYTES // 2
            return not stalled and not 0 <= self._now_us - self._failed_us < RETRY_US
        return self._room <= 0 or self._elsewhere

    def turn(self, header: Callable[[], Header], t_us: int) -> None:
        """Begin a new file: the events logged so far stay in the old one. `header` is called on the writing thread."""
        if self._rotation is None:
            return
        if self.failure is None:
            self.flush()
        again, self.failure, self._error = self.failure is not None, None, None
        self._room, self._elsewhere = self._rotation.size, False
        self._blocks.put(_Turn(header, t_us, again))

    def flush(self) -> None:
        """Pass the events gathered so far to the writing thread, as lines."""
        block, events = event_lines(self._events, self._channel).encode("ascii"), len(self._events)
        self._events.clear()
        if self._resumed:
            self._resumed = self._told = False
            self._tell(f"{self._path}: logging goes on")
        if self._handed - self._done > BACKLOG_BYTES:
            self._error = self._error or TimeoutError(None, "the disk does not keep up")
        if self._error is None:
            self._hand(block, events)
        else:
            self._fail(self._error)

    def _hand(self, block: bytes, events: int) -> None:
        self._handed += len(block)
        self._room -= len(block)
        self._blocks.put((block, events))

    def _fail(self, error: OSError) -> None:
        if self.failure is not None:
            return
        again = "" if self._rotation is None else f", and is tried again every {RETRY_US // 1_000_000} s"
        self.failure = f"{self._path}: logging stopped: {error.strerror or error}; all else goes on{again}"
        self._failed_us = self._now_us
        if not self._told:
            self._told = True
            self._tell(self.failure)

    def close(self) -> None:
        """Write the rest out, and wait for it a few seconds."""
        self.flush()
        self._blocks.put(None)
        self._thread.join(CLOSE_S)
        if self._thread.is_alive():
            self._error = self._error or TimeoutError(None, "the disk does not keep up")
        if self._error is not None:
            self._fail(self._error)

    def _drain(self) -> None:
        """The thread. After an error, whose file has a hole, nothing is written until a new file begins."""
        while (order := self._blocks.get()) is not None:
            if isinstance(order, _Turn):
                self._begin(order)
            else:
                self._put(*order)
        if self._file is not None:
            self._file.close()

    def _begin(self, turn: _Turn) -> None:
        try:
            self._leave()
            if turn.again and self._rotation is not None:
                check_room(self._path, self._rotation)
            self._file = opened(self._path, self._rotation)
        except OSError as error:
            self._broken(error)
            return
        try:
            self._write(self._file, header_lines(turn.header(), turn.t_us).encode("ascii"))
            self._resumed = turn.again
        except OSError as error:
            self._broken(error)
            with suppress(OSError):
                self._path.unlink()  # else each attempt would push an older log out

    def _put(self, block: bytes, events: int) -> None:
        self._done += len(block)
        if self._file is None:
            return
        try:
            self._write(self._file, block)
            self._elsewhere = self._rotation is not None and is_elsewhere(self._path, self._file)
        except OSError as error:
            self._broken(error)
        else:
            self._kept += events

    def _broken(self, error: OSError) -> None:
        self._error = error
        with suppress(OSError):
            self._leave()

    def _leave(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            file.close()

    @staticmethod
    def _write(file: FileIO, block: bytes) -> None:
        rest = memoryview(block)
        while rest:
            rest = rest[file.write(rest) :]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
