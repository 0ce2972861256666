"""What readers and writers of files share: one kind of error, a way to warn, files that are replaced whole."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import TextIO

Tell = Callable[[str], None]


BLOCK = 1 << 16  # characters of a recording that are read at once; chosen
LONGEST = 1_000_000  # characters of a line of a recording: many times the longest header; chosen
LARGEST = 10_000_000  # bytes of a file of settings: a thousand times the shipped ones; chosen


class RecordingError(Exception):
    """A recording cannot be read or written; the text is one sentence that names file, place and cure."""


def warn(sentence: str) -> None:
    """Log a sentence about something that does not stop the work."""
    import structlog  # most commands need it never, or late

    structlog.get_logger("cylforce").warning(sentence)


def is_stream(path: Path) -> bool:
    """Whether a path is a pipe or a device, from which reading may never end."""
    return path.exists() and not path.is_file() and not path.is_dir()


def is_large(path: Path) -> bool:
    """Whether a file is larger than any settings are."""
    return path.is_file() and path.stat().st_size > LARGEST


def lines_of(path: Path, file: TextIO) -> Iterator[str]:
    """The lines of a text recording, one after the other; raises RecordingError for one that is none."""
    for number in count(1):
        text = file.readline(LONGEST + 1)
        if len(text) > LONGEST:
            raise RecordingError(f"{path}, line {number}: longer than {LONGEST} characters: no recording")
        if not text:
            return
        yield text


def blocks_of(path: Path, file: TextIO) -> Iterator[str]:
    """Whole lines of a text recording, some thousand at once; raises RecordingError for one that is none."""
    rest, number = "", 1
    while text := file.read(BLOCK):
        whole, newline, rest = (rest + text).rpartition("\n")
        if len(rest) > LONGEST:
            number += whole.count("\n") + len(newline)
            raise RecordingError(f"{path}, line {number}: longer than {LONGEST} characters: no recording")
        if newline:
            number += whole.count("\n") + 1
            yield whole + newline
    if rest:
        yield rest


def check_ordinary(path: Path) -> None:
    """Raises RecordingError for a pipe or a device."""
    if is_stream(path):
        raise RecordingError(f"{path}: is no ordinary file but a pipe or a device: save its data as a file first")


def check_outputs(
    outputs: Sequence[Path | None], inputs: Iterable[Path | None] = (), suffixes: Sequence[str] = ()
) -> None:
    """Before anything is computed: these files can be written, and replace nothing that this command reads or writes.
    Where `suffixes` are given, one for each output, a file that exists and ends otherwise is not replaced either: it
    may be a recording, named by mistake.

    Raises
    ------
    RecordingError
        For the first that cannot, or would.
    """
    taken = {path.resolve() for path in inputs if path is not None}
    for path, suffix in zip(outputs, suffixes or [""] * len(outputs), strict=True):
        if path is None:
            continue
        _check_place(path)
        if path.resolve() in taken:
            raise RecordingError(f"{path}: would replace another file that this command names: choose another output")
        if path.exists() and suffix and path.suffix.lower() != suffix:
            raise RecordingError(f"{path}: exists and is no {suffix} file, so it is kept: choose another output")
        taken.add(path.resolve())


def _check_place(path: Path) -> None:
    if path.is_dir() or not path.parent.is_dir():
        raise RecordingError(f"{path}: cannot be written: choose a file in a folder that exists and is yours")
    if is_stream(path):
        raise RecordingError(f"{path}: is no ordinary file but a pipe or a device: choose a file to write")
    temporary = _temporary(path)
    try:  # the only sure test: permissions do not know a read-only disk or a name that is too long
        temporary.touch()
        temporary.unlink()
    except OSError as error:
        why = error.strerror or error
        raise RecordingError(f"{path}: cannot be written ({why}): choose another file, in a folder of yours") from error


def _temporary(path: Path) -> Path:
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Path of a temporary file that takes the place of `path` once it is complete: readers see old or new."""
    temporary = _temporary(path)
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())  # else the file may be empty after a power cut
        temporary.replace(path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)
