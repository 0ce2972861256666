"""The arm's tables in the machine file: machine, links, tool, cylinders. Frozen models, unknown keys refused,
units in the key names."""

from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from cylforce.settings.units import HUGE

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,39}$")]
Positive = Annotated[float, Field(gt=0, lt=HUGE)]
NotNegative = Annotated[float, Field(ge=0, lt=HUGE)]
Number = Annotated[float, Field(gt=-HUGE, lt=HUGE)]
XZ = Annotated[tuple[Number, Number], Field(strict=False)]


def _rising(value: object) -> object:
    if isinstance(value, list | tuple) and len(value) == 2 and all(isinstance(v, int | float) for v in value):
        if not value[0] < value[1]:
            raise ValueError(f"is {list(value)}: the first number must be the smaller one")
        return tuple(value)
    return value


Range = Annotated[tuple[Number, Number], BeforeValidator(_rising), Field(strict=False)]


class SettingsTable(BaseModel):
    """A table of the file."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class MachineTable(SettingsTable):
    """[machine]; `slew_axis_m`: x of the first pin seen from the slew axis; `payload_reach_m`: how far from
    the last pin the middle of a load may lie, by default as far as the tooth line."""

    name: str = Field(min_length=1)
    rated_payload_kg: Positive
    slew_axis_m: Number = 0.0
    payload_reach_m: Positive | None = None


class LinkTolerance(SettingsTable):
    """Half-widths within which a link's data are trusted."""

    mass_percent: NotNegative = 10.0
    centre_m: NotNegative = 0.05
    inertia_percent: NotNegative = 25.0
    length_m: NotNegative = 0.0


class LinkTable(SettingsTable):
    """[[links]], house outwards; the frame's origin is the inner pin, x points to the outer pin (the last
    link's: wherever its angle is measured to), z is x turned from forward to up. Default inertia: a slender
    rod's."""

    name: Name
    length_m: Positive | None = None
    mass_kg: Positive
    centre_m: XZ
    inertia_kg_m2: Positive | None = None
    angle_range_deg: Range
    tolerance: LinkTolerance = LinkTolerance()


class ToolTable(SettingsTable):
    """[tool]: the tooth line in the last link's frame."""

    point_m: XZ


class Pin(SettingsTable):
    """A pin: "chassis" or a link's name, and its place in that body's frame."""

    body: str = "chassis"
    at_m: XZ


class TriangleTable(SettingsTable):
    """A cylinder straight between two pins."""

    kind: Literal["triangle"]
    foot: Pin
    eye: Pin


class FourBarTable(SettingsTable):
    """A cylinder on a rocker that turns about `rocker_pin` and drives `link_pin` through a link. The rocker's
    end lies to the left or right of the direction rocker pin -> link pin. `eye_m`: the cylinder's eye in the
    rocker's frame (x from rocker pin to rocker end, z to its left); by default the rocker's end."""

    kind: Literal["four_bar"]
    foot: Pin
    rocker_pin: Pin
    link_pin: Pin
    rocker_m: Positive
    link_m: Positive
    side: Literal["left", "right"]
    eye_m: XZ | None = None


class DogboneTable(SettingsTable):
    """Two links that meet at the cylinder's eye: the inner one from `inner_pin`, the outer one to
    `outer_pin`; the eye lies to the left or right of the direction inner pin -> outer pin."""

    kind: Literal["dogbone"]
    foot: Pin
    inner_pin: Pin
    outer_pin: Pin
    inner_m: Positive
    outer_m: Positive
    side: Literal["left", "right"]


class CylinderTolerance(SettingsTable):
    """Half-widths within which a cylinder's dimensions are trusted."""

    bore_mm: NotNegative = 0.1
    pins_m: NotNegative = 0.001


class CylinderTable(SettingsTable):
    """[[cylinders]]; `count` of them side by side; `length_range_m`: pin to pin, retracted and extended;
    `rod_pressure_bar`: return pressure to reckon with where no rod-side sensor exists."""

    name: Name
    bore_mm: Positive
    rod_mm: Positive
    count: int = Field(default=1, ge=1, le=8)
    length_range_m: Range
    rod_pressure_bar: NotNegative | None = None
    linkage: TriangleTable | FourBarTable | DogboneTable = Field(discriminator="kind")
    tolerance: CylinderTolerance = CylinderTolerance()
