"""Additional friction near standstill (Stribeck effect)."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, RunToRun, ShapeRange
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class Stribeck:
    """Additional friction at low speed: force f exp(-(v / width)^2) sgn(v), gone above about twice `width` [m/s].

    It is the additional force that the cylinder supplies, positive: it pushes; v > 0: it extends.
    """

    width: float = 0.015  # m/s, speed at which it has fallen to 37 %
    rounding: float = 0.0005  # m/s, speed scale of the smooth sgn(v)

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="stribeck",
            unit="N",
            low=200.0,
            high=1e4,
            place=Place.CYLINDER,
            shows="below the speed `width`, gone above it",
            confirm="creep both ways at 3 to 30 mm/s",
            sign=1,
            form=0.2,  # chosen: the true width and shape differ from machine to machine
            varies=RunToRun.CREEP,
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Range of `width`: Stribeck speeds of oiled seals and bushes, 5 to 50 mm/s."""
        return (ShapeRange("width", 0.005, 0.05, log=True),)

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """Return the force [N] per newton of f, shaped as `speed` v [m/s]: exp(-(v / width)^2) sgn(v).

        sgn(v) is rounded as tanh(v / rounding).
        """
        fading = np.exp(-((speed / self.width) ** 2))
        return np.asarray(fading * np.tanh(speed / self.rounding))
