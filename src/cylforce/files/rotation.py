"""Files of a log that follow each other: which are older, which is the present one, whether another has room."""

import errno
import os
import re
from io import FileIO
from pathlib import Path
from typing import NamedTuple

SHARE = 0.05  # of the disk that must be free before a log that found it full goes on; chosen


class Rotation(NamedTuple):
    """A log of limited size: a new file when this one has `size` bytes, and `keep` older files, FILE.NUMBER.log, the
    lowest number the oldest."""

    size: int
    keep: int


def opened(path: Path, rotation: Rotation | None) -> FileIO:
    """The file, empty. A log of this name is kept as NAME.NUMBER.log, because the log before a crash is the one of
    interest. With a rotation the oldest ones are deleted."""
    found = older(path)
    if path.is_file() and path.stat().st_size:
        number = 1 + max(found, default=0)
        found[number] = path.rename(path.with_name(f"{path.stem}.{number}{path.suffix}"))
    if rotation is not None:
        for number in sorted(found)[: max(0, len(found) - rotation.keep)]:
            found[number].unlink(missing_ok=True)
    return FileIO(path, "w")


def older(path: Path) -> dict[int, Path]:
    """Earlier logs of this name by their numbers."""
    name = re.compile(rf"{re.escape(path.stem)}\.([1-9]\d*){re.escape(path.suffix)}")
    found = ((name.fullmatch(other.name), other) for other in path.parent.iterdir())
    return {int(match[1]): other for match, other in found if match}


def is_elsewhere(path: Path, file: FileIO) -> bool:
    """Whether the open file no longer has its name: it was renamed, deleted or replaced."""
    try:
        there = path.stat()
    except FileNotFoundError:
        return True
    except OSError:  # what cannot be seen now is found out when it is written
        return False
    here = os.fstat(file.fileno())
    return (there.st_dev, there.st_ino) != (here.st_dev, here.st_ino)


def check_room(path: Path, rotation: Rotation) -> None:
    """Raises OSError unless the disk has room for two more files, or a twentieth of it is free."""
    disk = os.statvfs(path.parent)
    free = disk.f_bavail * disk.f_frsize
    if free < min(2 * rotation.size, SHARE * disk.f_blocks * disk.f_frsize):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
