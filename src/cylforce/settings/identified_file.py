"""Tables and keys of identified.toml."""

from typing import Annotated

from pydantic import AllowInfNan, BaseModel, ConfigDict, JsonValue

from cylforce.estimation.model import EXPECTED
from cylforce.settings.seal import Seal

Number = Annotated[float, AllowInfNan(False)]


class _Strict(BaseModel):
    """A table of the file; unknown keys are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Provenance(_Strict):
    """Origin of the parameters.

    format: version of the file's format
    machine: name of the machine
    machine_sha256: hash of its machine file
    recordings: names of the recordings
    recording_sha256: hashes of the recordings
    date: time of the identification
    cylforce: version of the program
    """

    format: int
    machine: str
    machine_sha256: str
    recordings: tuple[str, ...]
    recording_sha256: tuple[str, ...]
    date: str
    cylforce: str


class IdentifiedParameter(_Strict):
    """One parameter.

    name: as in the model
    unit: as in the model
    value: in that unit
    standard_error: in that unit
    from_recording: whether the recording determines it clearly better than the data sheet; otherwise the value is
        mainly the data sheet's
    """

    name: str
    unit: str
    value: Number
    standard_error: Number
    from_recording: bool


class IdentifiedAttachment(_Strict):
    """The parameters with another tool.

    name: name of the attachment
    recordings: names of the recordings
    recording_sha256: hashes of the recordings
    date: time of the identification
    unexplained_torque_n_m: (R,) rms residual of each measured joint [N m]
    values: (P,) in the order of the file's `parameters`
    covariance: (P, P)
    """

    name: str
    recordings: tuple[str, ...]
    recording_sha256: tuple[str, ...]
    date: str
    unexplained_torque_n_m: tuple[Number, ...]
    values: tuple[Number, ...]
    covariance: tuple[tuple[Number, ...], ...]


class IdentifiedFile(_Strict):
    """Content of the file.

    provenance: origin of the parameters
    warnings: sentences why these parameters should not be trusted, which every use repeats
    friction: names of the friction laws
    scale: factor on the residual torque from a lift of a known weight; 1 without one
    scale_standard_error: its standard error
    unexplained_torque_n_m: (R,) rms residual of each measured joint [N m]
    unexplained_correlation_s: time for which the residual keeps its sign [s]
    friction_between_strokes: spread of friction between strokes, as a share of the identified friction
    zero_between_strokes_pa: spread of a pressure's zero between strokes [Pa]
    common_scale_error: relative error of a common scale of all pressures that the data sheet's masses allow; 0 after a
        lift of a known weight; None in files that were written before this key existed
    parameters: (P,) parameters
    covariance: (P, P) their covariance
    attachments: parameters with other tools
    seal: hash of every key; None: never sealed
    """

    provenance: Provenance
    warnings: tuple[str, ...] = ()
    friction: tuple[str, ...]
    scale: Number
    scale_standard_error: Number
    unexplained_torque_n_m: tuple[Number, ...]
    unexplained_correlation_s: Number = 0.0
    friction_between_strokes: Number = EXPECTED.friction
    zero_between_strokes_pa: Number = EXPECTED.zero
    common_scale_error: Number | None = None
    parameters: tuple[IdentifiedParameter, ...]
    covariance: tuple[tuple[Number, ...], ...]
    attachments: tuple[IdentifiedAttachment, ...] = ()
    seal: Seal | None = None

    @property
    def content(self) -> dict[str, JsonValue]:
        """Return the sealed content: all keys of the file but the seal.

        `common_scale_error` is not in it where it is None, because seals from before it existed do not contain it.
        """
        absent = {"common_scale_error"} if self.common_scale_error is None else set[str]()
        content: dict[str, JsonValue] = self.model_dump(mode="json", exclude={"seal", *absent})
        return content
