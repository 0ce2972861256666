"""What recordings' readers and writers share: one kind of error, a way to tell, files replaced whole."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import structlog

Tell = Callable[[str], None]


class RecordingError(Exception):
    """A recording cannot be read or written; the text is one sentence that names file, place and cure."""


def warn(sentence: str) -> None:
    """Tell what is worth knowing but stops nothing."""
    structlog.get_logger("cylforce").warning(sentence)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Path of a temporary file that takes the place of `path` once it is complete: readers see old or new."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())  # else a power cut may keep the new name and lose what it names
        temporary.replace(path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)
