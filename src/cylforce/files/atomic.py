"""Shared by all readers and writers of files: one class of errors, a way to report, files that are replaced whole."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import TextIO

Report = Callable[[str], None]


BLOCK = 1 << 16  # characters of a recording that are read at once; chosen
LONGEST = 1_000_000  # characters of a line of a recording: many times the longest header; chosen
LARGEST = 10_000_000  # bytes of a file of settings: a thousand times the shipped ones; chosen


class RecordingError(Exception):
    """A recording cannot be read or written; the text is one sentence that names file, place and cure."""


def warn(sentence: str) -> None:
    """Log a sentence about something that does not stop the program."""
    import structlog  # imported late: most commands never need it

    structlog.get_logger("cylforce").warning(sentence)


def is_stream(path: Path) -> bool:
    """Return whether a path is a pipe or a device, from which reading may never end."""
    return path.exists() and not path.is_file() and not path.is_dir()


def is_large(path: Path) -> bool:
    """Return whether a file is larger than any settings are."""
    return path.is_file() and path.stat().st_size > LARGEST


def lines_of(path: Path, file: TextIO) -> Iterator[str]:
    """Yield the lines of a text recording, with their line ends. Raises RecordingError for a line that is too long.

    path: name of the recording in an error
    """
    for number in count(1):
        text = file.readline(LONGEST + 1)
        if len(text) > LONGEST:
            raise RecordingError(f"{path}, line {number}: longer than {LONGEST} characters: no recording")
        if not text:
            return
        yield text


def blocks_of(path: Path, file: TextIO) -> Iterator[str]:
    """Yield whole lines of a text recording, some thousand in one text; only the last may lack its line end.

    Raises RecordingError for a line that is too long.

    path: name of the recording in an error
    """
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
    """Raise RecordingError for a pipe or a device."""
    if is_stream(path):
        raise RecordingError(f"{path}: is no ordinary file but a pipe or a device: save its data as a file first")


def check_outputs(
    outputs: Sequence[Path | None], inputs: Iterable[Path | None] = (), suffixes: Sequence[str] = ()
) -> None:
    """Check, before anything is computed, that files can be written and replace nothing that the command reads or
    writes.

    Raises RecordingError for the first one that cannot, or would.

    outputs: files to write; None: not written
    inputs: files that the command reads
    suffixes: one for each output: an existing file with another ending is not replaced, as it may be a recording; "":
        any may be replaced
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
    """Raise RecordingError where no file of this path can be written; a temporary file is written and removed."""
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
    """Return the path under which a file is written until it is complete."""
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield the path of a temporary file that replaces `path` once it is complete: readers see the old or the new
    file.

    If the caller fails meanwhile, the old file stays. Raises RecordingError in place of OSError.
    """
    temporary = _temporary(path)
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())  # otherwise the file may be empty after a power cut
        temporary.replace(path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)
