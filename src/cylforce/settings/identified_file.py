"""What identified.toml holds: tables and keys."""

from typing import Annotated

from pydantic import AllowInfNan, BaseModel, ConfigDict, JsonValue

from cylforce.estimation.model import EXPECTED
from cylforce.settings.seal import Seal

Number = Annotated[float, AllowInfNan(False)]


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
    """The whole file; `warnings`: sentences why these parameters should not be trusted, which every use repeats;
    `common_scale_error`: what the data sheet's masses allow of a common scale of all pressures, relative; 0 after a
    lift of a known weight, None in files that were written before there was such a key."""

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
        """What is sealed: everything but the seal, and keys that the file does not have."""
        absent = {"common_scale_error"} if self.common_scale_error is None else set[str]()
        found: dict[str, JsonValue] = self.model_dump(mode="json", exclude={"seal", *absent})
        return found
