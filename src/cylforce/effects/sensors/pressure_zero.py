"""A zero error of a cylinder's pressures: a constant error of its force (mechanics/README.md, section 6)."""

from dataclasses import dataclass

from cylforce.effects.effect import Halves, Parameter
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion


@dataclass(frozen=True, slots=True)
class PressureZero:
    """A constant error f_0 [N] of each cylinder's measured force, from the zero errors of its pressure sensors."""

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """Return the parameters: f_0 [N] of each of C cylinders."""
        return tuple(Parameter(f"{c.name}.pressure_zero", "N") for c in machine.cylinders)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Return the static columns (..., N, C) [N m per N of f_0]: the levers [m/rad]."""
        return Halves(None, moving.lever.swapaxes(-1, -2))
