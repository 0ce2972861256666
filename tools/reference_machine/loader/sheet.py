"""The loader's data sheet: 15 t, rated 4.5 t, Z-bar. SI units, degrees where named so. Chosen by hand, in round
numbers: parallel lift within six degrees, no dead point within the strokes."""

from dataclasses import dataclass, field

from reference_machine.datasheet import Cylinder, Link, Point, Tolerances
from reference_machine.specimen import Bar

JOINTS = ("arm", "bucket")
CYLINDERS = ("lift", "tilt")


@dataclass(frozen=True, slots=True)
class Bars:
    """The Z-bar: the crank's pin on the arm, the link's pin on the bucket, crank pin to its lower end, the link's
    length, and the tilt cylinder's eye on the crank, seen from its pin towards its lower end."""

    crank_pin: Point = (1.45, 0.60)
    link_pin: Point = (-0.04, 0.38)
    crank: float = 0.95
    link: float = 0.675
    eye: Point = (-1.23, -0.09)


@dataclass(frozen=True, slots=True)
class LoaderSheet:
    """All of it. Lengths of links pin to pin; `attitude_deg`: the bucket's line against the horizontal, dumped and
    curled; `pin_height` above the ground; `wheels`: where the base rocks about, `inertial`: where its
    inertial sensor sits, if it has one, both seen from the arm's pin."""

    links: dict[str, Link]
    cylinders: dict[str, Cylinder]
    bars: Bars = Bars()
    tool: Point = (1.25, 0.0)
    attitude_deg: tuple[float, float] = (-46.0, 48.0)
    pin_height: float = 1.80
    wheels: Point = (-1.00, -1.80)
    inertial: Point = (-0.60, -0.40)
    rated_payload: float = 4500.0
    payload_reach: float = 1.1
    tolerances: Tolerances = field(default_factory=Tolerances)


LOADER = LoaderSheet(
    links={
        "arm": Link(2.55, 1350.0, (1.25, 0.12), 1000.0, (-42.0, 47.0)),
        "bucket": Link(1.25, 1300.0, (0.50, 0.30), 420.0, (-93.0, 90.0)),
    },
    cylinders={
        "lift": Cylinder(2, 0.120, 0.075, (1.105, 1.895), (0.12, -0.52), (1.50, 0.05)),
        "tilt": Cylinder(1, 0.150, 0.085, (1.13, 1.86), (0.30, 0.15), (0.0, 0.0)),  # its eye: Bars.eye
    },
)
# The linkages' own bodies (the lift cylinders' are of both), and how the data sheet shares them out: kg at a place.
BARS = {
    "lift_barrel": Bar(160.0, 0.42, 18.0),
    "lift_rod": Bar(110.0, 0.42, 12.0),
    "tilt_barrel": Bar(120.0, 0.45, 15.0),
    "tilt_rod": Bar(80.0, 0.45, 9.0),
    "crank": Bar(180.0, -0.10, 55.0),
    "link": Bar(60.0, 0.34, 3.0),
}
SHARES: dict[str, tuple[tuple[float, Point], ...]] = {
    "arm": ((135.0, (1.50, 0.05)), (280.0, (1.45, 0.60)), (30.0, (2.30, 0.20))),
    "bucket": ((30.0, (-0.04, 0.38)),),
}
FLATNESS = {"arm": 0.06, "bucket": 0.40}
WIDTH = {"arm": 0.45, "bucket": 0.80}
