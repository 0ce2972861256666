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
from cylforce.files.candump import HEAD, SENT, TICK, Line, Sent, event_line, line
from cylforce.signals.events import Event

FORMAT = 1
FLUSH_US = 500_000  # when the program is killed, no more than this is lost
BLOCK_LINES = 4096
BACKLOG_BYTES = 16_000_000  # minutes of a busy bus: a disk that stalls for longer has failed
CLOSE_S = 5.0
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


def mismatches(path: Path, recorded: Header, now: Header) -> tuple[str, ...]:
    """Why a replay with the present files and versions may differ from the recording: one sentence for each
    difference."""
    found = []
    if recorded.machine_sha256 != now.machine_sha256:
        found.append(f"{path} was recorded with another machine file ({recorded.machine}) than {now.machine}")
    if recorded.identified_sha256 != now.identified_sha256:
        found.append(f"{path} was recorded with {_identified(recorded)}, this is with {_identified(now)}")
    if recorded.node_id != now.node_id:
        found.append(f"{path} was recorded as node {recorded.node_id}, not as node {now.node_id}")
    for name in sorted({*recorded.versions, *now.versions}):
        there, here = recorded.versions.get(name, "none"), now.versions.get(name, "none")
        if there != here:
            found.append(f"{path} was recorded with {name} {there}, this is {name} {here}: digits may differ")
    return tuple(found)


def _identified(header: Header) -> str:
    sha256 = header.identified_sha256
    return "no identified file" if sha256 is None else f"the identified file of sha256 {sha256[:12]}"


def header_lines(header: Header, t_us: int) -> str:
    """The header as lines of candump text, all at the time that the log begins."""
    text = json.dumps({"format": FORMAT, **header.model_dump()}, allow_nan=False).encode()
    text += b" " * (-len(text) % 8)
    return "".join(line(HEAD, t_us, _HEAD_ID, text[k : k + 8]) for k in range(0, len(text), 8))


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


class Rotation(NamedTuple):
    """A log of limited size: a new file when this one has `size` bytes, and `keep` older files, FILE.NUMBER.log, the
    lowest number the oldest."""

    size: int
    keep: int


class _Turn(NamedTuple):
    """An order to the writing thread: a new file, which begins with this header at this time."""

    header: Callable[[], Header]
    t_us: int


class LogWriter:
    """Writes a log and never makes the loop wait: blocks of lines go to a thread, which alone waits for the disk.

    When the disk fails, or stalls for minutes, logging ends: a log with a hole could not be replayed. `tell`
    is called once about it, on the caller's thread; `lost` counts the events that are not in the file.
    With a `rotation` the file becomes `full`, and the caller asks for a `turn`: only the caller knows the header that
    the next file needs, and when it can begin.
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
        self._error: OSError | None = None
        self._logged = self._handed = 0  # the loop's counts: events, bytes
        self._kept = self._done = 0  # the thread's
        self._lines: list[str] = []
        self._begun = t_us
        try:
            self._file = _opened(path, rotation)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from error
        self._blocks: SimpleQueue[tuple[bytes, int] | _Turn | None] = SimpleQueue()
        self._thread = Thread(target=self._drain, name="event log", daemon=True)
        self._thread.start()
        self._hand(header_lines(header, t_us).encode("ascii"), 0)

    @property
    def lost(self) -> int:
        """Events that did not reach the file; known once logging has failed or ended."""
        return self._logged - self._kept if self.failure else 0

    def log(self, event: Event | Sent) -> None:
        """Log an event, before the service processes it, or a frame that our node sent."""
        self._logged += 1
        if self.failure is None:
            self._lines.append(event_line(event, self._channel))
            if len(self._lines) >= BLOCK_LINES or not 0 <= event.t_us - self._begun < FLUSH_US:
                self._begun = event.t_us
                self.flush()

    @property
    def full(self) -> bool:
        """Whether the file has reached its size, so that the caller should ask for a `turn`."""
        return self._rotation is not None and self._room <= 0

    def turn(self, header: Callable[[], Header], t_us: int) -> None:
        """Begin a new file: the events logged so far stay in the old one. `header` is called on the writing thread."""
        if self._rotation is not None:
            self.flush()
            self._room = self._rotation.size
            self._blocks.put(_Turn(header, t_us))

    def flush(self) -> None:
        """Pass the lines gathered so far to the writing thread."""
        block, events = "".join(self._lines).encode("ascii"), len(self._lines)
        self._lines.clear()
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
        if self.failure is None:
            self.failure = f"{self._path}: logging stopped: {error.strerror or error}; all else goes on"
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
        while (order := self._blocks.get()) is not None:
            if self._error is None and isinstance(order, _Turn):
                self._begin(order)
            elif self._error is None:
                self._put(*order)
        self._file.close()

    def _begin(self, turn: _Turn) -> None:
        try:
            self._file.close()
            self._file = _opened(self._path, self._rotation)
            self._write(header_lines(turn.header(), turn.t_us).encode("ascii"))
        except OSError as error:
            self._error = error

    def _put(self, block: bytes, events: int) -> None:
        try:
            self._write(block)
        except OSError as error:
            self._error = error
        else:
            self._kept += events
            self._done += len(block)

    def _write(self, block: bytes) -> None:
        rest = memoryview(block)
        while rest:
            rest = rest[self._file.write(rest) :]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _opened(path: Path, rotation: Rotation | None) -> FileIO:
    """The file, empty. A log of this name is kept as NAME.NUMBER.log, because the log before a crash is the one of
    interest. With a rotation the oldest ones are deleted."""
    older = _older(path)
    if path.is_file() and path.stat().st_size:
        number = 1 + max(older, default=0)
        older[number] = path.rename(path.with_name(f"{path.stem}.{number}{path.suffix}"))
    if rotation is not None:
        for number in sorted(older)[: max(0, len(older) - rotation.keep)]:
            older[number].unlink(missing_ok=True)
    return FileIO(path, "w")


def _older(path: Path) -> dict[int, Path]:
    """Earlier logs of this name by their numbers."""
    name = re.compile(rf"{re.escape(path.stem)}\.([1-9]\d*){re.escape(path.suffix)}")
    found = ((name.fullmatch(other.name), other) for other in path.parent.iterdir())
    return {int(match[1]): other for match, other in found if match}
