"""Read recordings of a bus as events: our own logs and candump's, .blf and .asc."""

from collections.abc import Iterator
from io import StringIO
from itertools import starmap
from pathlib import Path

from cylforce.files.atomic import RecordingError, Report, blocks_of, check_ordinary, warn
from cylforce.files.candump import Line, Parts, Sent, is_newer_frame, own_events, parts, parts_of
from cylforce.files.logfile import Header, header_from
from cylforce.files.stamps import Cuts, without_strays
from cylforce.signals.events import Event, Frame, Tick

SUFFIXES = (".log", ".blf", ".asc")
GAP_US = 60_000_000  # us; a longer pause means that the clock was set: no ticks are made within it; chosen


def read_events(
    path: Path,
    period_us: int,
    *,
    channel: str | None = None,
    own_ids: frozenset[int] = frozenset(),
    report: Report = warn,
) -> tuple[Header | None, Iterator[Event | Sent]]:
    """Return the header (None if the log is not ours) and the events, which are read from the file as they are
    consumed.

    Our own logs contain their ticks. For all others ticks are made at each multiple of `period_us` after the first
    frame, behind the frames up to that moment. CAN FD and XL frames are skipped, and so are frames with a wrong stamp
    (`stamps.without_strays`). Raises RecordingError, at once or while reading, which names the file, and the line where
    there are lines.

    period_us: period of the service's steps [us]
    channel: chooses one bus of several
    own_ids: identifiers of our node; frames with them become `Sent`
    report: called with a sentence about omitted frames
    """
    header = log_header(path)
    if header is not None:
        return header, own_events(_candump(path, report, ours=True))
    lines = _one_channel(path, _lines(path, report), channel)
    frames = (Frame(line.t_us, line.can_id, line.data) for line in lines)
    timely = without_strays((_as_event(f, own_ids) for f in frames), period_us, str(path), report)
    return None, with_ticks(timely, period_us, report, str(path))


def _as_event(frame: Frame, own_ids: frozenset[int]) -> Frame | Sent:
    """Return a frame, as `Sent` if its identifier is one of our node."""
    return Sent(frame.t_us, frame.can_id, frame.data) if frame.can_id in own_ids else frame


def with_ticks(
    frames: Iterator[Frame | Sent], period_us: int, report: Report = warn, name: str = "the recording"
) -> Iterator[Event | Sent]:
    """Yield the frames, and a tick at each multiple of `period_us` after the first, up to one tick behind the last
    frame.

    Where the clock steps back by more than `period_us`, or ahead by more than GAP_US, this is reported with the
    recording's name, and ticks begin anew.
    """
    due: int | None = None
    newest = 0  # latest stamp since ticks began
    cuts = Cuts(name, report)
    for frame in frames:
        if due is None or not newest - period_us <= frame.t_us <= due + GAP_US:
            if due is not None:
                cuts.add(newest, frame.t_us)
            due, newest = frame.t_us + period_us, frame.t_us
        while due < frame.t_us:
            yield Tick(due)
            due += period_us
        newest = max(newest, frame.t_us)
        yield frame
    if due is not None:
        yield Tick(due)
    cuts.report()


def log_header(path: Path) -> Header | None:
    """Return the header of one of our own logs; None for any other recording. Raises RecordingError if it cannot be
    read.
    """
    if path.suffix.lower() != ".log":
        return None
    check_ordinary(path)
    if not path.exists():
        raise RecordingError(f"{path}: does not exist")
    return header_from(path, starmap(Line, _candump(path, lambda _: None, ours=False)))


def _lines(path: Path, report: Report) -> Iterator[Line]:
    """Yield the lines of a recording of any format."""
    if path.suffix.lower() == ".log":
        return starmap(Line, _candump(path, report, ours=False))
    if path.suffix.lower() in SUFFIXES:
        from cylforce.files.messages import messages  # with python-can's readers, which take a while to import

        return messages(path, report)
    raise RecordingError(f"{path}: is none of the recordings that can be read ({', '.join(SUFFIXES)})")


def _one_channel(path: Path, lines: Iterator[Line], channel: str | None) -> Iterator[Line]:
    """Yield the lines of one bus: two buses must not be merged into one.

    Raises RecordingError where there is no such line, or several buses and none is chosen.

    channel: name of the bus; None: the only one
    """
    chosen, present = channel, set()
    for line in lines:
        present.add(line.channel)
        if chosen is None:
            chosen = line.channel
        if line.channel == chosen:
            yield line
        elif channel is None:
            raise RecordingError(f"{path}: holds several buses ({chosen}, {line.channel}, ...): choose one")
    if chosen not in present:
        others = f", only of {', '.join(sorted(present))}" if present else ""
        raise RecordingError(f"{path}: holds no frame{f' of {channel}' if channel else ''}{others}")


def _candump(path: Path, report: Report, *, ours: bool) -> Iterator[Parts]:
    """Yield the lines of candump text as fields of `Line`, the header of our own log included.

    Comments and empty lines are skipped. CAN FD and XL frames, and a last line that is cut off, are omitted and
    reported. Raises RecordingError for any other line that is no frame.

    ours: whether it is our own log: a last line without a line end is then cut off even if it can be parsed
    """
    skipped = number = 0
    try:
        with path.open(encoding="latin-1", newline="\n") as file:
            for block in blocks_of(path, file):
                block_lines = parts_of(block)
                if block_lines is not None:
                    number += len(block_lines)
                    yield from block_lines
                    continue
                for text in StringIO(block):
                    number += 1
                    line = parts(text)
                    if not text.endswith("\n") and (ours or line is None):
                        report(f"{path}: line {number}, the last, is cut off and was left out")
                    elif line is not None:
                        yield line
                    elif is_newer_frame(text):
                        skipped += 1
                    elif text[0] not in "#\r\n":
                        raise RecordingError(f"{path}, line {number}: is no frame of candump text: {text[:60]!r}")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    if skipped:
        report(f"{path}: {skipped} CAN FD or XL frames were skipped")


def mismatches(path: Path, recorded: Header, now: Header) -> tuple[str, ...]:
    """Return why a replay with the present files and versions may differ from the recording, one sentence a difference.

    path: the recording
    recorded: header of the recording
    now: header that a log would have now
    """
    reasons = []
    if recorded.machine_sha256 != now.machine_sha256:
        reasons.append(f"{path} was recorded with another machine file ({recorded.machine}) than {now.machine}")
    if recorded.identified_sha256 != now.identified_sha256:
        reasons.append(f"{path} was recorded with {_identified(recorded)}, this is with {_identified(now)}")
    if recorded.node_id != now.node_id:
        reasons.append(f"{path} was recorded as node {recorded.node_id}, not as node {now.node_id}")
    for name in sorted({*recorded.versions, *now.versions}):
        before, present = recorded.versions.get(name, "none"), now.versions.get(name, "none")
        if before != present:
            reasons.append(f"{path} was recorded with {name} {before}, this is {name} {present}: digits may differ")
    return tuple(reasons)


def _identified(header: Header) -> str:
    """Return the identified file of a header in words."""
    sha256 = header.identified_sha256
    return "no identified file" if sha256 is None else f"the identified file of sha256 {sha256[:12]}"
