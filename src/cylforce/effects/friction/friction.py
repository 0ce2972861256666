"""Friction of all cylinders at once, as columns of the model: any law (mechanics/README.md, section 6), and what
hides at rest."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.effect import Halves, Parameter
from cylforce.effects.fault import ForceLaw
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array

NEVER = np.zeros(())  # s: the laws of a model do not depend on time


def _columns(law: Array, lever: Array) -> Halves:
    """Force laws (..., C) on levers (..., C, N) as columns (..., N, C)."""
    return Halves(None, np.swapaxes(law[..., None] * lever, -1, -2))


@dataclass(frozen=True, slots=True)
class Friction:
    """A law that every cylinder has with a size of its own, called `name`; one that depends on the instant alone."""

    name: str
    law: ForceLaw

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """The size at every cylinder."""
        return tuple(Parameter(f"{c.name}.{self.name}", self.law.about.unit) for c in machine.cylinders)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Columns (..., N, C)."""
        return _columns(self.law.force(moving.speed, moving.force, NEVER), moving.lever)


@dataclass(frozen=True, slots=True)
class AtRest:
    """The friction of a cylinder that does not move: anything between -f_c and f_c, known to nobody. One column per
    cylinder, |lever| (1 - |sgn v|): not a force law, but how much of the Coulomb friction is unknown in a row."""

    rounding: float

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """The unknown share of f_c [N] of every cylinder."""
        return tuple(Parameter(f"{c.name}.at_rest", "N") for c in machine.cylinders)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Columns (..., N, C), never negative."""
        unknown = 1.0 - np.abs(np.tanh(moving.speed / self.rounding))
        return _columns(unknown, np.abs(moving.lever))
