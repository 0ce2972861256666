"""Recordings for the diagnosis, read in constant memory: all of short ones, of long ones stretches that are spread
evenly."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from cylforce.estimation.segments import parts
from cylforce.files.atomic import Report, warn
from cylforce.files.recording import Events, open_pieces, rows_a_second
from cylforce.files.tables import Table
from cylforce.programs.common.progress import Watch, silent, watched
from cylforce.programs.common.readings import check_machine
from cylforce.programs.common.spread import Kept, Spread
from cylforce.programs.common.unusable import unusable_samples
from cylforce.readings.recording import Recording
from cylforce.service.assembler import assembler
from cylforce.service.samples import samples
from cylforce.settings.machine_file import Loaded
from cylforce.signals.estimate import Array, Reason
from cylforce.signals.events import Frame, Tick

SHORTEST_S = 20.0  # of a stretch
PART_S = 60.0  # of a part, which is examined or left out as a whole
JITTER = 0.98  # times the machine's rate: slower tables are not only of a clock that is not exact (convention)
MOST = 20  # parts of all recordings together, because their rows fill the memory


class LookedAt(NamedTuple):
    """Examined share of a recording.

    name:       of the recording
    seconds:    examined duration [s]
    of_seconds: duration of the recording [s]
    stretches:  number of examined stretches
    """

    name: str
    seconds: float
    of_seconds: float
    stretches: int


class Chosen(NamedTuple):
    """Examined stretches of several recordings.

    stretches: the stretches
    looked_at: how much is examined of each recording
    short:     reason by name of each recording without a stretch that is long enough; "" where unknown
    """

    stretches: list[Recording]
    looked_at: list[LookedAt]
    short: dict[str, str]


def chosen(
    loaded: Loaded,
    paths: Sequence[Path],
    loads: dict[str, float],
    watch: Watch = silent,
    most: int = MOST,
    tell: Report = warn,
) -> Chosen:
    """Return the gapless stretches of recordings that are long enough for a diagnosis.

    most: largest number of stretches of all recordings
    tell: receives sentences on excluded stretches
    """
    rate = loaded.service.filters.rate_hz
    sizes = int(loaded.service.health.hold_s * rate), int(PART_S * rate), int(SHORTEST_S * rate)
    spread, sources, short = Spread(most), [], set(paths)
    for k, path in enumerate(paths):
        source = _Source(loaded, path, watch, tell)
        for number, part in enumerate(parts(source.pieces(), *sizes)):
            spread.add(Kept(k, number, part))
            short.discard(path)
        sources.append(source)
    found = Chosen([], [], {})
    for k, (path, source) in enumerate(zip(paths, sources, strict=True)):
        if path in short:
            found.short[path.name] = source.unusable_samples()
        elif source.unusable[Reason.TWO_PRODUCERS]:
            tell(f"{path}: {source.unusable_samples()}")
        own = [
            Recording(path.name, p.values, loads.get(path.name, 0.0), source.begins + p.first / rate)
            for p in spread.of(k)
        ]
        seconds = sum(len(r.values) for r in own) / rate
        found.stretches.extend(own)
        found.looked_at.append(LookedAt(path.name, seconds, source.rows / rate, len(own)))
    return found


def at_own_rate(loaded: Loaded, paths: Sequence[Path]) -> tuple[Loaded, str]:
    """Return the machine at the rate of the slowest table, if that is below its own, and a sentence on it.

    Samples interpolated between the rows of a table have less noise than the sensors, and it does not change as theirs
    does. A table whose rate the filters do not allow keeps the machine's. Raises RecordingError.
    """
    filters = loaded.service.filters
    rates = {path.name: rows_a_second(path, loaded.service, loaded.columns) for path in paths}
    slower = {name: hz for name, hz in rates.items() if filters.slowest_hz < hz < JITTER * filters.rate_hz}
    if not slower:
        return loaded, ""
    name = min(slower, key=lambda n: slower[n])
    service = loaded.service._replace(filters=filters.at(slower[name]))
    return loaded._replace(service=service), (
        f"the table {name} has {slower[name]:.4g} rows a second, the machine file says {filters.rate_hz:g} "
        f"(filter.rate_hz): all recordings were examined with {slower[name]:.4g}"
    )


class _Source:
    """A recording that is read once.

    begins:   time of its first row [s]
    rows:     number of its rows so far
    unusable: of a log, numbers of rows without a sample so far, by their reason
    """

    def __init__(self, loaded: Loaded, path: Path, watch: Watch, tell: Report) -> None:
        self._loaded, self._path, self._watch, self._tell = loaded, path, watch, tell
        self.begins, self.rows = 0.0, 0
        self.unusable = Counter[Reason]()

    def unusable_samples(self) -> str:
        """Return a sentence on the rows without a sample, "" where there is none."""
        rate_hz = self._loaded.service.filters.rate_hz
        return unusable_samples(self.unusable, self.rows, rate_hz) if self.unusable else ""

    def pieces(self) -> Iterator[Array]:
        """Yield samples (T, S), NaN where a value is missing."""
        recording = open_pieces(self._path, self._loaded.service, self._loaded.columns, report=self._tell)
        for piece in self._logged(recording) if isinstance(recording, Events) else self._tabled(recording):
            self.rows += len(piece)
            yield piece

    def _tabled(self, tables: Iterator[Table]) -> Iterator[Array]:
        for table in tables:
            self._watch(f"reading {self._path.name}", None)
            self.begins = self.begins if self.rows else float(table.t_s[0])
            yield table.values

    def _logged(self, recording: Events) -> Iterator[Array]:
        check_machine(self._path, recording.header, self._loaded)
        service = self._loaded.service
        events = watched(self._path, (e for e in recording.events if isinstance(e, Frame | Tick)), self._watch)
        return samples(assembler(service), events, round(1e6 / service.filters.rate_hz), self.unusable)
