"""Weight of the bars of a four-bar linkage: rocker, connecting link and rod end, which belong to no link of the arm."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.effect import Halves, Parameter
from cylforce.mechanics.linkages import FourBar
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion


@dataclass(frozen=True, slots=True)
class RockerWeight:
    """Torque dV/d(theta) of the potential energy V = w g sin(angle of the rocker from the horizontal); w: first moment
    of the rocker, and of what hangs at its end, about its pin. The three parameters per link absorb what turns with
    neither of them in the mean only (mechanics/README.md, section 3, limit), and leave an error on another slope. The
    inertia of the bars is neglected."""

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """The first moment w [kg m] of every four-bar linkage."""
        return tuple(Parameter(f"{c.name}.rocker", "kg m") for c in machine.cylinders if isinstance(c.linkage, FourBar))

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Static columns (..., N, K) of K four-bar linkages; zero where a linkage cannot be closed."""
        at = machine.pose(np.diff(moving.a, axis=-1, prepend=0.0))
        turned = np.exp(1j * (moving.q[..., 0] - moving.a[..., 0]))[..., None]
        bars = [c.linkage.rocker(at) for c in machine.cylinders if isinstance(c.linkage, FourBar)]
        each = [(moving.g[..., None] * turned * bar).imag for bar in bars]
        return Halves(None, np.nan_to_num(np.stack(each, axis=-1), posinf=0.0, neginf=0.0))
