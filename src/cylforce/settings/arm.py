"""The arm's tables in the machine file: machine, links, tool, cylinders.

The models are frozen, refuse unknown keys, and have units in the names of keys. The description of each key is its only
documentation: the table in config/README.md and the JSON schema are made from it.
"""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo, field_validator

from cylforce.settings.limits import (
    Angle,
    Bar,
    Bore,
    BoreTolerance,
    CentreTolerance,
    Coordinate,
    CylinderLength,
    Gravity,
    Height,
    Inertia,
    InertiaTolerance,
    Latitude,
    Length,
    LengthTolerance,
    Mass,
    MassTolerance,
    Number,
    Offset,
    Payload,
    PinTolerance,
    Reach,
    ReturnPressure,
    Rod,
)

NAME = r"^[A-Za-z][A-Za-z0-9_]{0,39}$"
Name = Annotated[str, Field(pattern=NAME)]
XZ = Annotated[tuple[Coordinate, Coordinate], Field(strict=False)]


def _rising(value: Any) -> Any:  # noqa: ANN401 - what TOML gave, before it is checked
    """Return a range as a tuple. Raises ValueError unless its first number is the smaller one.

    Anything but a list of two numbers is returned unchanged, so that pydantic refuses it.
    """
    if isinstance(value, list | tuple) and len(value) == 2 and all(isinstance(v, int | float) for v in value):
        if not value[0] < value[1]:
            raise ValueError(f"is {list(value)}: the first number must be the smaller one")
        return tuple(value)
    return value


Rising = BeforeValidator(_rising)
Range = Annotated[tuple[Number, Number], Rising, Field(strict=False)]
AngleRange = Annotated[tuple[Angle, Angle], Rising, Field(strict=False)]
LengthRange = Annotated[tuple[CylinderLength, CylinderLength], Rising, Field(strict=False)]


class SettingsTable(BaseModel):
    """A table of the file."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class MachineTable(SettingsTable):
    """The machine as a whole."""

    name: str = Field(min_length=1, description="Name of the machine; it stands in reports and identified files.")
    rated_payload_kg: Payload = Field(
        description="Rated payload. It scales the published values and the limits of validity."
    )
    slew_axis_m: Offset = Field(default=0.0, description="x of the first pin, from the slew axis forwards.")
    inertial_sensor_m: XZ | None = Field(
        default=None, description="[x, z] of the base's inertial sensor, from the first pin in the house's axes."
    )
    payload_reach_m: Reach | None = Field(
        default=None,
        description="How far from the last pin the middle of a load may lie. Default: as far as the tooth line.",
    )
    gravity_m_s2: Gravity | None = Field(
        default=None, description="Gravity where the machine works, if it was measured. Default: 9.80665."
    )
    latitude_deg: Latitude | None = Field(
        default=None, description="Latitude where it works, north or south: gravity follows from it (WGS 84)."
    )
    height_m: Height | None = Field(default=None, description="Height above sea where it works; with latitude_deg.")


class LinkTolerance(SettingsTable):
    """How far a link's data may be off: half-widths."""

    mass_percent: MassTolerance = Field(default=10.0, description="Of the mass.")
    centre_m: CentreTolerance = Field(default=0.05, description="Of each coordinate of the centre of gravity.")
    inertia_percent: InertiaTolerance = Field(default=25.0, description="Of the moment of inertia.")
    length_m: LengthTolerance = Field(default=0.0, description="Of the length.")


class LinkTable(SettingsTable):
    """A link of the arm, with all that is fixed to it; from the house outwards. Its frame begins at its inner pin; x
    points to its outer pin (the last link's: to where its angle is measured to), z is x turned from forward to up."""

    name: Name = Field(description="Name, by which other tables refer to it. Letters, digits and _, at most 40.")
    length_m: Length | None = Field(
        default=None, description="From inner to outer pin. Required, except for the last link."
    )
    mass_kg: Mass = Field(description="Mass, with its share of the cylinders and bars that hang on it.")
    centre_m: XZ = Field(description="[x, z] of the centre of gravity in the link's frame.")
    inertia_kg_m2: Inertia | None = Field(
        default=None,
        description="Moment of inertia about the centre of gravity (not about the pin). Default: a slender rod's, "
        "m l^2 / 12.",
    )
    angle_range_deg: AngleRange = Field(
        description="[least, greatest] angle of the joint at its inner pin, measured from the link before it (the "
        "first: from the house), positive upwards."
    )
    tolerance: LinkTolerance = Field(default=LinkTolerance(), description="How far these data may be off.")


class ToolTable(SettingsTable):
    """The tooth line, where forces act."""

    point_m: XZ = Field(description="[x, z] of the tooth line (or hook) in the last link's frame.")
    curled_deg: AngleRange | None = Field(
        default=None, description="Angles of the last joint at which loads are booked: bucket curled. Default: any."
    )


class AttachmentTolerance(SettingsTable):
    """How far an attachment's data may be off: half-widths."""

    mass_percent: MassTolerance = Field(default=10.0, description="Of the mass.")
    centre_m: CentreTolerance = Field(default=0.05, description="Of each coordinate of the centre of gravity.")
    inertia_percent: InertiaTolerance = Field(default=25.0, description="Of the moment of inertia.")


class AttachmentTable(SettingsTable):
    """A tool that can take the place of the last link and of [tool]; its data are in that link's frame."""

    name: Name = Field(description='Name, by which it is chosen; the last link itself is called "standard".')
    kind: Literal["bucket", "grab", "fork"] = Field(description="What it is.")
    mass_kg: Mass = Field(description="Mass of all that takes the last link's place, quick coupler included.")
    centre_m: XZ = Field(description="[x, z] of its centre of gravity.")
    inertia_kg_m2: Inertia | None = Field(
        default=None,
        description="Moment of inertia about the centre of gravity. Default: a slender rod's, m l^2 / 12.",
    )
    point_m: XZ = Field(description="[x, z] of its tooth line, hook or fork tip.")
    rated_payload_kg: Payload = Field(description="Rated payload with it.")
    payload_reach_m: Reach | None = Field(
        default=None,
        description="How far from the last pin the middle of a load may lie. Default: as far as point_m.",
    )
    tolerance: AttachmentTolerance = Field(
        default=AttachmentTolerance(), description="How far these data may be off; a small one says: they are trusted."
    )


class Pin(SettingsTable):
    """A pin, on one body."""

    body: str = Field(
        default="chassis", description='The body that the pin is fixed to: "chassis" (the house) or a link.'
    )
    at_m: XZ = Field(description="[x, z] in that body's frame; the chassis' begins at the first link's inner pin.")


class TriangleTable(SettingsTable):
    """A cylinder straight between two pins."""

    kind: Literal["triangle"] = Field(description="A cylinder straight between two pins: boom, stick.")
    foot: Pin = Field(description="The barrel's pin.")
    eye: Pin = Field(description="The rod's pin.")


class FourBarTable(SettingsTable):
    """A cylinder on a rocker that drives the next body through a link: bucket linkage, Z-bar."""

    kind: Literal["four_bar"] = Field(description="A cylinder that turns a rocker; a bar joins it to the driven body.")
    foot: Pin = Field(description="The barrel's pin.")
    rocker_pin: Pin = Field(description="The pin about which the rocker turns.")
    link_pin: Pin = Field(description="The bar's pin on the driven body.")
    rocker_m: Bar = Field(description="From the rocker's pin to its end, where the bar begins.")
    link_m: Bar = Field(description="Length of the bar, pin to pin.")
    side: Literal["left", "right"] = Field(
        description="On which side of the line from rocker pin to link pin the rocker's end lies."
    )
    eye_m: XZ | None = Field(
        default=None,
        description="The rod's pin on the rocker: [along, left of] the line from rocker pin to rocker end. Default: "
        "at the rocker's end.",
    )


class DogboneTable(SettingsTable):
    """A cylinder whose eye holds two bars: one to each body (loader cranes)."""

    kind: Literal["dogbone"] = Field(description="A cylinder whose eye joins two bars, one to each body.")
    foot: Pin = Field(description="The barrel's pin.")
    inner_pin: Pin = Field(description="The inner bar's pin on the inner body.")
    outer_pin: Pin = Field(description="The outer bar's pin on the outer body.")
    inner_m: Bar = Field(description="Length of the inner bar, from its pin to the eye.")
    outer_m: Bar = Field(description="Length of the outer bar, from its pin to the eye.")
    side: Literal["left", "right"] = Field(
        description="On which side of the line from inner pin to outer pin the eye lies."
    )


class CylinderTolerance(SettingsTable):
    """How far a cylinder's dimensions may be off: half-widths."""

    bore_mm: BoreTolerance = Field(default=0.1, description="Of the bore.")
    pins_m: PinTolerance = Field(default=0.001, description="Of each coordinate of its pins.")


class CylinderTable(SettingsTable):
    """A cylinder, or several alike side by side."""

    name: Name = Field(description="Name, by which other tables refer to it.")
    bore_mm: Bore = Field(description="Diameter of the piston.")
    rod_mm: Rod = Field(description="Diameter of the rod; smaller than the bore.")
    count: int = Field(default=1, ge=1, le=8, description="How many of them work side by side.")
    length_range_m: LengthRange = Field(description="Length from pin to pin: [retracted, extended].")
    rod_pressure_bar: ReturnPressure | None = Field(
        default=None, description="Pressure to assume on the rod side if no sensor measures it."
    )
    linkage: TriangleTable | FourBarTable | DogboneTable = Field(
        discriminator="kind", description="How the cylinder moves its joint."
    )
    tolerance: CylinderTolerance = Field(default=CylinderTolerance(), description="How far these data may be off.")

    @field_validator("rod_mm")
    @classmethod
    def _thinner(cls, rod: float, info: ValidationInfo) -> float:
        """Return the rod's diameter [mm]. Raises ValueError unless it is smaller than the bore."""
        bore = info.data.get("bore_mm")
        if bore is not None and rod >= bore:
            raise ValueError(f"is {rod:g}, not smaller than bore_mm = {bore:g}: exchange or correct them")
        return rod

    @field_validator("length_range_m")
    @classmethod
    def _single_stage(cls, lengths: tuple[float, float]) -> tuple[float, float]:
        """Return retracted and extended length [m]. Raises ValueError for a stroke longer than the retracted length."""
        low, high = lengths
        if high >= 2.0 * low:  # the barrel of a single-stage cylinder is longer than its stroke
            raise ValueError(
                f"is [{low:g}, {high:g}]: a stroke of {high - low:g} m is more than the retracted length of {low:g} m "
                "holds; write [retracted, extended], pin to pin"
            )
        return lengths
