"""identified.toml: the tares (identified parameters) of one machine and their origin.

`cylforce identify` writes it. It is accepted only with the machine file that it was identified with.
"""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import tomlkit

import cylforce
from cylforce.estimation.model import FRICTION, BetweenStrokes, Model, Tares
from cylforce.files.atomic import replacing
from cylforce.files.software import controller_id
from cylforce.settings.identified_file import IdentifiedAttachment, IdentifiedFile, IdentifiedParameter, Provenance
from cylforce.settings.machine_file import Loaded, SettingsError
from cylforce.settings.seal import Seal, broken, sealed
from cylforce.settings.written import read_written
from cylforce.signals.estimate import Array

if TYPE_CHECKING:  # the service reads what identification wrote, without identification
    from cylforce.commissioning.identification import Identification

FORMAT = 2  # version of the file's format
UNSCALED = 1.0  # scale without a lift of a known weight
SOUND_SCALE = (0.8, 1.25)  # limits of true over measured force: errors of bores and pins change it by less


def write_identified(
    path: Path, identification: "Identification", loaded: Loaded, recordings: Sequence[tuple[str, str]]
) -> None:
    """Write and seal the file, whole or not at all.

    A file that exists is replaced: its tares with attachments and its earlier seals are lost.

    identification: the identification
    loaded: the machine file
    recordings: (name, SHA-256) of each
    """
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
        unexplained_torque_n_m=tuple(identification.tares.row_error.tolist()),
        unexplained_correlation_s=identification.tares.correlation,
        friction_between_strokes=identification.tares.between_strokes.friction,
        zero_between_strokes_pa=identification.tares.between_strokes.zero,
        warnings=identification.warnings,
        friction=identification.model.friction,
        scale=identification.tares.scale,
        scale_standard_error=identification.tares.scale_error,
        common_scale_error=identification.tares.common_error,
        parameters=_parameters(identification),
        covariance=tuple(tuple(row) for row in identification.tares.covariance.tolist()),
    )
    _write(path, table, "identified")


def write_attachment(
    path: Path, name: str, tares: Tares, loaded: Loaded, recordings: Sequence[tuple[str, str]]
) -> None:
    """Add the tares with an attachment to a file, or replace them, and seal it anew.

    Raises SettingsError as `read_identified`.

    name: name of the attachment
    recordings: (name, SHA-256) of each
    """
    read_identified(path, loaded)
    added = IdentifiedAttachment(
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
    _write(path, file.model_copy(update={"attachments": (*others, added)}), f"attachment {name} identified")


def _now() -> str:
    """Return the present time (UTC) for the file."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def seal_again(path: Path, loaded: Loaded, reason: str) -> tuple[tuple[str, ...], Seal]:
    """Seal a file as it is now, in the present format; return the keys that were changed, and the new seal.

    The keys are those that differ from the seal before; "seal" when there was none, or it was changed itself. Raises
    SettingsError for a file that could not be used anyway: with impossible numbers, or for another machine file.

    reason: reason for the seal, which stays in the file
    """
    file = _read(path).model_copy(update={"provenance": _read(path).provenance.model_copy(update={"format": FORMAT})})
    _check_origin(path, file, loaded)
    _check_numbers(path, file, Model(loaded.service.machine, loaded.service.filters, file.friction))
    changed = ("seal",) if file.seal is None else broken(file.content, file.seal)
    return changed, _write(path, file, reason)


def _write(path: Path, table: IdentifiedFile, reason: str) -> Seal:
    """Seal and write the file, whole or not at all; return the seal, which counts on from the one in `table`.

    reason: reason for the seal
    """
    seal = sealed(table.content, table.seal, _now(), reason, controller=controller_id())
    table = table.model_copy(update={"seal": seal})
    with replacing(path) as temporary:
        temporary.write_text(
            _COMMENT + tomlkit.dumps(table.model_dump(mode="json", exclude_none=True)), encoding="utf-8"
        )
    return seal


_COMMENT = """\
# Generated by `cylforce identify`: the dynamic tares of one machine. Do not edit: the seal at the end would be broken,
# and nobody would read the file. Identify again instead.
"""


def _parameters(identification: "Identification") -> tuple[IdentifiedParameter, ...]:
    """Return the identified parameters as the file has them."""
    error = np.sqrt(np.diag(identification.tares.covariance))
    return tuple(
        IdentifiedParameter(
            name=p.name,
            unit=p.unit,
            value=float(value),
            standard_error=float(spread),
            from_recording=p.name not in identification.not_identified,
        )
        for p, value, spread in zip(identification.model.parameters, identification.tares.values, error, strict=True)
    )


def read_identified(path: Path, loaded: Loaded) -> Tares:
    """Return the tares with the standard tool.

    Raises SettingsError when the file cannot be read, was written for another machine file or in another format, has
    impossible numbers, or is not as it was sealed.
    """
    file = _read(path)
    _check_origin(path, file, loaded)
    _check_numbers(path, file, Model(loaded.service.machine, loaded.service.filters, file.friction))
    _check_seal(path, file, loaded)
    return Tares(
        friction=file.friction,
        names=tuple(p.name for p in file.parameters),
        values=np.array([p.value for p in file.parameters]),
        covariance=np.array(file.covariance),
        row_error=np.array(file.unexplained_torque_n_m),
        identified=True,
        scale=file.scale,
        scale_error=file.scale_standard_error,
        correlation=file.unexplained_correlation_s,
        between_strokes=BetweenStrokes(friction=file.friction_between_strokes, zero=file.zero_between_strokes_pa),
        common_error=file.common_scale_error or 0.0,
    )


def read_attachments(path: Path, loaded: Loaded) -> dict[str, Tares]:
    """Return the tares with each attachment that was identified, by its name.

    Parameters, covariance and row errors are the attachment's; all else is common with the standard tool. Raises
    SettingsError as `read_identified`, for an attachment that the machine file lacks, and for impossible numbers.
    """
    common, file, tares = read_identified(path, loaded), _read(path), dict[str, Tares]()
    for added in file.attachments:
        if added.name not in loaded.service.tools:
            raise SettingsError(f"{path}: attachments: {added.name} is none of {loaded.path}; identify it again")
        known = file.model_copy(
            update={"covariance": added.covariance, "unexplained_torque_n_m": added.unexplained_torque_n_m}
        )
        _check_numbers(path, known, Model(loaded.service.machine, loaded.service.filters, file.friction))
        if len(added.values) != len(common.values):
            raise SettingsError(
                f"{path}: attachments: {added.name} has not {len(common.values)} values; identify it again"
            )
        tares[added.name] = common._replace(
            values=np.array(added.values),
            covariance=np.array(added.covariance),
            row_error=np.array(added.unexplained_torque_n_m),
        )
    return tares


def identified_warnings(path: Path) -> tuple[str, ...]:
    """Return the warnings that `cylforce identify` wrote into the file. Raises SettingsError.

    A file that was written before the scale was estimated gets a warning about that.
    """
    file = _read(path)
    if file.common_scale_error is not None or file.scale != UNSCALED:
        return file.warnings
    unknown = (
        "the scale of the pressures is not known: no known weight was lifted, and the reported errors do not contain "
        "what the data sheet's masses allow; identify again"
    )
    return (*file.warnings, unknown)


def _read(path: Path) -> IdentifiedFile:
    """Read the file without comparing it with a machine file. Raises SettingsError."""
    return read_written(path, IdentifiedFile, "cylforce identify", _check_kind)


def _check_kind(path: Path, raw: Mapping[str, object]) -> None:
    """Raise SettingsError for an empty file, or one without [provenance], which `cylforce identify` did not write.

    raw: content of the file as parsed from TOML
    """
    if not raw:
        raise SettingsError(f"{path}: is empty; run `cylforce identify` again")
    if "provenance" not in raw:
        kind = "is a machine file" if "machine" in raw else "is TOML"
        raise SettingsError(f"{path}: {kind}, not the file that `cylforce identify` writes; run it first")


def _check_origin(path: Path, file: IdentifiedFile, loaded: Loaded) -> None:
    """Raise SettingsError for a file of another format or machine file, or with unknown laws or no Coulomb friction."""
    origin = file.provenance
    if origin.format != FORMAT:
        raise SettingsError(
            f"{path}: is of format {origin.format}, this version reads {FORMAT}; identify again, or `cylforce seal`"
        )
    if origin.machine_sha256 != loaded.sha256:
        raise SettingsError(
            f"{path}: was identified with another machine file ({origin.machine!r}, sha256 "
            f"{origin.machine_sha256[:12]}…) than {loaded.path} ({loaded.sha256[:12]}…); identify again with this one"
        )
    if not {FRICTION[0]} <= set(file.friction) <= set(FRICTION):
        raise SettingsError(
            f"{path}: friction: needs {FRICTION[0]} and knows no other laws than {', '.join(FRICTION)}; identify again"
        )


def _check_seal(path: Path, file: IdentifiedFile, loaded: Loaded) -> None:
    """Raise SettingsError for a file that is not as it was sealed."""
    changed = ("seal",) if file.seal is None else broken(file.content, file.seal)
    if changed:
        raise SettingsError(
            f"{path}: {', '.join(changed)}: not as sealed by `cylforce identify`: it was edited or damaged; identify "
            f"again, or accept it on purpose: cylforce seal {loaded.path} {path} --reason WHY"
        )


def identified_seal(path: Path) -> Seal | None:
    """Return the seal of a file. Raises SettingsError."""
    return _read(path).seal


def _check_numbers(path: Path, file: IdentifiedFile, model: Model) -> None:
    """Raise SettingsError for parameters that are not those of the model, or for impossible numbers.

    Impossible numbers: residuals that are not positive or of another number than the measured joints, a scale beyond
    SOUND_SCALE, a standard error of the scale of 0.1 or more, and a matrix that is no covariance of the parameters.
    """
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
    """Return whether a matrix (P, P) has positive variances, and is symmetric and positive semidefinite within
    rounding.
    """
    variance = np.diag(matrix)
    if not np.all(variance > 0.0):
        return False
    correlation = matrix / np.sqrt(np.outer(variance, variance))
    return bool(np.allclose(correlation, correlation.T, atol=1e-6) and np.linalg.eigvalsh(correlation)[0] > -1e-6)
