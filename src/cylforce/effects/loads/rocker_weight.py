"""The weight of bars that neither link carries: rocker, link and rod end of a four-bar linkage."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.effect import Halves, Parameter
from cylforce.mechanics.linkages import FourBar
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion


@dataclass(frozen=True, slots=True)
class RockerWeight:
    """V = w g sin(angle of the rocker from the horizontal), torque dV/d(theta): w is the first moment about the
    rocker's pin of the rocker and of what hangs at its end. The three parameters per link absorb what turns with
    neither of them in the mean only (mechanics/README.md, section 3, limit), and otherwise on another slope. Its
    inertia is left out."""

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """One moment [kg m] per four-bar linkage."""
        return tuple(Parameter(f"{c.name}.rocker", "kg m") for c in machine.cylinders if isinstance(c.linkage, FourBar))

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Columns (..., N, K); zero where a linkage cannot be closed."""
        at = machine.pose(np.diff(moving.a, axis=-1, prepend=0.0))
        turned = np.exp(1j * (moving.q[..., 0] - moving.a[..., 0]))[..., None]
        bars = [c.linkage.rocker(at) for c in machine.cylinders if isinstance(c.linkage, FourBar)]
        each = [moving.g[..., None] * (turned * bar).imag for bar in bars]
        return Halves(None, np.nan_to_num(np.stack(each, axis=-1), posinf=0.0, neginf=0.0))
