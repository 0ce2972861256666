"""Work on one recording: it is read in place, and its evidence is computed.

The result depends only on the recording's content, the machine file and the program. The work may be done anywhere, in
any order, and again.
"""

import hashlib
import json
import os
import resource
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from cylforce.commissioning.identification import identify
from cylforce.estimation.model import Tares
from cylforce.files.atomic import RecordingError
from cylforce.files.logreader import with_ticks
from cylforce.files.recording import Events, open_pieces, sensor_frames
from cylforce.fleet.coordinates import followed_model
from cylforce.fleet.evidence import Evidence, evidence
from cylforce.programs.common.program_code import program
from cylforce.programs.common.readings import model_of
from cylforce.programs.common.recorded import SHORTEST_S, chosen
from cylforce.programs.fleet.store import stamp_of, stored_path
from cylforce.programs.replay import replay
from cylforce.readings.recording import Recording
from cylforce.service.core import Core
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import Loaded, load_text

PIECE = 1 << 20  # bytes that are read at once for the hash
ROOMS = (
    "signals",
    "mechanics",
    "effects",
    "estimation",
    "service",
    "commissioning",
    "readings",
    "diagnosis",
    "fleet",
    "files",
)
OK, DOUBTFUL, WORK, FAILED, CHANGED = "ok", "doubtful", "at work", "failed", "changed while read"


class Job(NamedTuple):
    """Recording to be processed.

    address:      of the recording
    machine_file: address of the machine file
    text:         content of the machine file
    """

    address: str
    machine_file: str
    text: str


class Summary(NamedTuple):
    """Result of a recording.

    facts: values of the table by name, `state` and `reason` among them
    told:  its evidence; None if it has none
    tares: identified parameters; None if there are none
    """

    facts: dict[str, Any]
    told: Evidence | None = None
    tares: Tares | None = None


@lru_cache(maxsize=64)
def loaded_of(text: str, where: str) -> Loaded:
    """Return the machine of a file's text. Raises SettingsError."""
    return load_text(text, Path(where))


def key_of(sha256: str, text: str) -> str:
    """Return the key of a result: hash of recording, machine file and program."""
    parts = (sha256, hashlib.sha256(text.encode()).hexdigest(), program(ROOMS))
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def content_sha256(address: str) -> str:
    """Return the hash of a recording's content."""
    digest = hashlib.sha256()
    with stored_path(address).open("rb") as file:
        while piece := file.read(PIECE):
            digest.update(piece)
    return digest.hexdigest()


def summarised(job: Job, known: frozenset[str] = frozenset()) -> Summary:
    """Return the result of a recording; an error becomes its reason.

    known: keys of results that exist; their recordings are not read again
    """
    begun = process_time()
    facts: dict[str, Any] = {"state": FAILED, "reason": "", "sha256": "", "warnings": []}
    try:
        before = stamp_of(job.address)
        facts["sha256"] = content_sha256(job.address)
        if key_of(facts["sha256"], job.text) in known:
            return Summary(facts | {"state": "known"})
        outcome = _told(job, facts)
        if stamp_of(job.address) != before:
            raise _WhileReadError(f"{job.address}: changed while it was read: run again when it is complete")
    except Exception as error:  # noqa: BLE001 - a bad file must not end the work on the others
        state = CHANGED if isinstance(error, _WhileReadError) else FAILED
        outcome = Summary(facts | {"state": state, "reason": _said(job.address, error)})
    outcome.facts["took_s"] = process_time() - begun
    outcome.facts["memory_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    return outcome


class _WhileReadError(RecordingError):
    """A recording that is still being written."""


def _said(address: str, error: Exception) -> str:
    text = (str(error).splitlines() or [""])[0] or type(error).__name__
    own = isinstance(error, ValueError | RecordingError)
    text = text if own or isinstance(error, OSError) else f"{type(error).__name__}: {text}"
    return text.removeprefix(f"{address}: ")[:400]


def _told(job: Job, facts: dict[str, Any]) -> Summary:
    loaded = loaded_of(job.text, job.machine_file)
    warnings: list[str] = facts["warnings"]
    found = chosen(loaded, [stored_path(job.address)], {}, tell=warnings.append)
    facts["begins_s"] = found.stretches[0].begins_s if found.stretches else 0.0
    facts["of_seconds"] = found.looked_at[0].of_seconds
    facts["usable"] = found.looked_at[0].seconds / max(facts["of_seconds"], 1e-9)
    if not found.stretches:
        why = "".join(found.short.values()) or "check that no sensor drops out"
        raise RecordingError(f"no gapless stretch of {SHORTEST_S:.0f} s: {why}")
    told = evidence(followed_model(loaded.service), found.stretches)
    facts |= {"seconds": told.seconds, "unexplained": told.misfit}
    if told.at_work:
        share = f"{100.0 * told.misfit:.0f} % of the torque is not that of the empty machine"
        return Summary(facts | {"state": WORK, "reason": f"{share}: it worked, or its machine file is another one's"})
    return _identified(loaded, found.stretches, facts, told)


def _identified(loaded: Loaded, stretches: Sequence[Recording], facts: dict[str, Any], told: Evidence) -> Summary:
    """Return the result with an identification.

    A recording that the identification refuses is doubtful, but a change of the machine may be the reason.
    """
    segments = [each.values for each in stretches]
    try:
        found = identify(model_of(loaded), segments)
    except ValueError as error:
        return Summary(facts | {"state": DOUBTFUL, "reason": str(error)}, told)
    names = [loaded.service.machine.links[j].name for j in loaded.service.machine.rows]
    shares = {f"explained:{n}": float(s) for n, s in zip(names, found.explained, strict=True) if np.isfinite(s)}
    warnings = [*facts["warnings"], *found.warnings]
    return Summary(facts | shares | {"state": OK, "warnings": warnings}, told, found.tares)


class Booked(NamedTuple):
    """Weights booked from a working recording.

    kg:     weights [kg]
    errors: their standard errors [kg]
    reason: why the recording could not be played; "" if it was
    """

    kg: tuple[float, ...]
    errors: tuple[float, ...]
    reason: str = ""


def booked(job: Job, tares: Tares) -> Booked:
    """Return the weights that the service would book with these parameters."""
    try:
        loaded = loaded_of(job.text, job.machine_file)
        core = Core(loaded.service, tares)
        source = open_pieces(stored_path(job.address), loaded.service, loaded.columns, report=_silent)
        if isinstance(source, Events):
            played = replay(WeighingService.start(core), source.events, _nothing)
        else:
            frames = sensor_frames(source, loaded.service)
            played = replay(WeighingService.start(core), with_ticks(frames, core.period_us, _silent), _nothing)
    except Exception as error:  # noqa: BLE001 - a bad file must not end the work on the others
        return Booked((), (), _said(job.address, error))
    weights = played.bookings
    return Booked(tuple(b.mass for b in weights), tuple(b.standard_error for b in weights))


NONE = Booked((), ())


def _silent(sentence: str) -> None:
    """Ignore a sentence."""


def _nothing(estimate: object) -> None:
    """Keep nothing."""


def tares_key(tares: Tares) -> str:
    """Return a hash of parameters."""
    said = tares._asdict() | {name: getattr(tares, name).tolist() for name in ("values", "covariance", "row_error")}
    return hashlib.sha256(json.dumps(said).encode()).hexdigest()


def on_worker() -> tuple[str, int]:
    """Return the program of a worker and its process, for comparison with the caller's."""
    return program(ROOMS), os.getpid()
