"""What the teeth meet: a half-space with its surface at a height, and a known force that a scenario applies."""

from dataclasses import dataclass
from math import cos, hypot, sin, tanh


@dataclass(frozen=True, slots=True)
class Ground:
    """Soil or firm ground. Cutting resistance against the teeth's velocity: linear [N/m] and quadratic [N/m^2] in the
    depth, rough over the distance; support against depth [N/m]; grip: its friction against dragging."""

    height: float
    linear: float
    quadratic: float
    support: float
    grip: float
    roughness: float = 0.0


def soil(height: float, strength: float) -> Ground:
    """Soil to dig in: at 0.25 m about 25 kN times `strength`."""
    return Ground(height, 60e3 * strength, 150e3 * strength, 25e3 * strength, 0.3, 0.12)


def firm(height: float) -> Ground:
    """Ground that a bucket stands on."""
    return Ground(height, 0.0, 0.0, 9e5, 0.5)


SLOW = 0.04  # m/s of the teeth below which the soil's resistance fades


def contact(ground: Ground, x: float, z: float, vx: float, vz: float) -> tuple[float, float]:
    """Force (x, z) [N] on teeth at (x, z) [m] that move with (vx, vz) [m/s], all in the house's axes."""
    depth = ground.height - z
    if depth <= 0.0:
        return 0.0, 0.0
    rough = 1.0 + ground.roughness * (sin(9.0 * x) + 0.7 * sin(23.0 * x + 1.0) + 0.5 * cos(41.0 * x))
    cut = (ground.linear + ground.quadratic * depth) * depth * rough / (hypot(vx, vz) + SLOW)
    push = ground.support * depth * (1.0 - 0.5 * tanh(vz / SLOW))  # less when the teeth leave than when they press
    return -cut * vx - ground.grip * push * tanh(vx / SLOW), push - cut * vz
