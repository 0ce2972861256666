"""Results of earlier runs, one file each in the user's cache folder: a second run does only what is new, and a run that
was killed goes on. A file that is broken counts for nothing.

A file is a line of JSON (facts, names and shapes of the arrays, their checksum), then the arrays as they are in memory:
a thousand of them are read in a fraction of a second."""

import json
import os
import zlib
from contextlib import suppress
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from cylforce.estimation.model import BetweenStrokes, Tares
from cylforce.fleet.evidence import Evidence
from cylforce.programs.common.statistics_cache import cache_folder
from cylforce.programs.fleet.task import Summary
from cylforce.signals.estimate import Array

STAMPS, SUFFIX = "stamps.json", ".result"
NUMBER, WHOLE = "<f8", 8  # bytes of a number, of which the arrays' place is a multiple: they are read where they are


def fleet_cache_folder() -> Path | None:
    """$XDG_CACHE_HOME/cylforce/fleet, by default below ~/.cache; None without a home."""
    rows = cache_folder()
    return None if rows is None else rows.with_name("fleet")


@dataclass
class KeptResults:
    """Results in one folder (None: nothing is kept), and the contents' hashes by address and stamp."""

    folder: Path | None
    stamps: dict[str, list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.folder is not None:
            with suppress(OSError, ValueError):
                self.stamps = json.loads((self.folder / STAMPS).read_text(encoding="utf-8"))

    def keys(self) -> frozenset[str]:
        """Keys of all that is kept."""
        return frozenset(p.stem for p in self.folder.glob(f"*{SUFFIX}")) if self.folder is not None else frozenset()

    def sha256(self, address: str, stamp: str) -> str | None:
        """The content's hash, if a file with that stamp was read before."""
        said = self.stamps.get(address)
        return said[1] if said and said[0] == stamp and stamp else None

    def get(self, key: str) -> Summary | None:
        """A result, if it is there and whole."""
        if self.folder is None:
            return None
        try:
            return unpacked((self.folder / f"{key}{SUFFIX}").read_bytes())
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def put(self, key: str, outcome: Summary) -> None:
        """Keep a result: whole or not at all."""
        if self.folder is None:
            return
        self._write(f"{key}{SUFFIX}", packed(outcome))

    def remember(self) -> None:
        """Write the stamps."""
        self._write(STAMPS, json.dumps(self.stamps).encode())

    def _write(self, name: str, content: bytes) -> None:
        if self.folder is None:
            return
        temporary = self.folder / f".{name}.{os.getpid()}.tmp"
        with suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            try:
                temporary.write_bytes(content)
                temporary.replace(self.folder / name)
            finally:
                temporary.unlink(missing_ok=True)


def packed(outcome: Summary) -> bytes:
    """A result as it is kept."""
    said: dict[str, Any] = {"facts": outcome.facts}
    arrays: list[Array] = []
    for name, part in (("told", outcome.told), ("tares", outcome.tares)):
        if part is not None:
            own = part._asdict()
            said[name] = {k: list(v.shape) if isinstance(v, np.ndarray) else v for k, v in own.items()}
            arrays += [v for v in own.values() if isinstance(v, np.ndarray)]
    content = b"".join(np.ascontiguousarray(each, dtype=NUMBER).tobytes() for each in arrays)
    said["crc32"] = zlib.crc32(content)
    header = json.dumps(said).encode()
    return header + b" " * (-(len(header) + 1) % WHOLE) + b"\n" + content


def unpacked(content: bytes) -> Summary:
    """A result from `packed`. Raises ValueError, KeyError or TypeError for what is none, or not whole."""
    begins = content.index(b"\n") + 1
    said = json.loads(content[:begins])
    if zlib.crc32(memoryview(content)[begins:]) != said["crc32"]:
        raise ValueError("is not whole")
    numbers, at = np.frombuffer(content, dtype=NUMBER, offset=begins), 0

    def filled(own: dict[str, Any], arrays: tuple[str, ...]) -> dict[str, Any]:
        nonlocal at
        for name in arrays:
            size = prod(own[name])
            own[name], at = numbers[at : at + size].reshape(own[name]), at + size
        return own

    told = Evidence(**filled(said["told"], ("parts", "joints", "samples"))) if "told" in said else None
    return Summary(said["facts"], told, _tares(filled(said["tares"], TARES)) if "tares" in said else None)


TARES = ("values", "covariance", "row_error")


def _tares(own: dict[str, Any]) -> Tares:
    own |= {name: tuple(own[name]) for name in ("friction", "names")}
    return Tares(**own | {"between_strokes": BetweenStrokes(*own["between_strokes"])})
