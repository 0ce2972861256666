"""The protocol of an effect: its parameters and its columns, as simulation, regressor and diagnosis use them."""

from typing import NamedTuple, Protocol

from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array


class Parameter(NamedTuple):
    """Name (for example `stick.X`) and SI unit of one parameter."""

    name: str
    unit: str


class Halves(NamedTuple):
    """Columns (..., N, P) of N joints and P parameters: `static` [N m per unit of the parameter], `momentum` [N m s per
    unit of the parameter], None for an effect without momentum. Torque = d/dt(momentum @ value) + static @ value."""

    momentum: Array | None
    static: Array


class Effect(Protocol):
    """One physical cause of force, linear in its parameters."""

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """The P parameters that the effect has on this machine."""
        ...

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Columns of the parameters along a motion."""
        ...


def depends_on(effect: object) -> tuple[str, ...]:
    """Names of the quantities of a motion that an effect's columns depend on: what its class names as `depends_on`, or
    any."""
    return tuple(getattr(effect, "depends_on", Motion._fields))
