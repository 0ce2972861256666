"""Friction that grows with the cylinder's force, which presses on seals and pins."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class LoadDependentFriction:
    """Friction that grows with the cylinder force F: a |F| sgn(v), or, with `easing` e > 0, a sgn(v)
    (1 - exp(-e |F|)) / e, which saturates (mechanics/README.md, section 6).

    It is the additional force that the cylinder supplies, positive: it pushes; v > 0: it extends.
    """

    rounding: float = 0.002  # m/s, speed scale of the smooth sgn(v)
    easing: float = 0.0  # 1/N, the inverse of the force at which the friction begins to saturate; 0: it never does

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="load_dependent_friction",
            unit="1",
            low=0.004,
            high=0.08,
            place=Place.CYLINDER,
            shows="in motion, more under load",
            confirm="the same slow strokes empty and with a known load",
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Range of `easing`: from friction in proportion to the load to one that saturates at 50 kN."""
        return (ShapeRange("easing", 0.0, 2e-5, log=True, shift=2e-6),)

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """Return the force [N] per unit of a: |F| sgn(v), or (1 - exp(-e |F|)) / e sgn(v).

        It is shaped as speed v [m/s] and force F [N]. sgn(v) is rounded as tanh(v / rounding).
        """
        load = -np.expm1(-self.easing * np.abs(force)) / self.easing if self.easing else np.abs(force)
        return np.asarray(load * np.tanh(speed / self.rounding))
