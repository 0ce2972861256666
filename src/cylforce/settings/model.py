"""The machine file as it is written (TOML): the tables of bus, sensors and estimator, and the whole file."""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from cylforce.settings.arm import (
    AttachmentTable,
    CylinderTable,
    LinkTable,
    MachineTable,
    Name,
    Range,
    SettingsTable,
    ToolTable,
)
from cylforce.settings.limits import Cutoff, Force, Milliseconds, Positive, SlowSpeed
from cylforce.signals.identifiers import FIRST_PDO, LAST_PDO
from cylforce.signals.kinds import Kind

TypeName = Literal["i8", "u8", "i16", "u16", "i32", "u32", "f32"]


def _address(value: Any) -> Any:  # noqa: ANN401 - what TOML gave, before it is checked
    """Return index and sub-index (0 without one) from a text such as "7130h:1". Raises ValueError.

    Anything but a text is returned unchanged, so that pydantic refuses it.
    """
    if not isinstance(value, str):
        return value
    index, colon, sub = value.lower().partition(":")
    try:
        address = (int(index.removesuffix("h"), 16), int(sub, 0) if colon else 0)
    except ValueError:
        raise ValueError(f'is {value!r}: write index (hex) and sub-index, e.g. "7130h:1"') from None
    if not (0x1000 <= address[0] <= 0xFFFF and 0 <= address[1] <= 254):
        raise ValueError(f"is {value!r}: the index must be 1000h-FFFFh, the sub-index 0-254")
    return address


def _not_zero(value: float) -> float:
    """Return the size of one digit of a raw value [SI] unchanged. Raises ValueError for 0."""
    if value == 0.0:
        raise ValueError("is 0: give the size of one digit")
    return value


Address = Annotated[tuple[int, int], BeforeValidator(_address, json_schema_input_type=str), Field(strict=False)]
Scale = Annotated[float, AfterValidator(_not_zero)]
Object = Annotated[int, Field(ge=0, le=0xFFFFFFFF)]
NodeId = Annotated[int, Field(ge=1, le=127)]
PdoNumber = Annotated[int, Field(ge=1, le=512)]
SyncEvery = Annotated[int, Field(ge=1, le=240)]
Period = Annotated[int, Field(ge=1, le=65535)]


class Identity(SettingsTable):
    """Object 1018h of a node: what is given is compared at start."""

    vendor: Object | None = Field(default=None, description="Vendor-ID (1018h:1).")
    product: Object | None = Field(default=None, description="Product code (1018h:2).")
    revision: Object | None = Field(default=None, description="Revision number (1018h:3).")
    serial: Object | None = Field(default=None, description="Serial number (1018h:4).")


class PdoTable(SettingsTable):
    """What one TPDO of a node does differently from the node's others."""

    number: PdoNumber = Field(description="Number of the TPDO.")
    cob_id: int | None = Field(
        default=None, ge=FIRST_PDO, le=LAST_PDO, description="COB-ID. Default: the predefined one of TPDO 1 to 4."
    )
    transmission: Literal["sync", "event_timer"] | None = Field(default=None, description="As the node's.")
    sync_every: SyncEvery | None = Field(default=None, description="As the node's.")
    period_ms: Period | None = Field(default=None, description="As the node's.")


class NodeTable(SettingsTable):
    """A sensor node on the bus."""

    name: Name = Field(description="Name, by which other tables refer to it.")
    node_id: NodeId = Field(description="Its CANopen node-ID.")
    profile: Literal[0, 404, 406, 410] | None = Field(
        default=None,
        description="CiA device profile, compared with object 1000h: 404 measuring devices, 406 encoders, "
        "410 inclinometers, 0 any. Default: the EDS file's, else any.",
    )
    identity: Identity = Field(default=Identity(), description="Identity object, compared at start.")
    heartbeat_ms: int = Field(
        default=500, ge=0, le=32767, description="Heartbeat that is set in the node; 0: none, and none is expected."
    )
    transmission: Literal["sync", "event_timer"] = Field(
        default="sync",
        description='"sync": the node sends after every `sync_every`-th SYNC; "event_timer": every `period_ms`.',
    )
    sync_every: SyncEvery = Field(default=1, description="After how many SYNCs it sends.")
    period_ms: Period | None = Field(
        default=None,
        description="Period of its event timer. With sync: how often it sends, if another node produces SYNC.",
    )
    eds: str | None = Field(default=None, description="The vendor's EDS file, in the machine file's folder.")
    writable_mapping: bool = Field(
        default=True, description="false: the node's PDO mapping cannot be changed; it is only compared."
    )
    pdos: tuple[PdoTable, ...] = Field(
        default=(), strict=False, description="TPDOs whose settings differ from those of the node."
    )


class Skipped(SettingsTable):
    """An object in a PDO that nobody reads."""

    object: Address = Field(description="Index and sub-index.")
    type: TypeName | None = Field(default=None, description="Its data type. Default: the EDS file's.")


class SensorTable(SettingsTable):
    """One measured quantity; value = raw * scale + offset. Sensors in one PDO follow each other in the order of the
    file. `scale`, `offset`, `range` and `standard_error` are written with a unit (`scale_bar`), the same one for all
    four."""

    name: Name = Field(description="Name of the signal: the column in recordings.")
    kind: Annotated[Kind, Field(strict=False)] = Field(description="What is measured.")
    at: str | None = Field(
        default=None,
        description="The cylinder (pressures, force pin, length) or link (joint angle, inclination) that it is "
        "mounted on; not for sensors of the chassis and the oil.",
    )
    node: str = Field(description="Name of the node that sends it.")
    pdo: PdoNumber = Field(default=1, description="Number of the TPDO that carries it.")
    object: Address = Field(description='Index (hexadecimal) and sub-index in the node, e.g. "7130h:1".')
    type: TypeName | None = Field(
        default=None, description="Data type: i signed, u unsigned, f float, and its bits. Default: the EDS file's."
    )
    scale: Scale = Field(default=1.0, description="Size of one digit; negative where the sensor counts backwards.")
    offset: float = Field(default=0.0, description="Value at digit 0.")
    range: Range = Field(description="[least, greatest] value that is possible; outside, the sensor counts as failed.")
    standard_error: Positive | None = Field(
        default=None,
        description="Standard error of one value, noise only. Default: that of rounding to a digit; required for f32.",
    )
    skip_before: tuple[Skipped, ...] = Field(
        default=(), strict=False, description="Objects before it in the PDO that nobody reads."
    )
    skip_after: tuple[Skipped, ...] = Field(
        default=(), strict=False, description="Objects after it in the PDO that nobody reads."
    )


class FilterTable(SettingsTable):
    """Rate and cut-off frequencies of the estimator."""

    rate_hz: float = Field(default=100.0, ge=10.0, le=1000.0, description="Steps a second; also SYNC's rate.")
    channel_hz: Cutoff = Field(default=5.0, description="Low-pass of angles and forces, before anything is computed.")
    regressor_hz: Cutoff = Field(default=2.0, description="First-order low-pass of the dynamic terms and the torque.")
    smoothing_hz: Cutoff = Field(
        default=2.0, description="Second low-pass, after `regressor_hz`, of the same terms and torque."
    )
    force_hz: Cutoff = Field(
        default=20.0, description="Low-pass of second order on the cylinder forces, for the force at the tool."
    )
    inertia_hz: Cutoff = Field(
        default=8.0, description="Low-pass of first order on the torque of inertia, for the force at the tool."
    )
    direction_speed_m_s: SlowSpeed = Field(
        default=0.002, description="Cylinder speed below which the direction of friction is not known."
    )


class HealthTable(SettingsTable):
    """When a signal counts as failed."""

    hold_ms: Milliseconds = Field(default=200.0, description="For how long a missing value is bridged.")
    good_frames: int = Field(default=10, ge=1, description="How many good values in a row end a failure.")
    frozen_samples: int = Field(
        default=100, ge=2, description="How many equal values in a row, in motion, count as a failure."
    )
    max_tilt_deg: float = Field(default=15.0, gt=0, le=90, description="Pitch or roll beyond which nothing is valid.")
    max_step_ms: Milliseconds = Field(default=100.0, description="Longest pause between two steps.")


class PublicationTable(SettingsTable):
    """cylforce's own node on the bus."""

    node_id: NodeId = Field(default=64, description="Its node-ID.")
    period_ms: Period = Field(default=100, description="How often results are published.")
    force_period_ms: Period = Field(
        default=20, description="How often the forces are published; not more seldom than `period_ms`."
    )
    sync_producer: bool = Field(default=True, description="Whether it produces SYNC, at `filter.rate_hz`.")
    heartbeat_ms: int = Field(default=500, ge=1, le=32767, description="Its heartbeat.")
    j1939_address: int | None = Field(
        default=None,
        ge=0,
        le=253,
        description="Its source address on J1939 (PGN 65258, 65280, 51968). Default: no J1939.",
    )
    rated_force_n: Force = Field(default=300_000.0, description="Greatest tool force; scales what is published.")


class FrictionTable(SettingsTable):
    """The friction laws to choose from."""

    effects: tuple[str, ...] = Field(
        default=("coulomb", "viscous", "delay", "load_dependent", "directional", "stribeck", "rocker"),
        strict=False,
        description="Names of the laws; `coulomb` must be among them.",
    )
    adapt: bool = Field(
        default=True,
        description="Whether the service adjusts friction and pressure zeros as temperature and wear change them.",
    )


class TimeColumn(SettingsTable):
    """The time in a recording's table."""

    column: str = Field(default="t_s", min_length=1, description="Name of the column.")
    scale: Positive = Field(default=1.0, description="Unit of the column.")


class RecordingTable(SettingsTable):
    """Where CSV and Parquet files of this machine have time and signals, when not in `t_s` and under the sensors' names
    in SI."""

    time: TimeColumn = Field(default=TimeColumn(), description="The column of the time.")
    signals: dict[str, dict[str, object]] = Field(
        default_factory=dict,
        description="For each sensor: { column, scale_..., offset_... }, value = cell * scale + offset.",
    )


class SignalColumn(SettingsTable):
    """One signal's column; `scale` and `offset` are written with a unit (`scale_bar`), the same one for both."""

    column: str = Field(min_length=1, description="Name of the column.")
    scale: Scale = Field(default=1.0, description="Value of 1 in the column.")
    offset: float = Field(default=0.0, description="Value at 0 in the column.")


class MachineFile(SettingsTable):
    """A machine file of cylforce."""

    machine: MachineTable = Field(description="The machine as a whole.")
    links: tuple[LinkTable, ...] = Field(
        min_length=1, strict=False, description="The arm's links, from the house outwards."
    )
    tool: ToolTable = Field(description="The tooth line, where forces act.")
    attachments: tuple[AttachmentTable, ...] = Field(
        default=(), strict=False, description="Other tools that can take the last link's place."
    )
    cylinders: tuple[CylinderTable, ...] = Field(min_length=1, strict=False, description="The arm's cylinders.")
    nodes: tuple[NodeTable, ...] = Field(min_length=1, strict=False, description="The sensor nodes on the bus.")
    sensors: tuple[SensorTable, ...] = Field(min_length=1, strict=False, description="What is measured.")
    filter: FilterTable = Field(default=FilterTable(), description="Rate and cut-off frequencies of the estimator.")
    health: HealthTable = Field(default=HealthTable(), description="When a signal counts as failed.")
    publication: PublicationTable = Field(default=PublicationTable(), description="cylforce's own node on the bus.")
    friction: FrictionTable = Field(default=FrictionTable(), description="The friction laws to choose from.")
    table: RecordingTable | None = Field(
        default=None, description="Where this machine's CSV and Parquet files have time and signals."
    )
