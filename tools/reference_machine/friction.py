"""Friction in the cylinders and the pins, of the estimator's own form or of a foreign one.

`step` gives what opposes the motion in two parts: a force that depends smoothly on the state, and a dry limit that
MuJoCo's solver enforces (so that standing still is exact). Friction with bristles, such as LuGre's, needs no limit."""

from dataclasses import asdict, dataclass
from math import copysign, exp, sqrt
from typing import Protocol

import numpy as np

from .oil import WARM, thinning


class Friction(Protocol):
    """Friction of one cylinder."""

    def step(self, speed: float, oil: float, on_head: float, on_rod: float) -> tuple[float, float]:
        """(force that opposes extending, dry limit) [N] at a speed [m/s]; `oil`: net force of the pressures,
        `on_head`, `on_rod`: those of each side [N]."""
        ...

    def condition(self, kelvin: float, level: float) -> None:
        """The oil's temperature, and how much of the friction wear has left or added (1: as new)."""
        ...

    def numbers(self) -> dict[str, float]:
        """Its true parameters by name, SI units."""
        ...


@dataclass(slots=True)
class NoFriction:
    """No friction."""

    def step(self, speed: float, oil: float, on_head: float, on_rod: float) -> tuple[float, float]:
        """Nothing."""
        return 0.0, 0.0

    def condition(self, kelvin: float, level: float) -> None:
        """Nothing depends on it."""

    def numbers(self) -> dict[str, float]:
        """Nothing."""
        return {}


@dataclass(slots=True)
class OwnFriction:
    """f = (f_c + a |F|) sgn(v) + f_v v, f_c by direction; independent of temperature."""

    coulomb_extend: float
    coulomb_retract: float
    viscous: float
    load: float
    level: float = 1.0

    def step(self, speed: float, oil: float, on_head: float, on_rod: float) -> tuple[float, float]:
        """Viscous part and dry limit."""
        dry = (self.coulomb_extend if speed >= 0.0 else self.coulomb_retract) + self.load * abs(oil)
        return self.level * self.viscous * speed, self.level * dry

    def condition(self, kelvin: float, level: float) -> None:
        """Wear only."""
        self.level = level

    def numbers(self) -> dict[str, float]:
        """f_c both ways, f_v, a."""
        return {name: value for name, value in asdict(self).items() if name != "level"}


@dataclass(slots=True)
class LuGre:
    """LuGre's bristles under seals that the pressures load: dz/dt = v - s0 |v| z / g(v),
    f = s0 z + s1 dz/dt exp(-(v/v_d)^2) + s2 v, g = f_k (1 + (r - 1) exp(-|v/v_s|^d)),
    f_k = (f_c +- half the difference) (nu/nu_40)^m + c_h p_h A_h + c_r p_r A_r, s2 ~ (nu/nu_40)^n.

    dz/dt is integrated exactly at constant v and g over the step."""

    coulomb: float  # f_c [N]
    difference: float  # extending against retracting [N]
    rise: float  # r
    stribeck_speed: float
    stribeck_exponent: float
    viscous: float
    seal_head: float
    seal_rod: float
    stiffness: float
    damping: float
    fading_speed: float
    dry_thinning: float
    viscous_thinning: float
    dt: float
    bristle: float = 0.0
    dry_factor: float = 1.0
    viscous_factor: float = 1.0
    level: float = 1.0

    def step(self, speed: float, oil: float, on_head: float, on_rod: float) -> tuple[float, float]:
        """The bristles' force; no dry limit."""
        fast = abs(speed)
        level = self.coulomb + (0.5 * self.difference if speed > 0.0 else -0.5 * self.difference)
        steady = level * self.dry_factor + self.seal_head * on_head + self.seal_rod * on_rod
        steady *= self.level * (
            1.0 + (self.rise - 1.0) * exp(-((fast / self.stribeck_speed) ** self.stribeck_exponent))
        )
        full = copysign(steady / self.stiffness, speed)
        before = self.bristle
        z = self.bristle = full + (before - full) * exp(-self.stiffness * fast * self.dt / steady)
        damped = self.damping * exp(-((speed / self.fading_speed) ** 2)) * (z - before) / self.dt
        return self.stiffness * z + damped + self.viscous * self.viscous_factor * speed, 0.0

    def condition(self, kelvin: float, level: float) -> None:
        """Thinner oil: less viscous friction, and a little less dry friction."""
        thin = thinning(kelvin)
        self.dry_factor, self.viscous_factor = thin**self.dry_thinning, level * thin**self.viscous_thinning
        self.level = level

    def numbers(self) -> dict[str, float]:
        """All figures of the law."""
        state = ("bristle", "dry_factor", "viscous_factor", "level", "dt")
        return {name: value for name, value in asdict(self).items() if name not in state}


@dataclass(slots=True)
class PinFriction:
    """Torque of a greased pin: mu r sqrt(F^2 + W^2) with Dahl's bristles in its angle, integrated exactly; F the
    cylinder's force, W what the pin carries besides [N]."""

    coefficient: float
    radius: float
    weight: float
    give: float  # rad
    dt: float
    bristle: float = 0.0
    torque: float = 0.0

    def step(self, rate: float, force: float) -> float:
        """Torque that opposes turning [N m]; also kept."""
        full = copysign(1.0, rate)
        z = self.bristle = full + (self.bristle - full) * exp(-abs(rate) * self.dt / self.give)
        self.torque = self.coefficient * self.radius * sqrt(force * force + self.weight * self.weight) * z
        return self.torque

    def numbers(self) -> dict[str, float]:
        """Figures of the law."""
        return {"coefficient": self.coefficient, "radius": self.radius, "weight": self.weight, "give": self.give}


# Half of typical figures to twice them lie within: lowest and highest f_c [N] and f_v [N s/m]
COULOMB = {"boom": (2200.0, 4000.0), "stick": (1500.0, 3200.0), "bucket": (1000.0, 2400.0)}
VISCOUS = {"boom": (8e3, 15e3), "stick": (5e3, 12e3), "bucket": (3e3, 8e3)}
PIN_WEIGHT = {"boom": 40e3, "stick": 18e3, "bucket": 8e3}


def draw_friction(kind: str, joint: str, rng: np.random.Generator, dt: float) -> tuple[Friction, PinFriction | None]:
    """A cylinder's friction and its joint's pin friction. Raises ValueError for an unknown kind."""
    if kind == "none":
        return NoFriction(), None
    if kind == "own":
        level = float(rng.uniform(*COULOMB[joint]))
        return OwnFriction(level, level, float(rng.uniform(*VISCOUS[joint])), float(rng.uniform(0.005, 0.02))), None
    if kind != "foreign":
        raise ValueError(f"friction is {kind!r}: choose own, foreign or none")
    return _foreign(joint, rng, dt)


def _foreign(joint: str, rng: np.random.Generator, dt: float) -> tuple[Friction, PinFriction]:
    coulomb = 0.7 * float(rng.uniform(*COULOMB[joint]))
    presliding = float(rng.uniform(1e-4, 3e-4))
    seals = LuGre(
        coulomb=coulomb,
        difference=coulomb * float(rng.uniform(-0.15, 0.15)),
        rise=float(rng.uniform(1.15, 1.5)),
        stribeck_speed=float(rng.uniform(0.006, 0.03)),
        stribeck_exponent=float(rng.uniform(0.8, 1.6)),
        viscous=0.8 * float(rng.uniform(*VISCOUS[joint])),
        seal_head=float(rng.uniform(0.003, 0.008)),
        seal_rod=float(rng.uniform(0.004, 0.010)),
        stiffness=coulomb / presliding,
        damping=6e4,
        fading_speed=0.02,
        dry_thinning=float(rng.uniform(0.08, 0.20)),
        viscous_thinning=float(rng.uniform(0.45, 0.75)),
        dt=dt,
    )
    seals.condition(WARM, 1.0)
    pins = PinFriction(float(rng.uniform(0.05, 0.11)), 0.045, PIN_WEIGHT[joint], float(rng.uniform(3e-4, 9e-4)), dt)
    return seals, pins
