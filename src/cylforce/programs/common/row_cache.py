"""References' rows, kept from one diagnosis to the next in a folder of the user's cache: computing them is half of the
work, and the references of a machine stay the same. A file that is broken, or cannot be written, counts for nothing."""

import os
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from inspect import getfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import cylforce
from cylforce.diagnosis.columns.recorded import GapRows, Recorded
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.effects.library import Proposal
from cylforce.files.logfile import running_versions
from cylforce.signals.estimate import Array

MOST_BYTES = 500_000_000  # of all files together: ten references of six minutes; the longest unused go first
ROOMS = ("signals", "mechanics", "effects", "estimation", "diagnosis")  # whose code makes the rows


def cache_folder() -> Path | None:
    """Where rows are kept: $XDG_CACHE_HOME/cylforce/rows, by default below ~/.cache; None without a home."""
    with suppress(RuntimeError):
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "cylforce" / "rows"
    return None


@dataclass(frozen=True)
class RowCache:
    """Rows in the files of one folder, by key; `most` [bytes]."""

    folder: Path
    most: int = MOST_BYTES

    def get(self, key: str) -> GapRows | None:
        """The rows that were kept, if they are there and whole."""
        path = self._path(key)
        try:
            with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
                found = GapRows(*(file[name] for name in GapRows._fields))
            os.utime(path)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None
        return found

    def put(self, key: str, rows: GapRows) -> None:
        """Keep rows: whole or not at all."""
        path = self._path(key)
        temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        with suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            try:
                with temporary.open("wb") as file:
                    np.savez(file, allow_pickle=False, **rows._asdict())
                temporary.replace(path)
            finally:
                temporary.unlink(missing_ok=True)
            self._shrink()

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.npz"

    def _shrink(self) -> None:
        """Drop what was not used for longest, as long as all together is too much."""
        files = sorted(((p.stat(), p) for p in self.folder.glob("*.npz")), key=lambda each: each[0].st_mtime_ns)
        size = sum(stat.st_size for stat, _ in files)
        for stat, path in files:
            if size <= self.most:
                break
            path.unlink(missing_ok=True)
            size -= stat.st_size


@dataclass(frozen=True)
class KeepingViewer(Viewer):
    """A viewer that keeps the rows of recordings with certain `names`; `machine`: hash of the machine file; `rooms`:
    whose code makes them."""

    kept: RowCache
    names: frozenset[str]
    machine: str
    rooms: tuple[str, ...] = ROOMS

    def rows(self, recorded: Recorded, wanted: Sequence[Proposal], lost: NDArray[np.bool_] | None = None) -> GapRows:
        """The rows of a recording, see `Viewer.rows`."""
        if lost is not None or recorded.name not in self.names:
            return super().rows(recorded, wanted, lost)
        key = self._key(recorded, wanted)
        found = self.kept.get(key)
        if found is None:
            found = super().rows(recorded, wanted).slim
            self.kept.put(key, found)
        return found

    def _key(self, recorded: Recorded, wanted: Sequence[Proposal]) -> str:
        """Of all that rows depend on: recording, machine, model and its tares, effects, and the program."""
        said = (self.machine, self.model.friction, self.model.filters, recorded.load, recorded.begins)
        effects = [(p.name, p.at, p.where, p.group) for p in wanted]
        files = sorted({getfile(type(effect)) for p in wanted for effect in p.group})
        parts = [repr(said).encode(), repr(effects).encode(), program(self.rooms).encode(), *map(_file, files)]
        values = [_bytes(recorded.values), _bytes(self.tares)]
        counts = [] if recorded.counts is None else [_bytes(recorded.counts)]
        return sha256(b"\0".join([*parts, *values, *counts])).hexdigest()


def _bytes(values: Array | NDArray[np.bool_]) -> bytes:
    return repr((values.shape, values.dtype.str)).encode() + np.ascontiguousarray(values).tobytes()


@cache
def _file(path: str) -> bytes:
    return sha256(Path(path).read_bytes()).digest()


@cache
def program(rooms: tuple[str, ...]) -> str:
    """The program and its libraries: versions, and a hash of the code in these rooms."""
    root = Path(cylforce.__file__).parent
    code = b"".join(_file(str(path)) for room in rooms for path in sorted((root / room).rglob("*.py")))
    return f"{sorted(running_versions().items())} {sha256(code).hexdigest()}"
