"""Two machines built by hand, so that tests of the core need no file."""

from math import pi, radians

from cylforce.mechanics.linkages import FourBar, Triangle
from cylforce.mechanics.machine import Cylinder, Link, Machine
from cylforce.signals.kinds import Kind, Signal

STICK = Link("stick", 2.9, 900, 0.9, 0.15, 900, radians(-150), radians(-35), 90, 0.1, 300)
BUCKET = Link("bucket", 1.5, 800, 0.7, 0.3, 300, radians(-150), radians(25), 80, 0.1, 100)
BOOM = Link("boom", 5.7, 1700, 2.6, 0.4, 5000, radians(-40), radians(55), 170, 0.1, 1500)


def _cylinder(name: str, linkage: Triangle | FourBar, bore_mm: float, rod_mm: float, count: int) -> Cylinder:
    head, rod = (count * pi / 4 * (d / 1e3) ** 2 for d in (bore_mm, rod_mm))
    return Cylinder(name, linkage, head, head - rod, 1.0, 4.0)


def _bucket_linkage(stick: int) -> FourBar:
    return FourBar((stick, 0.35 + 0.6j), (stick, 2.48 + 0.0j), (stick + 1, -0.1 + 0.42j), 0.6, 0.55, 1)


def _signals(links: tuple[Link, ...], cylinders: tuple[Cylinder, ...]) -> tuple[Signal, ...]:
    pressures = [
        Signal(f"{c.name}_{kind.value}", kind, k, -1e5, 500e5, 0.01, 0.2e5)
        for k, c in enumerate(cylinders)
        for kind in (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE)
    ]
    angles = [
        Signal(f"{k.name}_angle", Kind.JOINT_ANGLE, j, -3.2, 3.2, 0.01, radians(0.01)) for j, k in enumerate(links)
    ]
    house = [
        Signal("pitch", Kind.PITCH, 0, -1.0, 1.0, 0.01, radians(0.01)),
        Signal("roll", Kind.ROLL, 0, -1.0, 1.0, 0.01, radians(0.01)),
        Signal("slew", Kind.SLEW_RATE, 0, -2.0, 2.0, 0.01, 1e-3),
    ]
    return (*pressures, *angles, *house)


def excavator() -> Machine:
    """Boom, stick, bucket; three cylinders; 15 signals of which the first six are pressures."""
    links = (BOOM, STICK, BUCKET)
    cylinders = (
        _cylinder("boom", Triangle((0, 0.55 - 0.45j), (1, 2.2 + 0.25j)), 120, 85, 2),
        _cylinder("stick", Triangle((1, 2.9 + 0.8j), (2, -0.65 + 0.3j)), 135, 95, 1),
        _cylinder("bucket", _bucket_linkage(2), 115, 80, 1),
    )
    return Machine("excavator", links, cylinders, _signals(links, cylinders), 1.5 + 0j, 1500.0, 0.8, 0.3)


def stick_and_bucket() -> Machine:
    """The paper's two links on a boom that stands still."""
    links = (STICK, BUCKET)
    cylinders = (
        _cylinder("stick", Triangle((0, -2.8 + 0.8j), (1, -0.65 + 0.3j)), 135, 95, 1),
        _cylinder("bucket", _bucket_linkage(1), 115, 80, 1),
    )
    return Machine("stick_and_bucket", links, cylinders, _signals(links, cylinders), 1.5 + 0j, 1500.0, 0.8, 0.0)
