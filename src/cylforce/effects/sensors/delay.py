"""Angles that arrive later than pressures: what was measured as F(t) belongs to the posture of t - delay."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.effect import Halves, Parameter
from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class Delay:
    """F(t) - F(t - delay) = delay dF/dt, to first order: a few milliseconds of lag look like viscous friction on the
    empty machine, but grow with the load."""

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """The delay [s] of the posture behind the force of every cylinder."""
        return tuple(Parameter(f"{c.name}.delay", "s") for c in machine.cylinders)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Columns (..., N, C)."""
        return Halves(None, np.swapaxes(moving.force_rate[..., None] * moving.lever, -1, -2))

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "sensor_delay",
            "s",
            0.008,
            0.2,
            Place.SENSOR,
            "while the motion changes, nothing at constant speed",
            "quick starts and stops of that joint alone",
            1,
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """a(t - size), along a line between samples."""
        found = values.copy()
        found[:, where] = np.interp(t - size, t, values[:, where])
        return found
