"""The protocol of an effect: its parameters and its columns, as simulation, regressor and diagnosis use them."""

from typing import NamedTuple, Protocol

from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array


class Parameter(NamedTuple):
    """Parameter of an effect.

    name: for example `stick.X`
    unit: in SI units
    """

    name: str
    unit: str


class Halves(NamedTuple):
    """Columns (..., N, P) of N joints and P parameters. Torque = d/dt(momentum @ value) + static @ value.

    momentum: [N m s per unit of the parameter]; None for an effect without momentum
    static:   [N m per unit of the parameter]
    """

    momentum: Array | None
    static: Array


class Effect(Protocol):
    """One physical cause of force, linear in its parameters."""

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """Return the P parameters that the effect has on this machine."""
        ...

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Return the columns (..., N, P) of the parameters along a motion (...): torques [N m] per unit of each."""
        ...


def depends_on(effect: object) -> tuple[str, ...]:
    """Return the names of the motion's quantities on which an effect's columns depend.

    They are the `depends_on` of its class; without it all quantities.
    """
    return tuple(getattr(effect, "depends_on", Motion._fields))
