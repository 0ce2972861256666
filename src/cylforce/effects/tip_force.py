"""Force of the outside world on the tool: r = -(dP/dq)^T F (PHYSICS section 8)."""

from dataclasses import dataclass

import numpy as np

from cylforce.machine.effect import Halves, Parameter
from cylforce.machine.machine import Machine
from cylforce.machine.motion import Motion


@dataclass(frozen=True, slots=True)
class TipForce:
    """A force (x forward, z up, true vertical) at the tooth line and a moment [N m] on the last link."""

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """x, z [N] and moment [N m]."""
        return (Parameter("tip.x", "N"), Parameter("tip.z", "N"), Parameter("tip.moment", "N m"))

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Columns (..., N, 3): the torque that the cylinders supply against each."""
        # links seen from the true horizontal; the vector from joint j to the tool is the sum of what lies beyond
        beyond = (np.exp(1j * moving.q) * machine.arms) @ machine.sum_outward.T
        columns = np.empty((*beyond.shape, 3))
        columns[..., 0], columns[..., 1], columns[..., 2] = beyond.imag, -beyond.real, -1.0
        return Halves(None, columns)
