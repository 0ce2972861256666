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
        arms = np.exp(1j * moving.q) * np.append(machine.lengths[:-1], machine.tool)
        beyond = np.cumsum(arms[..., ::-1], axis=-1)[..., ::-1]
        moment = -np.ones_like(beyond.real)
        return Halves(None, np.stack([beyond.imag, -beyond.real, moment], axis=-1))
