"""The data sheet of the model: what its maker prints, and by how much one machine may differ from it. SI units,
radians."""

from dataclasses import dataclass, field

Point = tuple[float, float]
JOINTS = ("boom", "stick", "bucket")


@dataclass(frozen=True, slots=True)
class Link:
    """A link with half of each cylinder that hangs on it: centre and inertia about it in the pin-to-pin frame."""

    length: float
    mass: float
    centre: Point
    inertia: float
    range_deg: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Cylinder:
    """A cylinder (or `count` side by side): bore, rod, shortest and longest length between its pins, its pins in the
    frames of the inner and of the outer body."""

    count: int
    bore: float
    rod: float
    lengths: tuple[float, float]
    foot: Point
    eye: Point


@dataclass(frozen=True, slots=True)
class BucketBars:
    """The bucket's four-bar: rocker pin on the stick, link pin on the bucket, lengths of the two bars."""

    rocker_pin: Point = (2.50, -0.04)
    link_pin: Point = (-0.13, 0.41)
    rocker: float = 0.68
    link: float = 0.66


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Half-widths: relative for masses and inertias, else m; `pins` for every pin's coordinates and bar lengths."""

    mass: float = 0.08
    centre: float = 0.08
    inertia: float = 0.20
    length: float = 0.002
    pins: float = 0.0015
    bore: float = 0.0001


@dataclass(frozen=True, slots=True)
class Sheet:
    """All of it. `slew_axis`: the boom pin lies so far before the slew axis; `pin_height` above the ground."""

    links: dict[str, Link]
    cylinders: dict[str, Cylinder]
    bars: BucketBars = BucketBars()
    tool: Point = (1.5, 0.0)
    slew_axis: float = 0.15
    pin_height: float = 1.95
    rated_payload: float = 1500.0
    payload_reach: float = 1.2
    pressure_range: float = 400e5
    tolerances: Tolerances = field(default_factory=Tolerances)


EXCAVATOR = Sheet(
    links={
        "boom": Link(5.70, 1700.0, (2.70, 0.45), 5200.0, (-40.0, 58.0)),
        "stick": Link(2.90, 940.0, (1.00, 0.18), 1300.0, (-150.0, -35.0)),
        "bucket": Link(1.50, 800.0, (0.65, 0.28), 220.0, (-138.0, 24.0)),
    },
    cylinders={
        "boom": Cylinder(2, 0.120, 0.085, (1.75, 3.07), (0.55, -0.62), (2.40, 0.70)),
        "stick": Cylinder(1, 0.135, 0.095, (2.35, 3.82), (2.75, 1.00), (-0.85, 0.12)),
        # The bucket cylinder's eye sits on the pin that rocker and link share.
        "bucket": Cylinder(1, 0.115, 0.080, (1.75, 2.86), (0.20, 0.70), (0.0, 0.0)),
    },
)
