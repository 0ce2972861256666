"""Recordings of a bus, read as events: our own logs and candump's, .blf and .asc."""

from collections.abc import Iterator
from io import StringIO
from itertools import starmap
from pathlib import Path

from cylforce.files.atomic import RecordingError, Tell, blocks_of, check_ordinary, warn
from cylforce.files.candump import Line, Parts, Sent, is_newer_frame, own_events, parts, parts_of
from cylforce.files.logfile import Header, header_from
from cylforce.files.stamps import Cuts, without_strays
from cylforce.signals.events import Event, Frame, Tick

SUFFIXES = (".log", ".blf", ".asc")
GAP_US = 60_000_000  # after a longer pause the clock is assumed to have been set: no ticks are made within it; chosen


def read_events(
    path: Path,
    period_us: int,
    *,
    channel: str | None = None,
    own: frozenset[int] = frozenset(),
    tell: Tell = warn,
) -> tuple[Header | None, Iterator[Event | Sent]]:
    """The header (None if the log is not ours) and the events, read from the file as they are asked for.

    Our own logs contain their ticks. For all others ticks are made at each multiple of `period_us` after the first
    frame, behind the frames up to that moment; frames with an identifier in `own` come as `Sent`. `channel` chooses one
    bus of several. CAN FD and XL frames are skipped, and so are frames with a wrong stamp (`stamps.without_strays`).

    Raises
    ------
    RecordingError
        At once or while reading: naming the file, and the line where there are lines.
    """
    header = log_header(path)
    if header is not None:
        return header, own_events(_candump(path, tell, ours=True))
    said = _one_channel(path, _lines(path, tell), channel)
    frames = (Frame(s.t_us, s.can_id, s.data) for s in said)
    timely = without_strays((_as_event(f, own) for f in frames), period_us, str(path), tell)
    return None, with_ticks(timely, period_us, tell, str(path))


def _as_event(frame: Frame, own: frozenset[int]) -> Frame | Sent:
    return Sent(*frame) if frame.can_id in own else frame


def with_ticks(
    frames: Iterator[Frame | Sent], period_us: int, tell: Tell = warn, name: str = "the recording"
) -> Iterator[Event | Sent]:
    """Yield the frames, and a tick at each multiple of `period_us` after the first, up to one tick behind the last.

    Where the clock steps back by more than `period_us`, or ahead by more than GAP_US, `tell` is called with a sentence
    on the recording of that `name`, and ticks begin anew.
    """
    due: int | None = None
    newest = 0  # latest stamp since ticks began
    cuts = Cuts(name, tell)
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
    """The header of one of our own logs; None for any other recording. Raises RecordingError if it cannot be read."""
    if path.suffix.lower() != ".log":
        return None
    check_ordinary(path)
    if not path.exists():
        raise RecordingError(f"{path}: does not exist")
    return header_from(path, starmap(Line, _candump(path, lambda _: None, ours=False)))


def _lines(path: Path, tell: Tell) -> Iterator[Line]:
    if path.suffix.lower() == ".log":
        return starmap(Line, _candump(path, tell, ours=False))
    if path.suffix.lower() in SUFFIXES:
        from cylforce.files.messages import messages  # with python-can's readers, which take a while to import

        return messages(path, tell)
    raise RecordingError(f"{path}: is none of the recordings that can be read ({', '.join(SUFFIXES)})")


def _one_channel(path: Path, lines: Iterator[Line], channel: str | None) -> Iterator[Line]:
    """The lines of one bus, where there are any: two buses must not be merged into one."""
    chosen, seen = channel, set()
    for said in lines:
        seen.add(said.channel)
        if chosen is None:
            chosen = said.channel
        if said.channel == chosen:
            yield said
        elif channel is None:
            raise RecordingError(f"{path}: holds several buses ({chosen}, {said.channel}, ...): choose one")
    if chosen not in seen:
        raise RecordingError(f"{path}: holds no frame{f' of {channel}' if channel else ''}{_but(seen)}")


def _but(seen: set[str]) -> str:
    return f", only of {', '.join(sorted(seen))}" if seen else ""


def _candump(path: Path, tell: Tell, *, ours: bool) -> Iterator[Parts]:
    skipped = number = 0
    try:
        with path.open(encoding="latin-1", newline="\n") as file:
            for block in blocks_of(path, file):
                whole = parts_of(block)
                if whole is not None:
                    number += len(whole)
                    yield from whole
                    continue
                for text in StringIO(block):
                    number += 1
                    said = parts(text)
                    if not text.endswith("\n") and (ours or said is None):
                        tell(f"{path}: line {number}, the last, is cut off and was left out")
                    elif said is not None:
                        yield said
                    elif is_newer_frame(text):
                        skipped += 1
                    elif text[0] not in "#\r\n":
                        raise RecordingError(f"{path}, line {number}: is no frame of candump text: {text[:60]!r}")
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    if skipped:
        tell(f"{path}: {skipped} CAN FD or XL frames were skipped")


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
