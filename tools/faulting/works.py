"""Machines at work in order, identified from their own commissioning: what the scenarios begin with."""

import pickle
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from cylforce.commissioning.identification import identify
from cylforce.estimation.model import Tares
from cylforce.files.logreader import with_ticks
from cylforce.files.recording import as_frames, open_recording
from cylforce.files.tables import Table
from cylforce.programs.common.play import prepare
from cylforce.programs.common.readings import model_of
from cylforce.service.core import Core
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.estimate import Array
from cylforce.signals.events import Event
from weighing.bucket import Work, foreign, reference
from weighing.trial import WHOLE, tares

ROOT = Path(__file__).resolve().parents[2]
CACHE = Path.home() / ".cache" / "cylforce" / "faults"
CYCLES = 12  # of a recording


class Case(NamedTuple):
    """A machine at work: its name, file, service and samples."""

    name: str
    loaded: Loaded
    core: Core
    table: Table

    @property
    def rate_hz(self) -> float:
        """Samples per second."""
        return self.loaded.service.filters.rate_hz


def reference_case(seed: int, recording: str | None = None) -> Case:
    """A reference machine, recorded unless it is in the cache, digging or with another of its recordings."""
    return opened(reference("excavator", seed, CYCLES, CACHE, lift=True), recording)


def foreign_case(folder: Path, name: str, recording: str | None = None) -> Case:
    """A machine of a foreign generator (see tools/README.md), digging or with another of its recordings."""
    return opened(_foreign(folder)[name], recording)


@cache
def _foreign(folder: Path) -> dict[str, Work]:
    return {work.name: work for work in foreign(folder)}


def opened(work: Work, recording: str | None = None) -> Case:
    """A work with its recording, or another one of that machine."""
    loaded = load(work.folder / "machine.toml")
    table = open_recording(work.folder / f"{recording or work.work}.parquet", loaded.service, loaded.columns)
    found = _kept(f"{work.name.replace(' ', '_')}.tares", lambda: tares(work, loaded, WHOLE))
    return Case(work.name, loaded, Core(loaded.service, cast(Tares, found)), cast(Table, table))


def simulated_case(seed: int) -> Case:
    """The project's own simulated excavator."""
    loaded = load(ROOT / "config" / "excavator_20t.toml")

    def known() -> Tares:
        found = identify(model_of(loaded), [_simulated(loaded, "moves", seed, 120.0)]).tares
        return found._replace(common_error=0.0)  # as after the lift of a known weight

    found = cast(Tares, _kept(f"simulated_{seed}.tares", known))
    values = cast(Array, _kept(f"simulated_{seed}.work", lambda: _simulated(loaded, "cycles", seed, CYCLES)))
    times = np.arange(len(values)) / loaded.service.filters.rate_hz
    names = tuple(s.name for s in loaded.service.machine.signals)
    return Case(f"simulated {seed}", loaded, Core(loaded.service, found), Table(times, values, names))


def _simulated(loaded: Loaded, scenario: str, seed: int, amount: float) -> Array:
    return np.concatenate([r.values for r in prepare(loaded, scenario, seed, 0.1, amount=amount).records])


def _kept(name: str, make: Callable[[], object]) -> object:
    """What is in the cache, else made and put there."""
    CACHE.mkdir(parents=True, exist_ok=True)
    path = CACHE / name
    if not path.exists():
        path.write_bytes(pickle.dumps(make()))
    return cast(object, pickle.loads(path.read_bytes()))


def events(case: Case, values: Array, rows: slice) -> Iterator[Event]:
    """Frames and ticks of some rows of samples (T, S), as they are among all rows: pieces that follow each other leave
    no tick out. PDOs are sent at every row."""
    first = max(0, (rows.start or 0) - 1)  # a tick is at a frame that is not the first one
    around = slice(first, rows.stop)
    table = Table(case.table.t_s[around], values[around], case.table.signals)
    pdos = [pdo for node in case.loaded.service.nodes for pdo in node.pdos]
    begin = round(1e6 * float(case.table.t_s[rows.start or 0]))
    whole = with_ticks(as_frames(table, pdos), case.core.period_us, lambda _: None)
    return (event for event in cast(Iterator[Event], whole) if event.t_us >= begin)
