"""A delay between posture and cylinder force: F(t) is processed with the posture of the time t - delay."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.effect import Halves, Parameter
from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class Delay:
    """Delay of the posture behind the force: to first order F(t) - F(t - delay) = delay dF/dt.

    On the empty machine a few milliseconds resemble viscous friction, but the error grows with the load. As a fault
    (`distorted`) it is the delay of one sensor.
    """

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """Return the parameters: the delay [s] of the posture behind the force of each of C cylinders."""
        return tuple(Parameter(f"{c.name}.delay", "s") for c in machine.cylinders)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Return the static columns (..., N, C) [N m per s of delay]: dF/dt times the lever."""
        return Halves(None, np.swapaxes(moving.force_rate[..., None] * moving.lever, -1, -2))

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="sensor_delay",
            unit="s",
            low=0.008,
            high=0.2,
            place=Place.SENSOR,
            shows="while the motion changes, nothing at constant speed",
            confirm="quick starts and stops of that joint alone",
            sign=1,
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with signal `where` delayed by `size` [s], linear between samples.

        Before the first sample the signal is taken as constant, with a negative size after the last one.

        t: (T,) time, ascending [s]
        """
        found = values.copy()
        found[:, where] = np.interp(t - size, t, values[:, where])
        return found
