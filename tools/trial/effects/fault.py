"""What is wrong with a machine in the field: an effect with its place and size, and how it enters the reference
machine."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from reference_machine.arm import GRAVITY
from reference_machine.datasheet import JOINTS
from reference_machine.geometry import Geometry
from reference_machine.machine import Machine
from reference_machine.sensors import Distortion
from reference_machine.specimen import Specimen

Array = NDArray[np.float64]
DEGREE = np.pi / 180.0
BAR = 1e5
TYPICAL_TORQUE = {"boom": 200e3, "stick": 50e3, "bucket": 15e3}  # N m
NODES = 400
WIDER = 3.0


@dataclass(frozen=True)
class Stretch:
    """A recording of the field: it begins `begin_s` after the first recording of the field, on a slope [rad], with a
    load [kg]."""

    name: str
    begin_s: float
    duration_s: float
    pitch: float
    roll: float
    payload_kg: float = 0.0


Apply = Callable[[Machine, Stretch], Machine]


@dataclass(frozen=True)
class Fault:
    """An effect `name` at a place of the machine file, `size` in `unit`; `form` says which of its forms it took."""

    name: str
    at: str
    size: float
    unit: str
    apply: Apply
    form: str = ""

    def label(self) -> dict[str, object]:
        """For the sealed label."""
        return {"name": self.name, "at": self.at, "size": self.size, "unit": self.unit, "form": self.form}


@dataclass(frozen=True)
class Scene:
    """What a fault may be fitted to: the clean machine, the field's recordings, and for each of them the lengths (T,)
    that the boom's cylinders would take if it did not stand still."""

    machine: Machine
    stretches: tuple[Stretch, ...]
    booms: dict[str, Array] = field(default_factory=dict)


@dataclass
class Draw:
    """Random choices; with `share`, sizes are that share of a typical one (the geometric mean of the range).

    The ranges of the effects are the usual ones; sizes are drawn from ranges whose ends are WIDER times as far apart,
    so that some are hardly visible and some larger than usual."""

    rng: np.random.Generator
    share: float | None = None

    def size(self, low: float, high: float) -> float:
        """From sqrt(WIDER) below low to as much above high, uniform in the logarithm."""
        ends = np.log((low / np.sqrt(WIDER), high * np.sqrt(WIDER)))
        drawn = float(np.exp(self.rng.uniform(*ends)))
        return drawn if self.share is None else self.share * float(np.sqrt(low * high))

    def signed(self, low: float, high: float) -> float:
        """The same with a random sign."""
        return self.size(low, high) * float(self.rng.choice((-1.0, 1.0)))

    def uniform(self, low: float, high: float) -> float:
        """Between low and high, uniform; for what is not a size."""
        return float(self.rng.uniform(low, high))

    def shape(self, low: float, high: float) -> float:
        """Between low and high, uniform in the logarithm; for the parameters of a form, which are no sizes."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def portion(self) -> float:
        """Of a whole: nothing, half, all of it, or anything between."""
        return (0.0, 0.5, 1.0, self.uniform(0.0, 1.0))[int(self.rng.integers(4))]

    def one(self, names: "tuple[str, ...]") -> str:
        """One of several."""
        return str(self.rng.choice(names))

    def ray(self) -> Array:
        """A direction in the arm's plane (2,)."""
        angle = self.rng.uniform(0.0, 2.0 * np.pi)
        return np.array([np.cos(angle), np.sin(angle)])


def on_sensors(machine: Machine, effect: Distortion, *, digital: bool = False) -> Machine:
    """The machine with a further distortion of its signals."""
    s = machine.sensors
    changed = replace(s, digital=(*s.digital, effect)) if digital else replace(s, analog=(*s.analog, effect))
    return replace(machine, sensors=changed)


def same_physics(one: Machine, other: Machine) -> bool:
    """Whether two machines differ in nothing but their sensors."""
    parts = ("specimen", "friction", "pins", "hydraulics", "extra", "edits")
    return all(getattr(one, part) is getattr(other, part) for part in parts)


def lever(specimen: Specimen, joint: str, angle: Array) -> Array:
    """d(length)/d(angle) (T,) of a joint's cylinder [m/rad]."""
    low, high = np.radians(specimen.sheet.links[joint].range_deg)
    grid, linkage = np.linspace(low - 0.05, high + 0.05, NODES), specimen.linkage(joint)
    return np.interp(angle, grid, [_slope(linkage, float(a)) for a in grid])


def _slope(linkage: object, angle: float) -> float:
    try:
        return float(linkage.span(angle)[1])  # type: ignore[attr-defined]
    except ValueError:  # beyond where the bars close
        return 0.0


def torque(specimen: Specimen, joint: str, truth: "dict[str, Array]") -> Array:
    """Torque (T,) of a cylinder's pressures about its joint [N m]."""
    head, rod = specimen.areas(joint)
    force = truth[f"{joint}_head_pressure"] * head - truth[f"{joint}_rod_pressure"] * rod
    return force * lever(specimen, joint, truth[f"{joint}_angle"])


def weight(specimen: Specimen, joint: str, truth: "dict[str, Array]", pitch: float) -> Array:
    """Torque (T,) about a joint of the weight of all that hangs on it [N m]: what a play there transmits, but for the
    inertia; the friction of the cylinder does not pass it."""
    turn, pin, found, at = np.exp(1j * pitch), 0.0, 0.0, 0.0
    for name in JOINTS:
        turn = turn * np.exp(1j * truth[f"{name}_angle"])
        at = pin if name == joint else at
        body = specimen.bodies[name]
        if JOINTS.index(name) >= JOINTS.index(joint):
            found = found + GRAVITY * body.mass * (pin + turn * complex(*body.centre) - at).real
        pin = pin + turn * specimen.lengths.get(name, 0.0)
    return np.asarray(found)


def speed(specimen: Specimen, joint: str, t: Array, truth: "dict[str, Array]") -> Array:
    """Speed (T,) of a cylinder [m/s]."""
    angle = truth[f"{joint}_angle"]
    return lever(specimen, joint, angle) * np.gradient(angle, t)


def stroke_range(specimen: Specimen) -> Array:
    """Angles (3, 2) [rad] of the working range of (boom, stick, bucket)."""
    geometry = Geometry(specimen)
    return np.sort(geometry.angles(geometry.working.T).T, axis=1)
