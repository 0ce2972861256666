"""Recordings of work with true loads, wherever they come from."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cylforce.settings.machine_file import load

from .reference import KNOWN, STANDING, Bucket, Ride, record

LATE = 1.0  # s after the next digging begins, in which a bucket may still be booked


@dataclass(frozen=True)
class Work:
    """A machine: where its file and recordings are; those of the empty machine; the known lift, if there is one; the
    work, and its buckets."""

    name: str
    folder: Path
    empty: tuple[str, ...]
    lift: tuple[str, float] | None
    work: str
    buckets: tuple[Bucket, ...]


def reference(kind: str, seed: int, cycles: int, cache: Path, *, lift: bool, ride: Ride = STANDING) -> Work:
    """A reference machine of a kind (`reference.DRAWN`), recorded unless it is in the cache."""
    folder = record(kind, seed, cycles, cache, ride)
    header = json.loads((folder / "truth" / "work.json").read_text())
    found = tuple(_noted(cycle) for piece in header["pieces"] for cycle in piece["cycles"])
    rated = load(folder / "machine.toml").service.machine.rated_payload
    known = ("known_lift", KNOWN * rated) if lift else None
    return Work(f"{kind} {seed}{', lift' if lift else ''}", folder, ("commissioning",), known, "work", found)


def _noted(cycle: dict[str, Any]) -> Bucket:
    (free, dumps), (empty, digs) = cycle["free_s"], cycle["empty_s"]
    return Bucket(cycle["payload_kg"], cycle["carry_back_kg"], free, dumps, empty, digs + LATE)


def foreign(folder: Path) -> list[Work]:
    """The machines of a folder with `labels.json` (see tools/README.md), each with its digging in order."""
    found = []
    for label in json.loads((folder / "labels.json").read_text()):
        cycles = [e for e in label["events"] if e["type"] == "cycle"]
        if label["in_order"] and cycles:
            begins = [c["t_dig"] for c in cycles[1:]] + [float("inf")]
            buckets = tuple(_labelled(c, digs) for c, digs in zip(cycles, begins, strict=True))
            empty = ("reference_static", "reference_moving")
            place = folder / label["machine"]
            found.append(Work(label["machine"], place, empty, None, label["recording"], buckets))
    return found


def _labelled(cycle: dict[str, Any], digs: float) -> Bucket:
    times = (cycle["t_lift0"], cycle["t_dump0"], cycle["t_dump1"], digs)
    return Bucket(cycle["payload_kg"], cycle["carry_back_kg"], *times)
