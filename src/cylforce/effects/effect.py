"""The protocol of an effect: its parameters and its columns, as simulation, regressor and diagnosis use them."""

from typing import NamedTuple, Protocol

from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array


class Parameter(NamedTuple):
    """Parameter of an effect.

    name: name of the link, cylinder or linkage and of the quantity, for example `stick.X`
    unit: its SI unit, for example "kg m"
    """

    name: str
    unit: str


class Halves(NamedTuple):
    """Columns (..., N, P) of N joints and P parameters. Torque = d/dt(momentum @ value) + static @ value.

    It is the torque [N m] that the cylinders supply at each joint; value (P,) are the parameters.

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
        """Return the columns (..., N, P) along a motion (...), per unit of each parameter, in joint torques.

        Their two halves are momentum [N m s] and static torque [N m].
        """
        ...


def depends_on(effect: object) -> tuple[str, ...]:
    """Return the names of the fields of `Motion` on which an effect's columns depend.

    They are the `depends_on` of its class; without it all fields.
    """
    return tuple(getattr(effect, "depends_on", Motion._fields))
