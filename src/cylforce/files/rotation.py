"""The files of a log that follow each other: which are older, which is the present one, whether another has room."""

import errno
import os
import re
from io import FileIO
from pathlib import Path
from typing import NamedTuple

SHARE = 0.05  # share of the disk that must be free before a log that found it full continues; chosen


class Rotation(NamedTuple):
    """A log of limited size.

    size: bytes after which a new file begins
    keep: number of older files that are kept; the lowest number (see `opened`) is the oldest
    """

    size: int
    keep: int


def opened(path: Path, rotation: Rotation | None) -> FileIO:
    """Return a new, empty file of this name, open for writing. Raises OSError.

    An earlier log of this name, unless it is empty, is kept with the next number before its suffix, as NAME.3.log of
    NAME.log, because the log before a crash is the one of interest. With a rotation only `keep` earlier logs are kept:
    the oldest ones are deleted.
    """
    earlier = earlier_files(path)
    if path.is_file() and path.stat().st_size:
        number = 1 + max(earlier, default=0)
        earlier[number] = path.rename(path.with_name(f"{path.stem}.{number}{path.suffix}"))
    if rotation is not None:
        for number in sorted(earlier)[: max(0, len(earlier) - rotation.keep)]:
            earlier[number].unlink(missing_ok=True)
    return FileIO(path, "w")


def earlier_files(path: Path) -> dict[int, Path]:
    """Return earlier logs of this name by their numbers."""
    name = re.compile(rf"{re.escape(path.stem)}\.([1-9]\d*){re.escape(path.suffix)}")
    matches = ((name.fullmatch(other.name), other) for other in path.parent.iterdir())
    return {int(match[1]): other for match, other in matches if match}


def lost_its_name(path: Path, file: FileIO) -> bool:
    """Return whether the open file no longer has its name: it was renamed, deleted or replaced."""
    try:
        named = path.stat()
    except FileNotFoundError:
        return True
    except OSError:  # the next write shows what is wrong
        return False
    open_file = os.fstat(file.fileno())
    return (named.st_dev, named.st_ino) != (open_file.st_dev, open_file.st_ino)


def check_room(path: Path, rotation: Rotation) -> None:
    """Raise OSError unless the disk has room for two more files of the log, or SHARE of the disk is free.

    path: file of the log
    """
    disk = os.statvfs(path.parent)
    free = disk.f_bavail * disk.f_frsize
    if free < min(2 * rotation.size, SHARE * disk.f_blocks * disk.f_frsize):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
