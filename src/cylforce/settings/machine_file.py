"""`load`: a machine file (TOML) becomes the checked, frozen settings of the service, or one clear
sentence."""

import hashlib
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError

from cylforce.estimation.model import FRICTION
from cylforce.files.tables import TableMap
from cylforce.mechanics.installation import Filters, Health, Service
from cylforce.settings import arm as settings_arm
from cylforce.settings import model as settings_model
from cylforce.settings.bus import nodes, own_pdos
from cylforce.settings.error import FaultError, SettingsError, fault, sentence
from cylforce.settings.machine import CHASSIS, machine
from cylforce.settings.model import FilterTable, HealthTable, MachineFile
from cylforce.settings.signals import check_enough, columns, signals
from cylforce.settings.units import SUFFIXES, WORDS
from cylforce.signals.units import DEGREE, MILLIMETRE

__all__ = ["Loaded", "SettingsError", "default_filters", "load"]

RESERVED = ("t_s", "t_us")  # the time in a recording


class Loaded(NamedTuple):
    """A machine file: the settings, where its recordings' tables have time and signals (None: in `t_s` and
    under the sensors' names, SI), the file itself and its SHA-256 as hexadecimal digits."""

    service: Service
    columns: TableMap | None
    path: Path
    text: str
    sha256: str


def load(path: Path | str) -> Loaded:
    """Read a machine file. Raises SettingsError, one sentence that names file, line, key and cure."""
    where = Path(path)
    text = _text(where)
    raw = _parsed(where, text)
    try:
        file = _validated(raw)
        service = _service(file, where.parent)
        return Loaded(service, columns(file), where, text, hashlib.sha256(text.encode()).hexdigest())
    except FaultError as found:
        raise SettingsError(sentence(where, text, raw, found.key, str(found))) from None


def default_filters() -> Filters:
    """Rates and cut-offs of a machine file that says nothing about them."""
    return _filters(FilterTable())


def _text(path: Path) -> str:
    try:
        return path.read_bytes().decode("utf-8")
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror}): give the path of a machine file") from error
    except UnicodeDecodeError as error:
        raise SettingsError(f"{path}: is not UTF-8 text at byte {error.start}: save it as UTF-8") from error


def _parsed(path: Path, text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # of TOML, of an endless number, of endless brackets
        raise SettingsError(f"{path}: is not TOML: {error}; correct that line") from error


def _validated(raw: dict[str, Any]) -> MachineFile:
    try:
        return MachineFile.model_validate(raw)
    except ValidationError as error:
        raise fault(error.errors()[0], _known_keys()) from None


def _known_keys() -> Sequence[str]:
    """All keys that a machine file may have, to guess what a misspelt one meant."""
    models = [m for module in (settings_arm, settings_model) for m in vars(module).values() if isinstance(m, type)]
    plain = {key for m in models if issubclass(m, BaseModel) for key in m.model_fields} - set(WORDS)
    suffixes = {suffix for table in SUFFIXES.values() for suffix in table}
    return sorted(plain | {f"{word}_{suffix}" for word in WORDS for suffix in suffixes})


def _service(file: MachineFile, folder: Path) -> Service:
    _check_names(file)
    _check_filter(file.filter)
    for law in file.friction.effects:
        if law not in FRICTION:
            raise FaultError(("friction", "effects"), f"name {law!r}: choose among {', '.join(FRICTION)}")
    if FRICTION[0] not in file.friction.effects:
        problem = f"lack {FRICTION[0]!r}, without which a weight at rest has no honest error: add it"
        raise FaultError(("friction", "effects"), problem)
    sensor_nodes = nodes(file, folder)
    built = machine(file, signals(file))
    check_enough(file, built)
    return Service(
        machine=built,
        nodes=sensor_nodes,
        publication=own_pdos(file),
        node_id=file.publication.node_id,
        sync_producer=file.publication.sync_producer,
        heartbeat_s=file.publication.heartbeat_ms * MILLIMETRE,
        filters=_filters(file.filter),
        health=_health(file.health),
        effects=tuple(sorted(set(file.friction.effects), key=FRICTION.index)),
        adapt=file.friction.adapt,
    )


def _check_names(file: MachineFile) -> None:
    for table in ("links", "cylinders", "nodes", "sensors"):
        seen: set[str] = {CHASSIS} if table == "links" else set(RESERVED) if table == "sensors" else set()
        for k, entry in enumerate(getattr(file, table)):
            if entry.name in seen:
                raise FaultError((table, k, "name"), f"is {entry.name!r}, which is taken: choose another")
            seen.add(entry.name)


def _check_filter(table: FilterTable) -> None:
    for key in ("channel_hz", "regressor_hz", "smoothing_hz"):
        if getattr(table, key) >= table.rate_hz / 2.0:
            problem = f"is not below half of rate_hz ({table.rate_hz / 2.0:g} Hz, Nyquist): lower it"
            raise FaultError(("filter", key), problem)


def _filters(table: FilterTable) -> Filters:
    return Filters(
        rate_hz=table.rate_hz,
        channel_hz=table.channel_hz,
        regressor_hz=table.regressor_hz,
        smoothing_hz=table.smoothing_hz,
        direction_speed=table.direction_speed_m_s,
    )


def _health(table: HealthTable) -> Health:
    return Health(
        hold_s=table.hold_ms * MILLIMETRE,
        good_frames=table.good_frames,
        frozen_samples=table.frozen_samples,
        max_tilt=table.max_tilt_deg * DEGREE,
        max_step_s=table.max_step_ms * MILLIMETRE,
    )
