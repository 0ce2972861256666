"""Inputs of the programs: a machine's model and core from its files, the samples of its recordings."""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

from cylforce.estimation.attachment import with_tool
from cylforce.estimation.kernel.choice import choice
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.segments import gapless
from cylforce.files.atomic import RecordingError, Report, warn
from cylforce.files.checkpoint import packed, unpacked, unpacked_state
from cylforce.files.logfile import Header, file_sha256, running_versions
from cylforce.files.logreader import log_header
from cylforce.files.recording import open_recording
from cylforce.files.tables import Table
from cylforce.programs.common.progress import Watch, silent, watched
from cylforce.programs.common.unusable import unusable_samples
from cylforce.service.assembler import assembler
from cylforce.service.commands import Scale
from cylforce.service.core import Core
from cylforce.service.hanging import hanging
from cylforce.service.memory import NOTHING_KEPT, Memory
from cylforce.service.samples import samples
from cylforce.service.service import WeighingService
from cylforce.service.snapshot import State
from cylforce.settings.identified import identified_warnings, read_attachments, read_identified
from cylforce.settings.machine_file import Loaded
from cylforce.signals.estimate import Array, Reason
from cylforce.signals.events import Frame, Tick

if TYPE_CHECKING:  # the service needs neither identification nor scipy
    from cylforce.commissioning.identification import Identification

KNOWN = (0.05, 2.0)  # times the rated payload: known weights from which the scale can be taken; chosen


def machine_file_of(files: Sequence[Path]) -> tuple[Path, list[Path]]:
    """Return the machine file and the recordings: the machine file comes first, or a cylforce log names it."""
    if files[0].suffix == ".toml":
        if len(files) == 1:
            raise RecordingError(f"{files[0]}: is a machine file; name a recording of the empty machine after it")
        return files[0], list(files[1:])
    header = log_header(files[0])
    if header is None:
        raise RecordingError(
            f"{files[0]}: does not say which machine it is of; name the machine file (.toml) before it"
        )
    machine = Path(header.machine)
    if not machine.exists():
        raise RecordingError(
            f"{files[0]}: names the machine file {machine}, which is not there: name the machine file (.toml) before it"
        )
    return machine, list(files)


def check_machine(path: Path, header: Header | None, loaded: Loaded) -> None:
    """Warn of a log that was recorded with another state of the machine file.

    Raises RecordingError for a log of a machine file with another name.
    """
    if header is None or header.machine_sha256 == loaded.sha256:
        return
    then, now = Path(header.machine), loaded.path
    if then.name != now.name:
        raise RecordingError(f"{path}: was recorded with machine file {then}, not with {now}: name that one")
    warn(f"{path}: was recorded with another state of {now.name} than this one")


def model_of(loaded: Loaded) -> Model:
    """Return the estimator's model of a machine file, with all friction laws that the file allows."""
    service = loaded.service
    return Model(service.machine, service.filters, service.effects)


def recorded_segments(loaded: Loaded, path: Path, watch: Watch = silent, tell: Report = warn) -> Iterator[Array]:
    """Yield the gapless stretches of a recording, samples (T, S) in SI units, as they are read.

    tell: receives sentences on excluded stretches, and why a log has no usable samples
    """
    service = loaded.service
    recording = open_recording(path, service, loaded.columns, report=tell)
    longest = int(service.health.hold_s * service.filters.rate_hz)
    if isinstance(recording, Table):
        yield from gapless(ordered(recording, loaded, path), longest)
        return
    events = watched(path, (e for e in recording.events if isinstance(e, Frame | Tick)), watch)
    rows, unusable = 0, Counter[Reason]()
    for piece in samples(assembler(service), events, round(1e6 / service.filters.rate_hz), unusable):
        rows += len(piece)
        yield from gapless(piece, longest)
    if unusable[Reason.TWO_PRODUCERS] or unusable.total() == rows > 0:
        tell(f"{path}: {unusable_samples(unusable, rows, service.filters.rate_hz)}")


def named_segments(
    loaded: Loaded, recordings: Sequence[Path], watch: Watch = silent, tell: Report = warn
) -> Iterator[tuple[str, Array]]:
    """Yield the gapless stretches of all recordings, each with the recording's name."""
    return ((path.name, segment) for path in recordings for segment in recorded_segments(loaded, path, watch, tell))


def ordered(table: Table, loaded: Loaded, path: Path) -> Array:
    """Return the table's columns in the order of the machine's signals."""
    place = {name: k for k, name in enumerate(table.signals)}
    missing = [s.name for s in loaded.service.machine.signals if s.name not in place]
    if missing:
        raise RecordingError(f"{path}: has no column for {', '.join(missing)}")
    return table.values[:, [place[s.name] for s in loaded.service.machine.signals]]


def make_core(loaded: Loaded, identified: Path | None, tell: Report = warn) -> Core:
    """Return the core of a machine file with its identified tares, or with the data sheet's.

    tell: receives the identified file's warnings, and why the compiled kernel was not used
    """
    service = loaded.service
    if choice().refused:
        tell(choice().refused)
    if identified is None:
        attached = {name: model_of(_fitted(loaded, name)).data_sheet for name in service.tools[1:]}
        return Core(service, model_of(loaded).data_sheet, attached)
    tares, known = read_identified(identified, loaded), read_attachments(identified, loaded)
    for sentence in identified_warnings(identified):
        tell(f"{identified}: {sentence}")
    sheets = {name: with_tool(tares, *tool_models(loaded, name, tares)) for name in service.tools[1:]}
    return Core(service, tares, sheets | known)


def _fitted(loaded: Loaded, tool: str) -> Loaded:
    return loaded._replace(service=loaded.service.fitted(tool))


def tool_models(loaded: Loaded, tool: str, tares: Tares) -> tuple[Model, Model]:
    """Return the models with the standard tool and with another one, both with the friction laws of the tares.

    Raises ValueError for a tool that is not in the machine file.
    """
    service, other = loaded.service, loaded.service.fitted(tool)
    return (
        Model(service.machine, service.filters, tares.friction),
        Model(other.machine, service.filters, tares.friction),
    )


def check_known_kg(known_kg: float, loaded: Loaded) -> None:
    """Check that a known weight is well above the errors and can be lifted. Raises RecordingError."""
    least, most = (share * loaded.service.machine.rated_payload for share in KNOWN)
    if not least <= known_kg <= most:
        raise RecordingError(
            f"--known-kg {known_kg:g}: gives no scale: lift {least:g} to {most:g} kg, {100 * KNOWN[0]:g} to "
            f"{100 * KNOWN[1]:g} % of the rated payload"
        )


def calibrated(loaded: Loaded, found: "Identification", lift: Path, known_kg: float) -> "Identification":
    """Return the identification with the scale from a lift of a known weight.

    Raises RecordingError when the lift does not contain the weight.
    """
    from cylforce.commissioning.known_load import with_known_load

    try:
        return with_known_load(found, recorded_segments(loaded, lift), known_kg, hanging)
    except ValueError as error:
        raise RecordingError(f"{lift}: {error}") from error


def header_of(loaded: Loaded, identified: Path | None, bus: str, kept: Memory = NOTHING_KEPT) -> Header:
    """Return the header of a log of this service, with the values kept from an earlier start."""
    known = {} if replace(kept, scale=NOTHING_KEPT.scale) == NOTHING_KEPT else {"kept": packed(kept)}
    return Header(
        versions=running_versions(),
        machine=str(loaded.path.resolve()),
        machine_sha256=loaded.sha256,
        identified_sha256=file_sha256(identified) if identified else None,
        state={**asdict(kept.scale), **known},
        bus=bus,
        node_id=loaded.service.node_id,
    )


def continued(header: Header, memory: Memory, state: State) -> Header:
    """Return the header of a log that continues another one, at a state of the service."""
    known = {**asdict(memory.scale), "kept": packed(memory), "service": packed(state)}
    return header.model_copy(update={"state": known})


def beginning(core: Core, recorded: Header, now: Header, path: Path, tell: Report) -> WeighingService:
    """Return the service in its state at the beginning of a log.

    A state of other tares or another version does not fit: then only zero and tare are used, the estimators restart,
    and `tell` reports it.
    """
    said = recorded.state
    known = Memory(Scale(**{field.name: float(str(said.get(field.name, 0.0))) for field in fields(Scale)}))
    if "kept" in said:
        with _readable(path):
            known = unpacked(Memory, said["kept"])
    service = WeighingService.start(core, known)
    if "service" not in said:
        return service
    same = (recorded.machine_sha256, recorded.identified_sha256) == (now.machine_sha256, now.identified_sha256)
    if same and recorded.versions.get("cylforce") == now.versions["cylforce"]:
        with _readable(path):
            service.restore(unpacked_state(service.types(), said["service"]))
        return service
    tell(f"{path}: continues an earlier log of other tares or another version: its estimators start anew here")
    return service


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Raise RecordingError with a sentence where the state in a log's header cannot be read."""
    try:
        yield
    except (ValueError, TypeError) as error:
        raise RecordingError(
            f"{path}: the state in the log's header is broken, or of another version, so its start is lost: record anew"
        ) from error
