"""Recordings of a fleet with the evidence of each: from earlier runs, or computed now."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from time import monotonic
from typing import Any, NamedTuple

from cylforce.files.atomic import RecordingError
from cylforce.files.tables import SUFFIXES as TABLES
from cylforce.fleet.evidence import Evidence
from cylforce.programs.common.progress import Watch
from cylforce.programs.fleet.kept import KeptResults
from cylforce.programs.fleet.store import ANSWER_S, Stored, stored_path, within
from cylforce.programs.fleet.task import CHANGED, FAILED, Job, Summary, key_of, loaded_of, summarised
from cylforce.programs.fleet.workers import Say, Where, computed
from cylforce.settings.error import SettingsError
from cylforce.settings.machine_file import Loaded

FLUSH_S = 10.0  # after which the results so far can be read
ABSOLUTE_S = 946_684_800.0  # 2000-01-01: a clock with an earlier time counts from the start of the recording


class Gathered(NamedTuple):
    """Recording with its result.

    stored:  the recording
    outcome: its result
    loaded:  its machine file; None where that cannot be used
    """

    stored: Stored
    outcome: Summary
    loaded: Loaded | None

    @property
    def machine_file(self) -> Loaded:
        """The machine file of a recording that was read. Raises ValueError for another."""
        if self.loaded is None:
            raise ValueError(f"{self.stored.address}: its machine file could not be read")
        return self.loaded

    @property
    def evidence(self) -> Evidence:
        """Evidence of a recording of the empty machine. Raises ValueError for another."""
        if self.outcome.told is None:
            raise ValueError(f"{self.stored.address}: tells nothing of its machine")
        return self.outcome.told

    @property
    def made(self) -> str:
        """Time of the recording: by its name, else by its own clock, if that is set."""
        begins = float(self.outcome.facts.get("begins_s", 0.0))
        if self.stored.made or begins < ABSOLUTE_S:
            return self.stored.made
        return datetime.fromtimestamp(begins, UTC).replace(tzinfo=None).isoformat(timespec="seconds")


Flush = Callable[[Sequence[Gathered]], None]


@dataclass
class FleetReading:
    """Reading of the recordings of a fleet.

    found: the recordings
    kept:  results of earlier runs
    where: where the work is done
    watch: receives the progress
    say:   receives sentences
    flush: receives the results so far, from time to time
    flush_s: time after which the results so far can be read [s]
    """

    found: Sequence[Stored]
    kept: KeptResults
    where: Where
    watch: Watch
    say: Say
    flush: Flush
    flush_s: float = FLUSH_S
    _texts: dict[str, str] = field(default_factory=dict)
    _outcomes: dict[str, Summary] = field(default_factory=dict)
    _flushed: float = 0.0

    def gathered(self) -> list[Gathered]:
        """Return all recordings with their results, in order of machine and time.

        Each result is kept, and can be read, as soon as it is computed.
        """
        self._flushed = monotonic()
        self._read_machine_files()
        jobs = [Job(s.address, s.machine_file, self._texts[s.machine_file]) for s in self.found if self._to_do(s)]
        known = {s.address: s for s in self.found}
        if jobs:
            self.watch("recordings", 0.0)
            try:
                take, shared = self._taker(known, len(jobs)), (self.kept.keys(),)
                computed(summarised, [(job,) for job in jobs], shared, self.where, take, self.say)
            finally:
                self.kept.remember()
        return self.so_far()

    def so_far(self) -> list[Gathered]:
        """Return the recordings with a result."""
        each = [(s, self._outcomes[s.address]) for s in self.found if s.address in self._outcomes]
        return [Gathered(s, outcome, self._loaded(s.machine_file)) for s, outcome in each]

    def _taker(self, known: Mapping[str, Stored], count: int) -> Callable[[Any, Any], None]:
        done: list[str] = []

        def take(arguments: tuple[Job], came: Summary | BaseException) -> None:
            (job,) = arguments
            self._take(job, known[job.address], came)
            done.append(job.address)
            self.watch("recordings", len(done) / count)
            if monotonic() - self._flushed > self.flush_s:
                self.flush(self.so_far())
                self.kept.remember()
                self._flushed = monotonic()

        return take

    def _take(self, job: Job, stored: Stored, came: Summary | BaseException) -> None:
        if isinstance(came, BaseException):
            came = Summary(_facts(FAILED, _ended(came)))
        sha256 = came.facts["sha256"]
        if came.facts["state"] == "known":
            came = self.kept.get(key_of(sha256, job.text)) or Summary(_facts(FAILED, "its kept result is broken"))
        elif sha256 and came.facts["state"] != CHANGED:
            self.kept.put(key_of(sha256, job.text), came)
        if sha256 and came.facts["state"] != CHANGED:
            self.kept.stamps[job.address] = [stored.stamp, sha256]
        self._outcomes[job.address] = came

    def _to_do(self, stored: Stored) -> bool:
        """Return whether a recording has to be read; else store its outcome."""
        reason = stored.doubt or self._refused.get(stored.machine_file, "")
        if reason:
            self._outcomes[stored.address] = Summary(_facts(FAILED, reason))
            return False
        sha256 = self.kept.sha256(stored.address, stored.stamp)
        kept = self.kept.get(key_of(sha256, self._texts[stored.machine_file])) if sha256 else None
        if kept is not None:
            self._outcomes[stored.address] = kept
        return kept is None

    _refused: dict[str, str] = field(default_factory=dict)

    def _read_machine_files(self) -> None:
        for address in sorted({s.machine_file for s in self.found if s.machine_file}):
            cure = f"{address}: this machine file cannot be read"
            try:
                self._texts[address] = within(ANSWER_S, lambda a=address: _text(a), cure)  # type: ignore[misc]
                loaded_of(self._texts[address], address)
            except (RecordingError, SettingsError, UnicodeDecodeError) as error:
                self._refused[address] = str(error)

    def _loaded(self, address: str) -> Loaded | None:
        if not address or address in self._refused:
            return None
        return loaded_of(self._texts[address], address)


def _facts(state: str, reason: str) -> dict[str, Any]:
    return {"state": state, "reason": reason, "sha256": "", "warnings": []}


def _text(address: str) -> str:
    with stored_path(address).open("rb") as file:
        return bytes(file.read()).decode("utf-8")


def _ended(error: BaseException) -> str:
    if type(error).__name__ == "KilledWorker":
        return "its worker ended each time, probably for want of memory: split the file, or give workers more memory"
    return f"could not be computed: {type(error).__name__}: {str(error)[:200]}"


def is_table(stored: Stored) -> bool:
    """Return whether a recording is a table, which has no clock of its own."""
    return any(stored.name.lower().endswith(suffix) for suffix in TABLES)
