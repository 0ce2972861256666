"""Friction of all cylinders at once, as columns of the model: any law (mechanics/README.md, section 6), and the unknown
friction at rest."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.effect import Halves, Parameter, depends_on
from cylforce.effects.fault import ForceLaw
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array

NEVER = np.zeros(())  # s: the time argument, which the laws of a model do not use


def _columns(law: Array, lever: Array) -> Halves:
    """Return the static columns (..., N, C) [N m per unit] of a force law with these forces per unit.

    law:   (..., C) forces of the cylinders per unit of their coefficients
    lever: (..., C, N) levers [m/rad]
    """
    return Halves(None, (law[..., None] * lever).swapaxes(-1, -2))


@dataclass(frozen=True, slots=True)
class Friction:
    """Force law with one coefficient per cylinder, `<cylinder>.<name>`, in the unit of the law.

    name: name of the coefficient, such as "coulomb"
    law:  the law; it may depend on speed and force at the same instant only, not on time or history
    """

    name: str
    law: ForceLaw

    @property
    def depends_on(self) -> tuple[str, ...]:
        """Names of the fields of `Motion` on which the columns depend."""
        return depends_on(self.law)

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """Return the parameters: the coefficient of each of C cylinders."""
        return tuple(Parameter(f"{c.name}.{self.name}", self.law.about.unit) for c in machine.cylinders)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Return the static columns (..., N, C) [N m per unit]: the law's force per unit times the lever [m/rad]."""
        return _columns(self.law.force(moving.speed, moving.force, NEVER), moving.lever)


@dataclass(frozen=True, slots=True)
class AtRest:
    """Friction of a cylinder at rest, which is anything between -f_c and f_c.

    One column per cylinder, |lever| (1 - |sgn(v)|): not a force law, but the share of the Coulomb friction whose
    direction is unknown, times the lever. sgn(v) is rounded as tanh(v / rounding) [m/s].
    """

    rounding: float  # m/s, speed scale of the smooth sgn(v)

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """Return the parameters: dry friction f_c [N] of each of C cylinders, of unknown direction at rest."""
        return tuple(Parameter(f"{c.name}.at_rest", "N") for c in machine.cylinders)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Return the static columns (..., N, C) [N m per N of f_c], never negative: |lever| at rest, 0 in motion."""
        unknown = 1.0 - np.abs(np.tanh(moving.speed / self.rounding))
        return _columns(unknown, np.abs(moving.lever))
