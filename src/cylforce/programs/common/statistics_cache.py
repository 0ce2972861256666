"""Statistics of references, kept from one diagnosis to the next in a folder of the user's cache.

Learning takes half of the time of a diagnosis, and the references of a machine stay the same. A file that is broken,
or that cannot be written, is ignored.
"""

import os
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from inspect import getfile
from pathlib import Path

import numpy as np

from cylforce.diagnosis.model import HealthyMachine, KnowledgeSource
from cylforce.diagnosis.regressors import Regressors
from cylforce.effects.library import Proposal
from cylforce.programs.common.machine_statistics import arrays_of, machine_of
from cylforce.programs.common.program_code import file_digest, program
from cylforce.readings.recording import Recording
from cylforce.signals.estimate import Array

MOST_BYTES = 100_000_000  # of all files together: some fifty machines; the longest unused go first
ROOMS = ("signals", "mechanics", "effects", "estimation", "readings", "diagnosis")  # whose code makes the statistics


def cache_folder() -> Path | None:
    """Return the folder: $XDG_CACHE_HOME/cylforce/statistics, by default below ~/.cache; None without a home."""
    with suppress(RuntimeError):
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "cylforce" / "statistics"
    return None


@dataclass(frozen=True)
class StatisticsCache:
    """Statistics in the files of one folder, by key.

    folder: where
    most:   size of all files together [bytes]
    """

    folder: Path
    most: int = MOST_BYTES

    def get(self, key: str, regressors: Regressors, proposals: tuple[Proposal, ...]) -> HealthyMachine | None:
        """Return the statistics of a key, if they are there and whole."""
        path = self._path(key)
        try:
            with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
                found = machine_of(dict(file), regressors.model, proposals)
            os.utime(path)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None
        return found

    def put(self, key: str, machine: HealthyMachine) -> None:
        """Keep statistics, whole or not at all."""
        path = self._path(key)
        temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        with suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            try:
                with temporary.open("wb") as file:
                    np.savez(file, allow_pickle=False, **arrays_of(machine))
                temporary.replace(path)
            finally:
                temporary.unlink(missing_ok=True)
            self._shrink()

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.npz"

    def _shrink(self) -> None:
        """Delete the least recently used files while the cache is too large."""
        files = sorted(((p.stat(), p) for p in self.folder.glob("*.npz")), key=lambda each: each[0].st_mtime_ns)
        size = sum(stat.st_size for stat, _ in files)
        for stat, path in files:
            if size <= self.most:
                break
            path.unlink(missing_ok=True)
            size -= stat.st_size


def key_of(
    machine_sha256: str,
    regressors: Regressors,
    proposals: Sequence[Proposal],
    recordings: Sequence[Recording],
    sensor_noise: Array,
    source: KnowledgeSource,
    rooms: tuple[str, ...] = ROOMS,
) -> str:
    """Return the key of all that statistics depend on: recordings, machine, model, parameters, effects, program.

    machine_sha256: of the machine file
    rooms:          whose code makes the statistics
    """
    model = regressors.model
    said = (machine_sha256, model.friction, model.filters, str(source), [(r.load_kg, r.begins_s) for r in recordings])
    effects = [(p.name, p.at, p.where, p.group) for p in proposals]
    files = sorted({getfile(type(effect)) for p in proposals for effect in p.group})
    parts = [repr(said).encode(), repr(effects).encode(), program(rooms).encode(), *map(file_digest, files)]
    names = [r.name.encode() for r in recordings]
    values = [_bytes(each) for each in (regressors.parameters, sensor_noise, *(r.values for r in recordings))]
    return sha256(b"\0".join([*parts, *names, *values])).hexdigest()


def _bytes(values: Array) -> bytes:
    return repr((values.shape, values.dtype.str)).encode() + np.ascontiguousarray(values).tobytes()
