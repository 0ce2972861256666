"""The machine file as it is written (TOML): the tables of bus, sensors and estimator, and the whole file."""

from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from cylforce.settings.arm import (
    CylinderTable,
    LinkTable,
    MachineTable,
    Name,
    Positive,
    Range,
    SettingsTable,
    ToolTable,
)
from cylforce.settings.units import in_si, kind_in_si
from cylforce.signals.kinds import Kind

Raw = object  # what TOML gave, before it is checked
TypeName = Literal["i8", "u8", "i16", "u16", "i32", "u32", "f32"]


def _address(value: object) -> object:
    if not isinstance(value, str):
        return value
    index, colon, sub = value.lower().partition(":")
    try:
        found = (int(index.removesuffix("h"), 16), int(sub, 0) if colon else 0)
    except ValueError:
        raise ValueError(f'is {value!r}: write index (hex) and sub-index, e.g. "7130h:1"') from None
    if not (0x1000 <= found[0] <= 0xFFFF and 0 <= found[1] <= 254):
        raise ValueError(f"is {value!r}: the index must be 1000h-FFFFh, the sub-index 0-254")
    return found


def _not_zero(value: float) -> float:
    if value == 0.0:
        raise ValueError("is 0: give the size of one digit")
    return value


Address = Annotated[tuple[int, int], BeforeValidator(_address), Field(strict=False)]
Scale = Annotated[float, AfterValidator(_not_zero)]


class Identity(SettingsTable):
    """Object 1018h; what is given is checked at start."""

    vendor: int | None = Field(default=None, ge=0, le=0xFFFFFFFF)
    product: int | None = Field(default=None, ge=0, le=0xFFFFFFFF)
    revision: int | None = Field(default=None, ge=0, le=0xFFFFFFFF)
    serial: int | None = Field(default=None, ge=0, le=0xFFFFFFFF)


class PdoTable(SettingsTable):
    """What one TPDO of a node does differently from its node's others."""

    number: int = Field(ge=1, le=512)
    cob_id: int | None = Field(default=None, ge=0x181, le=0x57F)
    transmission: Literal["sync", "event_timer"] | None = None
    sync_every: int | None = Field(default=None, ge=1, le=240)
    period_ms: int | None = Field(default=None, ge=1, le=65535)


class NodeTable(SettingsTable):
    """[[nodes]]: a sensor node. `transmission` "sync": after every `sync_every`-th SYNC (`period_ms` only
    tells how often that is where SYNC is made by somebody else), "event_timer": every `period_ms` by itself.
    `eds`: the vendor's EDS file, beside the machine file. `writable_mapping` false: the mapping is fixed and
    only checked."""

    name: Name
    node_id: int = Field(ge=1, le=127)
    profile: Literal[0, 404, 406, 410] | None = None
    identity: Identity = Identity()
    heartbeat_ms: int = Field(default=500, ge=0, le=32767)
    transmission: Literal["sync", "event_timer"] = "sync"
    sync_every: int = Field(default=1, ge=1, le=240)
    period_ms: int | None = Field(default=None, ge=1, le=65535)
    eds: str | None = None
    writable_mapping: bool = True
    pdos: tuple[PdoTable, ...] = Field(default=(), strict=False)


class Skipped(SettingsTable):
    """An object in a PDO that nobody reads."""

    object: Address
    type: TypeName | None = None


class SensorTable(SettingsTable):
    """[[sensors]]: one measured quantity; several in one PDO follow each other in the order of the file.
    `at`: the cylinder (pressures, force pin, length) or link (angle, inclination). scale, offset, range and
    standard_error carry a unit in the file (`scale_bar`, ...) and are SI here."""

    name: Name
    kind: Annotated[Kind, Field(strict=False)]
    at: str | None = None
    node: str
    pdo: int = Field(default=1, ge=1, le=512)
    object: Address
    type: TypeName | None = None
    scale: Scale = 1.0
    offset: float = 0.0
    range: Range
    standard_error: Positive | None = None
    skip_before: tuple[Skipped, ...] = Field(default=(), strict=False)
    skip_after: tuple[Skipped, ...] = Field(default=(), strict=False)

    @model_validator(mode="before")
    @classmethod
    def _si(cls, raw: Raw) -> Raw:
        return kind_in_si(raw) if isinstance(raw, dict) else raw


class FilterTable(SettingsTable):
    """[filter]: see `core.service.Filters`."""

    rate_hz: float = Field(default=100.0, ge=10.0, le=1000.0)
    channel_hz: Positive = 5.0
    regressor_hz: Positive = 2.0
    smoothing_hz: Positive = 2.0
    direction_speed_m_s: Positive = 0.002


class HealthTable(SettingsTable):
    """[health]: when signals stop being believed; see `core.service.Health`."""

    hold_ms: Positive = 200.0
    good_frames: int = Field(default=10, ge=1)
    frozen_samples: int = Field(default=100, ge=2)
    max_tilt_deg: float = Field(default=15.0, gt=0, le=90)
    max_step_ms: Positive = 100.0


class PublicationTable(SettingsTable):
    """[publication]: our own node."""

    node_id: int = Field(default=64, ge=1, le=127)
    period_ms: int = Field(default=100, ge=1, le=65535)
    sync_producer: bool = True
    heartbeat_ms: int = Field(default=500, ge=1, le=32767)
    rated_force_n: Positive = 300_000.0


class FrictionTable(SettingsTable):
    """[friction]: the friction laws to choose from; `adapt`: friction and zero of identified tares follow
    temperature and wear."""

    effects: tuple[str, ...] = Field(
        default=("coulomb", "viscous", "delay", "load_dependent", "directional"), strict=False
    )
    adapt: bool = True


class TimeColumn(SettingsTable):
    """The time in a recording's table."""

    column: str = Field(default="t_s", min_length=1)
    scale: Positive = 1.0

    @model_validator(mode="before")
    @classmethod
    def _si(cls, raw: Raw) -> Raw:
        return in_si(raw, "s", ("scale",)) if isinstance(raw, dict) else raw


class RecordingTable(SettingsTable):
    """[table]: where CSV and Parquet files of this machine have time and signals, when not in `t_s` and under
    the sensors' names in SI. `signals` maps a sensor to {column, scale_bar, offset_bar, ...}."""

    time: TimeColumn = TimeColumn()
    signals: dict[str, dict[str, object]] = Field(default_factory=dict)


class SignalColumn(SettingsTable):
    """One signal's column, scale and offset in SI."""

    column: str = Field(min_length=1)
    scale: Scale = 1.0
    offset: float = 0.0


class MachineFile(SettingsTable):
    """A whole machine file."""

    machine: MachineTable
    links: tuple[LinkTable, ...] = Field(min_length=1, strict=False)
    tool: ToolTable
    cylinders: tuple[CylinderTable, ...] = Field(min_length=1, strict=False)
    nodes: tuple[NodeTable, ...] = Field(min_length=1, strict=False)
    sensors: tuple[SensorTable, ...] = Field(min_length=1, strict=False)
    filter: FilterTable = FilterTable()
    health: HealthTable = HealthTable()
    publication: PublicationTable = PublicationTable()
    friction: FrictionTable = FrictionTable()
    table: RecordingTable | None = None
