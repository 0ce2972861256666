"""The machine file as it is written (TOML): one frozen model per table, unknown keys refused, units in the key names."""

from math import inf
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from cylforce.edges.settings_units import in_si, kind_in_si
from cylforce.words.signals import Kind

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,39}$")]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
XZ = Annotated[tuple[float, float], Field(strict=False)]
TypeName = Literal["i8", "u8", "i16", "u16", "i32", "u32", "f32"]


def _rising(value: Any) -> Any:
    if isinstance(value, list | tuple) and len(value) == 2 and all(isinstance(v, int | float) for v in value):
        if not value[0] < value[1]:
            raise ValueError(f"is {list(value)}: the first number must be the smaller one")
        return tuple(value)
    return value


def _address(value: Any) -> Any:
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


Range = Annotated[tuple[float, float], BeforeValidator(_rising), Field(strict=False)]
Address = Annotated[tuple[int, int], BeforeValidator(_address), Field(strict=False)]


class Table(BaseModel):
    """A table of the file."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class MachineTable(Table):
    """[machine]; `slew_axis_m`: signed distance of the first pin from the slew axis (x of the pin seen from the axis);
    `payload_reach_m`: how far from the last pin the middle of a load may lie, by default as far as the tooth line."""

    name: str = Field(min_length=1)
    rated_payload_kg: Positive
    slew_axis_m: float = 0.0
    payload_reach_m: Positive | None = None


class LinkTolerance(Table):
    """Half-widths within which a link's data are trusted."""

    mass_percent: NotNegative = 10.0
    centre_m: NotNegative = 0.05
    inertia_percent: NotNegative = 25.0
    length_m: NotNegative = 0.0


class LinkTable(Table):
    """[[links]], house outwards; the frame's origin is the inner pin, x points to the outer pin (the last link's: to
    where its maker likes), z is x turned from forward to up. Default inertia: that of a slender rod."""

    name: Name
    length_m: Positive | None = None
    mass_kg: Positive
    centre_m: XZ
    inertia_kg_m2: Positive | None = None
    angle_range_deg: Range
    tolerance: LinkTolerance = LinkTolerance()


class ToolTable(Table):
    """[tool]: the tooth line in the last link's frame."""

    point_m: XZ


class Pin(Table):
    """A pin: "chassis" or a link's name, and its place in that body's frame."""

    body: str = "chassis"
    at_m: XZ


class Triangle(Table):
    """A cylinder straight between two pins."""

    kind: Literal["triangle"]
    foot: Pin
    eye: Pin


class FourBar(Table):
    """A cylinder on a rocker that turns about `rocker_pin` and drives `link_pin` through a link. The rocker's end lies to
    the left or right of the direction rocker pin -> link pin. `eye_m`: the cylinder's eye in the rocker's frame (x from
    rocker pin to rocker end, z to its left); by default the rocker's end."""

    kind: Literal["four_bar"]
    foot: Pin
    rocker_pin: Pin
    link_pin: Pin
    rocker_m: Positive
    link_m: Positive
    side: Literal["left", "right"]
    eye_m: XZ | None = None


class Dogbone(Table):
    """Two links that meet at the cylinder's eye: the inner one from `inner_pin`, the outer one to `outer_pin`; the eye
    lies to the left or right of the direction inner pin -> outer pin."""

    kind: Literal["dogbone"]
    foot: Pin
    inner_pin: Pin
    outer_pin: Pin
    inner_m: Positive
    outer_m: Positive
    side: Literal["left", "right"]


class CylinderTolerance(Table):
    """Half-widths within which a cylinder's dimensions are trusted."""

    bore_mm: NotNegative = 0.1
    pins_m: NotNegative = 0.001


class CylinderTable(Table):
    """[[cylinders]]; `count` of them side by side; `length_range_m`: pin to pin, retracted and extended;
    `rod_pressure_bar`: return pressure to reckon with where no rod-side sensor exists."""

    name: Name
    bore_mm: Positive
    rod_mm: Positive
    count: int = Field(default=1, ge=1, le=8)
    length_range_m: Range
    rod_pressure_bar: NotNegative | None = None
    linkage: Triangle | FourBar | Dogbone = Field(discriminator="kind")
    tolerance: CylinderTolerance = CylinderTolerance()


class Identity(Table):
    """Object 1018h; what is given is checked at start."""

    vendor: int | None = Field(default=None, ge=0, le=0xFFFFFFFF)
    product: int | None = Field(default=None, ge=0, le=0xFFFFFFFF)
    revision: int | None = Field(default=None, ge=0, le=0xFFFFFFFF)
    serial: int | None = Field(default=None, ge=0, le=0xFFFFFFFF)


class PdoTable(Table):
    """What one TPDO of a node does differently from its node's others."""

    number: int = Field(ge=1, le=512)
    cob_id: int | None = Field(default=None, ge=0x181, le=0x6DF)
    transmission: Literal["sync", "event_timer"] | None = None
    sync_every: int | None = Field(default=None, ge=1, le=240)
    period_ms: int | None = Field(default=None, ge=1, le=65535)


class NodeTable(Table):
    """[[nodes]]: a sensor node. `transmission` "sync": after every `sync_every`-th SYNC (`period_ms` only tells how often
    that is where SYNC is made by somebody else), "event_timer": every `period_ms` by itself. `eds`: the vendor's EDS file,
    beside the machine file. `writable_mapping` false: the node's PDO mapping is what it is and is only checked."""

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


class Skipped(Table):
    """An object in a PDO that nobody reads."""

    object: Address
    type: TypeName


class SensorTable(Table):
    """[[sensors]]: one measured quantity; several in one PDO follow each other in the order of the file. `at`: the cylinder
    (pressures, force pin, length) or link (angle, inclination). scale, offset, range and standard_error carry a unit in
    the file (`scale_bar`, ...) and are SI here."""

    name: Name
    kind: Annotated[Kind, Field(strict=False)]
    at: str | None = None
    node: str
    pdo: int = Field(default=1, ge=1, le=512)
    object: Address
    type: TypeName | None = None
    scale: float = 1.0
    offset: float = 0.0
    range: Range
    standard_error: Positive | None = None
    skip_before: tuple[Skipped, ...] = Field(default=(), strict=False)
    skip_after: tuple[Skipped, ...] = Field(default=(), strict=False)

    @model_validator(mode="before")
    @classmethod
    def _si(cls, raw: Any) -> Any:
        return kind_in_si(raw) if isinstance(raw, dict) else raw


class FilterTable(Table):
    """[filter]: see `core.service.Filters`."""

    rate_hz: float = Field(default=100.0, ge=10.0, le=1000.0)
    channel_hz: Positive = 5.0
    regressor_hz: Positive = 2.0
    smoothing_hz: Positive = 2.0
    direction_speed_m_s: Positive = 0.002


class HealthTable(Table):
    """[health]: when signals stop being believed; see `core.service.Health`."""

    hold_ms: Positive = 200.0
    good_frames: int = Field(default=10, ge=1)
    frozen_samples: int = Field(default=100, ge=2)
    max_tilt_deg: float = Field(default=15.0, gt=0, le=90)
    max_step_ms: Positive = 100.0


class PublicationTable(Table):
    """[publication]: our own node."""

    node_id: int = Field(default=64, ge=1, le=127)
    period_ms: int = Field(default=100, ge=1, le=65535)
    sync_producer: bool = True
    heartbeat_ms: int = Field(default=500, ge=1, le=32767)
    rated_force_n: Positive = 300_000.0


class FrictionTable(Table):
    """[friction]: the friction models in the regressor."""

    effects: tuple[Literal["coulomb", "viscous", "load_dependent"], ...] = Field(
        default=("coulomb", "viscous"), strict=False
    )


class TimeColumn(Table):
    """The time in a recording's table."""

    column: str = Field(default="t_s", min_length=1)
    scale: Positive = 1.0
    offset: float = 0.0

    @model_validator(mode="before")
    @classmethod
    def _si(cls, raw: Any) -> Any:
        return in_si(raw, "s", ("scale", "offset")) if isinstance(raw, dict) else raw


class RecordingTable(Table):
    """[table]: where CSV and Parquet files of this machine have time and signals, when not in `t_s` and under the sensors'
    names in SI. `signals` maps a sensor to {column, scale_bar, offset_bar, ...}."""

    time: TimeColumn = TimeColumn()
    signals: dict[str, dict[str, Any]] = Field(default_factory=dict)


class SignalColumn(Table):
    """One signal's column, scale and offset in SI."""

    column: str = Field(min_length=1)
    scale: float = Field(default=1.0, gt=-inf, lt=inf)
    offset: float = 0.0


class MachineFile(Table):
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
