"""Pressure with which a counterbalance (load-holding) valve brakes a cylinder that lowers its load."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array

LEAST_FORCE = 1000.0  # N, force scale of the smooth sgn(F); chosen: far below the force of any arm at rest


@dataclass(frozen=True, slots=True)
class CounterbalancePressure:
    """Counterbalance valve that brakes a cylinder while it lowers its load, F v < 0, by a pressure outside the sensors.

    The additional force of the cylinder is sgn(F) f (1 - `relief` |F|), F its measured force (positive: it pushes). It
    is zero beyond |F| = 1 / `relief`, and while the cylinder lifts or rests.
    With f > 0 the pump must press on the other side to open the valve, and there is no sensor on that side. A heavy
    load opens it with less pilot pressure, (p_set - p_load) / ratio, which is the `relief`. With f < 0 the sensor on
    the loaded side lies beyond the valve.
    """

    relief: float = 0.0  # 1/N, inverse of the force that opens the valve without any pilot pressure; 0: constant
    rounding: float = 0.002  # m/s, speed scale of the smooth sgn(v)

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="counterbalance_pressure",
            unit="N",
            low=1000.0,  # 5 bar on 20 cm^2
            high=9e4,  # 60 bar on 150 cm^2
            place=Place.CYLINDER,
            shows="while the cylinder lowers its load, nothing while it lifts or rests",
            confirm="lower and lift the same load at one slow speed, with a gauge on either side of the valve",
            form=0.2,  # chosen: the pilot pressure oscillates, and depends on the flow
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Range of `relief`. Valves are set to open alone at 1.3 times the largest load: of small cylinders 50 kN."""
        return (ShapeRange("relief", 0.0, 2e-5, log=True, shift=2e-6),)

    def torque(self, machine: Machine, moving: Motion, t: Array, where: int) -> Array:
        """Return the torques (T, N) [N m] that cylinder `where` supplies in addition, per newton of f."""
        force = moving.force[:, where]
        sign = np.tanh(force / LEAST_FORCE)
        lowers = np.maximum(-sign * np.tanh(moving.speed[:, where] / self.rounding), 0.0)
        law = sign * lowers * np.maximum(1.0 - self.relief * np.abs(force), 0.0)
        return np.asarray(law[:, None] * moving.lever[:, where, :])
