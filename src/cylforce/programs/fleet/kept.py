"""Results of earlier runs, one file each in the user's cache folder: a second run does only what is new, and a run that
was killed goes on. A file that is broken counts for nothing."""

import json
import os
import zipfile
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cylforce.fleet.evidence import Evidence
from cylforce.programs.common.row_cache import cache_folder
from cylforce.programs.fleet.task import Summary, packed_tares, unpacked_tares

STAMPS = "stamps.json"


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
        return frozenset(p.stem for p in self.folder.glob("*.npz")) if self.folder is not None else frozenset()

    def sha256(self, address: str, stamp: str) -> str | None:
        """The content's hash, if a file with that stamp was read before."""
        said = self.stamps.get(address)
        return said[1] if said and said[0] == stamp and stamp else None

    def get(self, key: str) -> Summary | None:
        """A result, if it is there and whole."""
        if self.folder is None:
            return None
        try:
            with (self.folder / f"{key}.npz").open("rb") as raw, np.load(raw, allow_pickle=False) as file:
                facts = json.loads(str(file["facts"]))
                told = None
                if "parts" in file:
                    numbers = (float(x) for x in file["numbers"])
                    told = Evidence(file["parts"], file["joints"], file["samples"], *numbers)
                tares = unpacked_tares(str(file["tares"])) if "tares" in file else None
        except (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile):
            return None
        return Summary(facts, told, tares)

    def put(self, key: str, outcome: Summary) -> None:
        """Keep a result: whole or not at all."""
        if self.folder is None:
            return
        arrays: dict[str, Any] = {"facts": np.array(json.dumps(outcome.facts))}
        if outcome.told is not None:
            told = outcome.told
            arrays |= {"parts": told.parts, "joints": told.joints, "samples": told.samples}
            arrays["numbers"] = np.array([told.misfit, told.seconds])
        if outcome.tares is not None:
            arrays["tares"] = np.array(packed_tares(outcome.tares))
        temporary = self.folder / f".{key}.{os.getpid()}.tmp"
        with suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            try:
                with temporary.open("wb") as file:
                    np.savez(file, allow_pickle=False, **arrays)
                temporary.replace(self.folder / f"{key}.npz")
            finally:
                temporary.unlink(missing_ok=True)

    def remember(self) -> None:
        """Write the stamps."""
        if self.folder is None:
            return
        with suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            temporary = self.folder / f".{STAMPS}.{os.getpid()}.tmp"
            temporary.write_text(json.dumps(self.stamps), encoding="utf-8")
            temporary.replace(self.folder / STAMPS)
