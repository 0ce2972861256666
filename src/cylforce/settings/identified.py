"""identified.toml: the tares (identified parameters) of one machine and where they come from. Written by `cylforce
identify`, accepted only with the machine file that it was identified with."""

import tomllib
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tomlkit
from pydantic import AllowInfNan, BaseModel, ConfigDict, JsonValue, ValidationError

import cylforce
from cylforce.estimation.model import EXPECTED, FRICTION, BetweenStrokes, Model, Tares
from cylforce.files.atomic import LARGEST, is_large, is_stream, replacing
from cylforce.settings.machine_file import Loaded, SettingsError
from cylforce.settings.seal import Seal, broken, sealed
from cylforce.signals.estimate import Array

if TYPE_CHECKING:  # the service reads what identification wrote, without identification
    from cylforce.commissioning.identification import Identification

Number = Annotated[float, AllowInfNan(False)]
FORMAT = 2
SOUND_SCALE = (0.8, 1.25)  # measured over true force: bores and pins as the data sheet says change it by less


class _Strict(BaseModel):
    """A table of the file; unknown keys are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Provenance(_Strict):
    """Where the parameters come from."""

    format: int
    machine: str
    machine_sha256: str
    recordings: tuple[str, ...]
    recording_sha256: tuple[str, ...]
    date: str
    cylforce: str


class IdentifiedParameter(_Strict):
    """One parameter. Not `from_recording`: the recording does not determine it, so the data sheet's value was kept."""

    name: str
    unit: str
    value: Number
    standard_error: Number
    from_recording: bool


class IdentifiedAttachment(_Strict):
    """The parameters with another tool: `values` and `covariance` in the order of the file's `parameters`."""

    name: str
    recordings: tuple[str, ...]
    recording_sha256: tuple[str, ...]
    date: str
    unexplained_torque_n_m: tuple[Number, ...]
    values: tuple[Number, ...]
    covariance: tuple[tuple[Number, ...], ...]


class IdentifiedFile(_Strict):
    """The whole file; `warnings`: sentences why these parameters should not be trusted, which every use repeats."""

    provenance: Provenance
    warnings: tuple[str, ...] = ()
    friction: tuple[str, ...]
    scale: Number
    scale_standard_error: Number
    unexplained_torque_n_m: tuple[Number, ...]
    unexplained_correlation_s: Number = 0.0
    friction_between_strokes: Number = EXPECTED.friction
    zero_between_strokes_pa: Number = EXPECTED.zero
    parameters: tuple[IdentifiedParameter, ...]
    covariance: tuple[tuple[Number, ...], ...]
    attachments: tuple[IdentifiedAttachment, ...] = ()
    seal: Seal | None = None

    @property
    def content(self) -> dict[str, JsonValue]:
        """What is sealed: everything but the seal."""
        found: dict[str, JsonValue] = self.model_dump(mode="json", exclude={"seal"})
        return found


def write_identified(
    path: Path, found: "Identification", loaded: Loaded, recordings: Sequence[tuple[str, str]]
) -> None:
    """Write the file whole or not at all; `recordings` are (name, SHA-256)."""
    table = IdentifiedFile(
        provenance=Provenance(
            format=FORMAT,
            machine=loaded.service.machine.name,
            machine_sha256=loaded.sha256,
            recordings=tuple(name for name, _ in recordings),
            recording_sha256=tuple(sha256 for _, sha256 in recordings),
            date=_now(),
            cylforce=cylforce.__version__,
        ),
        unexplained_torque_n_m=tuple(found.tares.row_error.tolist()),
        unexplained_correlation_s=found.tares.correlation,
        friction_between_strokes=found.tares.between_strokes.friction,
        zero_between_strokes_pa=found.tares.between_strokes.zero,
        warnings=found.warnings,
        friction=found.model.friction,
        scale=found.tares.scale,
        scale_standard_error=found.tares.scale_error,
        parameters=_parameters(found),
        covariance=tuple(tuple(row) for row in found.tares.covariance.tolist()),
    )
    _write(path, table, "identified")


def write_attachment(
    path: Path, name: str, tares: Tares, loaded: Loaded, recordings: Sequence[tuple[str, str]]
) -> None:
    """Add the tares with attachment `name` to a file, or replace them; `recordings` are (name, SHA-256). Raises
    SettingsError as `read_identified`."""
    read_identified(path, loaded)
    made = IdentifiedAttachment(
        name=name,
        recordings=tuple(name for name, _ in recordings),
        recording_sha256=tuple(sha256 for _, sha256 in recordings),
        date=_now(),
        unexplained_torque_n_m=tuple(tares.row_error.tolist()),
        values=tuple(tares.values.tolist()),
        covariance=tuple(tuple(row) for row in tares.covariance.tolist()),
    )
    file = _read(path)
    others = tuple(other for other in file.attachments if other.name != name)
    _write(path, file.model_copy(update={"attachments": (*others, made)}), f"attachment {name} identified")


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def seal_again(path: Path, loaded: Loaded, reason: str) -> tuple[tuple[str, ...], Seal]:
    """Seal a file as it is now: what was changed, and the new seal. Raises SettingsError for a file that could not be
    used anyway."""
    file = _read(path).model_copy(update={"provenance": _read(path).provenance.model_copy(update={"format": FORMAT})})
    _check_origin(path, file, loaded)
    _check_numbers(path, file, Model(loaded.service.machine, loaded.service.filters, file.friction))
    changed = ("seal",) if file.seal is None else broken(file.content, file.seal)
    return changed, _write(path, file, reason)


def _write(path: Path, table: IdentifiedFile, reason: str) -> Seal:
    made = sealed(table.content, table.seal, _now(), reason)
    table = table.model_copy(update={"seal": made})
    with replacing(path) as temporary:
        temporary.write_text(_COMMENT + tomlkit.dumps(table.model_dump(mode="json")), encoding="utf-8")
    return made


_COMMENT = """\
# Generated by `cylforce identify`: the dynamic tares of one machine. Do not edit: the seal at the end would be broken,
# and nobody would read the file. Identify again instead.
"""


def _parameters(found: "Identification") -> tuple[IdentifiedParameter, ...]:
    error = np.sqrt(np.diag(found.tares.covariance))
    return tuple(
        IdentifiedParameter(
            name=p.name,
            unit=p.unit,
            value=float(value),
            standard_error=float(spread),
            from_recording=p.name not in found.not_identified,
        )
        for p, value, spread in zip(found.model.parameters, found.tares.values, error, strict=True)
    )


def read_identified(path: Path, loaded: Loaded) -> Tares:
    """The tares. Raises SettingsError when the file is broken or belongs to another machine or version."""
    file = _read(path)
    _check_origin(path, file, loaded)
    _check_numbers(path, file, Model(loaded.service.machine, loaded.service.filters, file.friction))
    _check_seal(path, file, loaded)
    names, values = tuple(p.name for p in file.parameters), np.array([p.value for p in file.parameters])
    left = np.array(file.unexplained_torque_n_m)
    differ = BetweenStrokes(file.friction_between_strokes, file.zero_between_strokes_pa)
    rest = (file.scale, file.scale_standard_error, file.unexplained_correlation_s, differ)
    return Tares(file.friction, names, values, np.array(file.covariance), left, True, *rest)


def read_attachments(path: Path, loaded: Loaded) -> dict[str, Tares]:
    """The tares with each attachment that was identified, by its name. Raises SettingsError."""
    common, file, found = read_identified(path, loaded), _read(path), dict[str, Tares]()
    for said in file.attachments:
        if said.name not in loaded.service.tools:
            raise SettingsError(f"{path}: attachments: {said.name} is none of {loaded.path}; identify it again")
        known = file.model_copy(
            update={"covariance": said.covariance, "unexplained_torque_n_m": said.unexplained_torque_n_m}
        )
        _check_numbers(path, known, Model(loaded.service.machine, loaded.service.filters, file.friction))
        if len(said.values) != len(common.values):
            raise SettingsError(
                f"{path}: attachments: {said.name} has not {len(common.values)} values; identify it again"
            )
        found[said.name] = common._replace(
            values=np.array(said.values),
            covariance=np.array(said.covariance),
            row_error=np.array(said.unexplained_torque_n_m),
        )
    return found


def identified_warnings(path: Path) -> tuple[str, ...]:
    """The sentences that `cylforce identify` wrote into the file beside the parameters. Raises SettingsError."""
    return _read(path).warnings


def _read(path: Path) -> IdentifiedFile:
    if is_stream(path):
        raise SettingsError(f"{path}: is no ordinary file but a pipe or a device; run `cylforce identify` first")
    if is_large(path):
        raise SettingsError(f"{path}: is larger than {LARGEST // 10**6} MB; run `cylforce identify` first")
    try:
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
        _check_kind(path, raw)
        return IdentifiedFile.model_validate(raw)
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror}); run `cylforce identify` first") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path}: is not TOML ({error}); run `cylforce identify` again") from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise SettingsError(f"{path}: {key}: {first['msg']}; run `cylforce identify` again") from error


def _check_kind(path: Path, raw: Mapping[str, object]) -> None:
    """Whether it is a file of `cylforce identify` at all. Raises SettingsError."""
    if not raw:
        raise SettingsError(f"{path}: is empty; run `cylforce identify` again")
    if "provenance" not in raw:
        kind = "is a machine file" if "machine" in raw else "is TOML"
        raise SettingsError(f"{path}: {kind}, not the file that `cylforce identify` writes; run it first")


def _check_origin(path: Path, file: IdentifiedFile, loaded: Loaded) -> None:
    said = file.provenance
    if said.format != FORMAT:
        raise SettingsError(
            f"{path}: is of format {said.format}, this version reads {FORMAT}; identify again, or `cylforce seal`"
        )
    if said.machine_sha256 != loaded.sha256:
        raise SettingsError(
            f"{path}: was identified with another machine file ({said.machine!r}, sha256 {said.machine_sha256[:12]}…) "
            f"than {loaded.path} ({loaded.sha256[:12]}…); identify again with this one"
        )
    if not {FRICTION[0]} <= set(file.friction) <= set(FRICTION):
        raise SettingsError(
            f"{path}: friction: needs {FRICTION[0]} and knows no other laws than {', '.join(FRICTION)}; identify again"
        )


def _check_seal(path: Path, file: IdentifiedFile, loaded: Loaded) -> None:
    changed = ("seal",) if file.seal is None else broken(file.content, file.seal)
    if changed:
        raise SettingsError(
            f"{path}: {', '.join(changed)}: not as sealed by `cylforce identify`: it was edited or damaged; identify "
            f"again, or accept it on purpose: cylforce seal {loaded.path} {path} --reason WHY"
        )


def identified_seal(path: Path) -> Seal | None:
    """The seal of a file. Raises SettingsError."""
    return _read(path).seal


def _check_numbers(path: Path, file: IdentifiedFile, model: Model) -> None:
    size, rows = len(model.parameters), len(model.machine.rows)
    if tuple(p.name for p in file.parameters) != tuple(p.name for p in model.parameters):
        raise SettingsError(f"{path}: parameters: are not those of {model.machine.name}; identify again")
    if len(file.unexplained_torque_n_m) != rows or min(file.unexplained_torque_n_m) <= 0.0:
        raise SettingsError(f"{path}: unexplained_torque_n_m: must be {rows} positive numbers; identify again")
    if not SOUND_SCALE[0] <= file.scale <= SOUND_SCALE[1] or not 0.0 <= file.scale_standard_error < 0.1:
        raise SettingsError(
            f"{path}: scale: {file.scale:g} is outside {SOUND_SCALE[0]:g} to {SOUND_SCALE[1]:g}; identify again"
        )
    if len(file.covariance) != size or any(len(row) != size for row in file.covariance):
        raise SettingsError(f"{path}: covariance: is not {size} x {size}; identify again")
    if not _is_covariance(np.array(file.covariance)):
        raise SettingsError(f"{path}: covariance: is not symmetric and positive; identify again")


def _is_covariance(matrix: Array) -> bool:
    variance = np.diag(matrix)
    if not np.all(variance > 0.0):
        return False
    correlation = matrix / np.sqrt(np.outer(variance, variance))
    return bool(np.allclose(correlation, correlation.T, atol=1e-6) and np.linalg.eigvalsh(correlation)[0] > -1e-6)
