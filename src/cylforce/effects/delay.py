"""Angles that arrive later than pressures: what was measured as F(t) belongs to the posture of t - delay."""

from dataclasses import dataclass

import numpy as np

from cylforce.machine.effect import Halves, Parameter
from cylforce.machine.machine import Machine
from cylforce.machine.motion import Motion


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
