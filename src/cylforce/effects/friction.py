"""Friction in the cylinder's own coordinate v = d(length)/dt (PHYSICS section 6): what the cylinder must push in
excess.

Each effect is a force law with one parameter per cylinder; the lever turns it into torque.
"""

from dataclasses import dataclass

import numpy as np

from cylforce.machine.effect import Halves, Parameter
from cylforce.machine.machine import Machine
from cylforce.machine.motion import Motion
from cylforce.words.estimate import Array


def direction(speed: Array, rounding: float) -> Array:
    """sgn(v), rounded as tanh(v / rounding) so that noise at rest averages out; `rounding` in m/s."""
    return np.asarray(np.tanh(speed / rounding))


def _columns(law: Array, lever: Array) -> Halves:
    """Force laws (..., C) on levers (..., C, N) as columns (..., N, C)."""
    return Halves(None, np.swapaxes(law[..., None] * lever, -1, -2))


@dataclass(frozen=True, slots=True)
class Coulomb:
    """f_c sgn(v) (paper (8))."""

    rounding: float

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """f_c [N] of every cylinder."""
        return tuple(Parameter(f"{c.name}.coulomb", "N") for c in machine.cylinders)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Columns (..., N, C)."""
        return _columns(direction(moving.speed, self.rounding), moving.lever)


@dataclass(frozen=True, slots=True)
class Viscous:
    """f_v v (paper (8))."""

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """f_v [N s/m] of every cylinder."""
        return tuple(Parameter(f"{c.name}.viscous", "N s/m") for c in machine.cylinders)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Columns (..., N, C)."""
        return _columns(moving.speed, moving.lever)


@dataclass(frozen=True, slots=True)
class LoadDependent:
    """a |F| sgn(v): friction that grows with the force of the cylinder."""

    rounding: float

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """a [1] of every cylinder."""
        return tuple(Parameter(f"{c.name}.load_dependent", "1") for c in machine.cylinders)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Columns (..., N, C)."""
        return _columns(np.abs(moving.force) * direction(moving.speed, self.rounding), moving.lever)


@dataclass(frozen=True, slots=True)
class Stribeck:
    """f_s exp(-(v/v_s)^2) sgn(v): the extra force of break-away, gone above the speed `width` = v_s [m/s]."""

    rounding: float
    width: float

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """f_s [N] of every cylinder."""
        return tuple(Parameter(f"{c.name}.stribeck", "N") for c in machine.cylinders)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Columns (..., N, C)."""
        fading = np.exp(-((moving.speed / self.width) ** 2))
        return _columns(fading * direction(moving.speed, self.rounding), moving.lever)


@dataclass(frozen=True, slots=True)
class Directional:
    """f_d |sgn(v)|: what friction has in excess when the cylinder extends and lacks when it retracts; a zero error of
    the pressures looks the same in motion."""

    rounding: float

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """f_d [N] of every cylinder."""
        return tuple(Parameter(f"{c.name}.directional", "N") for c in machine.cylinders)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Columns (..., N, C)."""
        return _columns(np.abs(direction(moving.speed, self.rounding)), moving.lever)


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
        unknown = 1.0 - np.abs(direction(moving.speed, self.rounding))
        return _columns(unknown, np.abs(moving.lever))
