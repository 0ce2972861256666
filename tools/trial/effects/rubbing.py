"""Effects of friction on the reference machine, in forms of their own."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from math import copysign, exp, sqrt

from reference_machine.datasheet import JOINTS
from reference_machine.engine import DT
from reference_machine.friction import Friction, LuGre, OwnFriction
from reference_machine.machine import Machine
from reference_machine.oil import WARM, viscosity

from .fault import Draw, Fault, Scene, Stretch

BODY_WARMS = (4.0, 16.0)  # the oil in the cylinder warms so much faster than the sensors' housings
LEAST = 0.85  # of a direction's friction that its loss of symmetry may take


@dataclass(slots=True)
class Law:
    """A friction law that changes another one."""

    inner: Friction

    def step(self, speed: float, oil: float, on_head: float, on_rod: float) -> tuple[float, float]:
        """As `Friction.step`."""
        return self.inner.step(speed, oil, on_head, on_rod)

    def condition(self, kelvin: float, level: float) -> None:
        """As `Friction.condition`."""
        self.inner.condition(kelvin, level)

    def numbers(self) -> dict[str, float]:
        """Of the inner law."""
        return self.inner.numbers()


@dataclass(slots=True)
class Stribeck(Law):
    """A dry limit that falls with speed: peak exp(-(v/v_s)^n), or peak/(1 + (v/v_s)^n)."""

    peak: float
    falls: float
    exponent: float
    rational: bool

    def step(self, speed: float, oil: float, on_head: float, on_rod: float) -> tuple[float, float]:
        """More dry friction near rest."""
        smooth, dry = self.inner.step(speed, oil, on_head, on_rod)
        x = (abs(speed) / self.falls) ** self.exponent
        return smooth, dry + self.peak * (1.0 / (1.0 + x) if self.rational else exp(-x))


@dataclass(slots=True)
class Loaded(Law):
    """A dry limit that grows with the load and saturates: a |F| / sqrt(1 + (F/knee)^2)."""

    share: float
    knee: float

    def step(self, speed: float, oil: float, on_head: float, on_rod: float) -> tuple[float, float]:
        """More dry friction under load."""
        smooth, dry = self.inner.step(speed, oil, on_head, on_rod)
        return smooth, dry + self.share * abs(oil) / sqrt(1.0 + (oil / self.knee) ** 2)


@dataclass(slots=True)
class Lopsided(Law):
    """All dry friction, load-dependent friction included, larger in one direction by a `part` of the share, and smaller
    in the other by the rest."""

    share: float
    part: float

    def step(self, speed: float, oil: float, on_head: float, on_rod: float) -> tuple[float, float]:
        """By direction."""
        smooth, dry = self.inner.step(speed, oil, on_head, on_rod)
        return smooth, dry * (1.0 + self.share * (self.part if speed > 0.0 else self.part - 1.0))


@dataclass(slots=True)
class Warming(Law):
    """Friction that follows a power of the oil's viscosity while the oil warms from 40 degC."""

    power: float
    faster: float

    def condition(self, kelvin: float, level: float) -> None:
        """The oil in this cylinder."""
        here = WARM + self.faster * (kelvin - WARM)
        self.inner.condition(kelvin, level * (viscosity(here) / viscosity(WARM)) ** self.power)


@dataclass(slots=True)
class Bristled(Law):
    """Dry friction that builds up over two displacements, like that of bristles of two lengths."""

    give: float
    near: float
    weight: float
    short: float = 0.0
    long: float = 0.0

    def step(self, speed: float, oil: float, on_head: float, on_rod: float) -> tuple[float, float]:
        """No dry limit is left."""
        smooth, dry = self.inner.step(speed, oil, on_head, on_rod)
        way, path = copysign(1.0, speed), abs(speed) * DT
        self.short = way + (self.short - way) * exp(-path / (self.near * self.give))
        self.long = way + (self.long - way) * exp(-path / ((2.6 - self.near) * self.give))
        return smooth + dry * (self.weight * self.short + (1.0 - self.weight) * self.long), 0.0


def _core(law: Friction) -> OwnFriction | LuGre:
    while isinstance(law, Law):
        law = law.inner
    if not isinstance(law, OwnFriction | LuGre):
        raise TypeError("a machine without friction has none that could change")
    return law


def scaled(law: Friction, factors: dict[str, float]) -> Friction:
    """The law with some parameters of its innermost law multiplied."""
    if isinstance(law, Law):
        return replace(law, inner=scaled(law.inner, factors))
    if not isinstance(law, OwnFriction | LuGre):
        raise TypeError("a machine without friction has none that could change")
    known = {f.name for f in fields(law)} & set(factors)
    return replace(law, **{name: getattr(law, name) * factors[name] for name in known})


def coulomb(machine: Machine, joint: str) -> float:
    """The level of a cylinder's dry friction [N]."""
    law = _core(machine.friction[JOINTS.index(joint)])
    return law.coulomb if isinstance(law, LuGre) else 0.5 * (law.coulomb_extend + law.coulomb_retract)


def with_law(machine: Machine, joint: str, law: Friction) -> Machine:
    """The machine with another friction in one cylinder."""
    return replace(
        machine, friction=tuple(law if j == joint else f for j, f in zip(JOINTS, machine.friction, strict=True))
    )


def _law(machine: Machine, joint: str) -> Friction:
    return machine.friction[JOINTS.index(joint)]


def stribeck(draw: Draw, scene: Scene) -> Fault:
    """Break-away 0.3-1.5 of Coulomb more, falling within 4-60 mm/s."""
    at, rational = draw.one(JOINTS), draw.uniform(0.0, 1.0) < 0.5
    peak, falls = draw.size(0.3, 1.5), draw.shape(4e-3, 6e-2)
    exponent = draw.uniform(1.0, 4.0) if rational else draw.uniform(0.5, 2.2)

    def apply(machine: Machine, _: Stretch) -> Machine:
        extra = peak * coulomb(machine, at)
        return with_law(machine, at, Stribeck(_law(machine, at), extra, falls, exponent, rational))

    return Fault("stribeck", at, peak, "of Coulomb", apply, "rational" if rational else "exponential")


def load_dependent(draw: Draw, scene: Scene) -> Fault:
    """0.5-6 % of the force."""
    at, share = draw.one(JOINTS), draw.size(0.005, 0.06)
    knee = {"boom": 300e3, "stick": 120e3, "bucket": 60e3}[at] * draw.shape(0.3, 5.0)

    def apply(machine: Machine, _: Stretch) -> Machine:
        return with_law(machine, at, Loaded(_law(machine, at), share, knee))

    return Fault("load_dependent_friction", at, share, "of force", apply, "saturating")


def asymmetric(draw: Draw, scene: Scene) -> Fault:
    """10-60 % difference between the two directions: of both, or of one alone."""
    at, share = draw.one(JOINTS), draw.signed(0.1, 0.6)
    drop = min(draw.portion(), LEAST / abs(share))
    part = drop if share < 0.0 else 1.0 - drop

    def apply(machine: Machine, _: Stretch) -> Machine:
        law = _law(machine, at)
        core = _core(law)
        if isinstance(core, LuGre):
            if core.difference == 0.0:
                return with_law(machine, at, law)
            apart, both = 1.0 + share * core.coulomb / core.difference, 1.0 + share * (part - 0.5)
            return with_law(machine, at, scaled(law, {"coulomb": both, "difference": apart}))
        return with_law(machine, at, Lopsided(law, share, part))

    return Fault("asymmetric_friction", at, share, "of dry friction", apply, f"{drop:.0%} less in one direction")


def temperature_drift(draw: Draw, scene: Scene) -> Fault:
    """exp(-b (T - T0)) with b = 0.015-0.05/K near 50 degC, as the viscosity has it."""
    at, slope, faster = draw.one(JOINTS), draw.size(0.015, 0.05), draw.shape(*BODY_WARMS)

    def apply(machine: Machine, _: Stretch) -> Machine:
        return with_law(machine, at, Warming(_law(machine, at), slope / 0.038, faster))

    return Fault("friction_temperature_drift", at, slope, "1/K", apply, "viscosity")


def presliding(draw: Draw, scene: Scene) -> Fault:
    """0.2-4 mm until friction is built up."""
    at, give = draw.one(JOINTS), draw.size(0.2e-3, 4e-3)
    near, weight = draw.uniform(0.3, 1.3), draw.uniform(0.3, 1.0)

    def apply(machine: Machine, _: Stretch) -> Machine:
        law = _law(machine, at)
        core = _core(law)
        if isinstance(core, LuGre):
            softer = 1.0 / (1.0 + give * core.stiffness / core.coulomb)
            return with_law(machine, at, scaled(law, {"stiffness": softer}))
        return with_law(machine, at, Bristled(law, give, near, weight))

    return Fault("presliding_hysteresis", at, give, "m", apply, "bristles")


def level_change(draw: Draw, scene: Scene) -> Fault:
    """All friction of a cylinder 25-100 % more, or less by the same factor."""
    at, rise = draw.one(JOINTS), draw.size(0.25, 1.0)
    factor = 1.0 + rise if draw.uniform(0.0, 1.0) < 0.5 else 1.0 / (1.0 + rise)

    def apply(machine: Machine, _: Stretch) -> Machine:
        dry = ("coulomb", "difference", "coulomb_extend", "coulomb_retract", "load", "seal_head", "seal_rod")
        law = scaled(_law(machine, at), dict.fromkeys((*dry, "viscous", "stiffness", "damping"), factor))
        k = JOINTS.index(at)
        pin = machine.pins[k]
        pins = list(machine.pins)
        if pin is not None:
            pins[k] = replace(pin, coefficient=pin.coefficient * factor)
        return replace(with_law(machine, at, law), pins=tuple(pins))

    return Fault("friction_level_change", at, factor - 1.0, "of friction", apply)


def _part(name: str, parts: tuple[str, ...]) -> Callable[[Draw, Scene], Fault]:
    def make(draw: Draw, scene: Scene) -> Fault:
        """A part of friction 30-150 % more, or less by the same factor."""
        at, rise = draw.one(JOINTS), draw.size(0.3, 1.5)
        factor = 1.0 + rise if draw.uniform(0.0, 1.0) < 0.6 else 1.0 / (1.0 + rise)

        def apply(machine: Machine, _: Stretch) -> Machine:
            return with_law(machine, at, scaled(_law(machine, at), dict.fromkeys(parts, factor)))

        return Fault(name, at, factor - 1.0, "of that part", apply)

    return make


coulomb_change = _part("coulomb_friction", ("coulomb", "difference", "coulomb_extend", "coulomb_retract", "stiffness"))
viscous_change = _part("viscous_friction", ("viscous",))
