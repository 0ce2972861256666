"""The shape of an effect: what every cause of force offers to simulator, regressor and diagnosis."""

from typing import NamedTuple, Protocol

from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array


class Parameter(NamedTuple):
    """Name (e.g. `stick.X`) and SI unit of one parameter."""

    name: str
    unit: str


class Halves(NamedTuple):
    """Columns (..., N, P) [torque per parameter]; `momentum` is None where an effect has no momentum."""

    momentum: Array | None
    static: Array


class Effect(Protocol):
    """One physical cause of force."""

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """Its P parameters on this machine."""
        ...

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Its columns along a motion."""
        ...
