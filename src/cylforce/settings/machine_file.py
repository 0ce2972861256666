"""Load a machine file (TOML): it becomes the checked, frozen settings of the service, or a list of all its errors."""

import hashlib
import re
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

from cylforce.estimation.model import FRICTION
from cylforce.files.tables import TableMap
from cylforce.files.text_file import read_text
from cylforce.mechanics.installation import Attachment, Filters, Health, SensorNode, Service
from cylforce.mechanics.machine import Machine
from cylforce.settings.bus import nodes, own_pdos
from cylforce.settings.checks.names import name_faults
from cylforce.settings.checks.plausibility import inspect_attachment, inspect_machine
from cylforce.settings.error import FaultError, Inspection, SettingsError, Source, error_text, sentences
from cylforce.settings.limits import unusual
from cylforce.settings.machine import attachment, machine
from cylforce.settings.model import FilterTable, HealthTable, MachineFile
from cylforce.settings.sections import read_sections
from cylforce.settings.signals import columns, measurement_faults, signals
from cylforce.settings.units import file_in_si
from cylforce.signals.layout import Pdo
from cylforce.signals.units import DEGREE, MILLISECOND

__all__ = ["Loaded", "SettingsError", "default_filters", "load", "load_text"]

# Sections that must be right before the arm and the bus can be built.
ARM = frozenset({"machine", "links", "tool", "cylinders", "attachments"})
BUS = frozenset({"machine", "nodes", "sensors", "publication", "filter", "attachments"})


class Loaded(NamedTuple):
    """A loaded machine file.

    service: the settings
    columns: columns of its recordings' tables; None: `t_s` and the sensors' names, in SI units
    path: path of the file
    text: its text
    sha256: hash of the text, as hexadecimal digits
    warnings: unusual values, one sentence each
    """

    service: Service
    columns: TableMap | None
    path: Path
    text: str
    sha256: str
    warnings: tuple[str, ...] = ()


class Parts(NamedTuple):
    """Parts of the settings made from a file; None or empty where an error prevents it.

    machine: the machine with the standard tool
    attachments: the machine with each attachment
    nodes: sensor nodes
    publication: TPDOs that the service sends
    columns: where recordings' tables have time and signals
    """

    machine: Machine | None = None
    attachments: tuple[Attachment, ...] = ()
    nodes: tuple[SensorNode, ...] = ()
    publication: tuple[Pdo, ...] = ()
    columns: TableMap | None = None


def load(path: Path | str) -> Loaded:
    """Read a machine file.

    Raises SettingsError with every error of the file, each a sentence that names file, line, key, limit and cure.
    """
    where = Path(path)
    return load_text(_text(where), where)


def load_text(text: str, where: Path) -> Loaded:
    """Read the text of a machine file that is at `where`, or was read from there. Raises SettingsError as `load`."""
    findings, raw = Inspection(), _parsed(where, text)
    if "provenance" in raw and "machine" not in raw:
        raise SettingsError(f"{where}: is no machine file but one of `cylforce identify`: give it with --identified")
    source = Source(where, text, raw)
    file, parts = _checked(raw, where.parent, findings)
    if findings.errors or parts.machine is None:
        raise SettingsError(error_text(source, findings.errors))
    service = _service(file, parts.machine, parts)
    warnings = sentences(source, findings.warnings)
    return Loaded(service, parts.columns, where, text, hashlib.sha256(text.encode()).hexdigest(), warnings)


def default_filters() -> Filters:
    """Return rates and cut-offs of a machine file without a section about them."""
    return _filters(FilterTable())


def _text(path: Path) -> str:
    """Return the text of the file. Raises SettingsError."""
    text = read_text(path, "give the path of a machine file", SettingsError)
    if not text.strip():
        raise SettingsError(f"{path}: is empty: write [machine], [[links]] and the other tables of a machine file")
    return text


def _parsed(path: Path, text: str) -> dict[str, Any]:
    """Return the content of TOML. Raises SettingsError."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # of TOML, of an endless number, of endless brackets
        raise SettingsError(_syntax(path, text, str(error))) from error


def _syntax(path: Path, text: str, problem: str) -> str:
    """Return a sentence for an error of TOML, which has a line but names no key.

    text: text of the file
    problem: text of the error, with its line where the parser knows it
    """
    place = re.search(r" \(at line (\d+), column \d+\)", problem)
    if place is None:
        return f"{path}: is not TOML: {problem}; correct it"
    number = int(place[1])
    line = text.splitlines()[number - 1].strip() if number <= len(text.splitlines()) else ""
    problem = problem.replace(place[0], "")
    cure = "it is there twice: remove one" if "overwrite" in problem or "twice" in problem else "correct it"
    return f"{path}:{number}: {line[:60]!r} is not TOML: {problem}; {cure}"


def _checked(raw: dict[str, Any], folder: Path, findings: Inspection) -> tuple[MachineFile, Parts]:
    """Return the file's valid sections and the parts made from them; errors and warnings are added to `findings`.

    Each stage runs when the sections that it needs are right.

    raw: content of the file as parsed from TOML
    folder: folder of the machine file, with its EDS files
    """
    file, good = read_sections(file_in_si(raw, findings), raw, findings)
    findings.errors.extend(name_faults(raw))
    bad = {str(error.key[0]) for error in findings.errors if error.key}
    good -= bad
    findings.errors.extend(_filter_faults(file.filter) if "filter" in good else ())
    parts = Parts()
    if good >= BUS:
        published = own_pdos(file, _filters(file.filter), findings)
        parts = parts._replace(publication=published, nodes=nodes(file, folder, published, findings))
    if good >= ARM:
        built = _machine(file, good, findings)
        parts = parts._replace(machine=built, attachments=_attachments(file, built, findings) if built else ())
    if good >= {"sensors", "table"}:
        parts = parts._replace(columns=columns(file, findings))
    for name in sorted(good):
        findings.warnings.extend(_unusual(file, name))
    return file, parts


def _machine(file: MachineFile, good: frozenset[str], findings: Inspection) -> Machine | None:
    """Return the machine, with its signals where the bus is right; errors and warnings are added to `findings`.

    good: names of the sections without an error
    """
    measured = signals(file, findings) if good >= BUS else ()
    built = machine(file, measured, findings)
    if built is not None:
        if good >= BUS and len(measured) == len(file.sensors):
            findings.errors.extend(measurement_faults(file, built))
        inspected = inspect_machine(built)
        findings.errors.extend(inspected.errors)
        findings.warnings.extend(inspected.warnings)
    return built


def _attachments(file: MachineFile, standard: Machine, findings: Inspection) -> tuple[Attachment, ...]:
    """Return the machine with each attachment; errors and warnings of each are added to `findings`.

    standard: machine with the standard tool
    """
    attachments = []
    for k, table in enumerate(file.attachments):
        built = attachment(file, k, standard)
        inspected = inspect_attachment(built, standard, k)
        findings.errors.extend(inspected.errors)
        findings.warnings.extend(inspected.warnings)
        attachments.append(Attachment(name=table.name, kind=table.kind, machine=built))
    return tuple(attachments)


def _unusual(file: MachineFile, name: str) -> list[FaultError]:
    """Return a warning for each unusual value of a section.

    name: name of the section
    """
    section = getattr(file, name)
    if isinstance(section, tuple):
        return [warning for k, table in enumerate(section) for warning in unusual(table, (name, k))]
    return list(unusual(section, (name,))) if section is not None else []


CUT_OFFS, FAST = ("channel_hz", "regressor_hz", "smoothing_hz"), ("force_hz", "inertia_hz")


def _filter_faults(table: FilterTable) -> list[FaultError]:
    """Return a fault for each cut-off at or above half of the rate.

    Cut-offs of the force's filters (FAST) that the file does not give are lowered instead (`Filters.at`).
    """
    nyquist = table.rate_hz / 2.0
    keys = [key for key in CUT_OFFS if getattr(table, key) >= nyquist]
    keys += [key for key in FAST if key in table.model_fields_set and getattr(table, key) >= nyquist]
    problem = f"is not below half of rate_hz ({nyquist:g} Hz, Nyquist): lower it"
    return [FaultError(("filter", key), problem) for key in keys]


def _service(file: MachineFile, built: Machine, parts: Parts) -> Service:
    """Return all settings."""
    return Service(
        machine=built,
        nodes=parts.nodes,
        publication=parts.publication,
        node_id=file.publication.node_id,
        sync_producer=file.publication.sync_producer,
        heartbeat_s=file.publication.heartbeat_ms * MILLISECOND,
        filters=_filters(file.filter),
        health=_health(file.health),
        effects=tuple(sorted(set(file.friction.effects), key=FRICTION.index)),
        adapt=file.friction.adapt,
        attachments=parts.attachments,
        j1939_address=file.publication.j1939_address,
    )


def _filters(table: FilterTable) -> Filters:
    """Return rate and cut-offs; the force's cut-offs are lowered where they are too high for the rate."""
    return Filters(
        rate_hz=table.rate_hz,
        channel_hz=table.channel_hz,
        regressor_hz=table.regressor_hz,
        smoothing_hz=table.smoothing_hz,
        direction_speed=table.direction_speed_m_s,
        force_hz=table.force_hz,
        inertia_hz=table.inertia_hz,
    ).at(table.rate_hz)


def _health(table: HealthTable) -> Health:
    """Return the limits of signals in SI."""
    return Health(
        hold_s=table.hold_ms * MILLISECOND,
        good_frames=table.good_frames,
        frozen_samples=table.frozen_samples,
        max_tilt=table.max_tilt_deg * DEGREE,
        max_step_s=table.max_step_ms * MILLISECOND,
    )
