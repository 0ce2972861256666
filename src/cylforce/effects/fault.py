"""The shapes of an effect that may separate a machine from its model: what every one says of itself, and the few ways
in which it acts. The same method serves the simulated machine and the diagnosis."""

from enum import StrEnum
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from cylforce.effects.effect import Halves
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind


class Place(StrEnum):
    """Where an effect can sit."""

    CYLINDER = "cylinder"
    PRESSURE = "pressure sensor"
    ANGLE = "angle sensor"
    SENSOR = "sensor"
    LINK = "link"
    MACHINE = "machine"
    TOOL = "last link"


class About(NamedTuple):
    """What an effect says of itself: the `name` by which it is reported, `unit` (SI) of its size, the plausible range
    `low`..`high` of that size's magnitude, `sign` (1 or -1 where only one can be, else 0), `place`, in which regimes it
    `shows`, the experiment that would `confirm` it, how many of its sizes are the `axes` of that magnitude, whether
    every recording has sizes `of_its_own`, and how uncertain a size is, as a share of it, because the `form` is: the
    levers and areas that turn it into torque are never known better than to one percent."""

    name: str
    unit: str
    low: float
    high: float
    place: Place
    shows: str
    confirm: str
    sign: int = 0
    axes: int = 1
    of_its_own: bool = False
    form: float = 0.01


class Fault(Protocol):
    """Any effect of the library."""

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        ...


@runtime_checkable
class ForceLaw(Fault, Protocol):
    """A force in one cylinder's own coordinate."""

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """What the cylinder must push in excess (T,) per unit of size, at its speed (T,) [m/s] and force (T,) [N] and
        the time (T,) [s] since the recording's start."""
        ...


@runtime_checkable
class Distortion(Fault, Protocol):
    """An error of what is measured."""

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Values (T, S) of all signals as measured at t (T,) [s], from those without the error; `where` counts the
        places of its kind on the machine (see `places`)."""
        ...


@runtime_checkable
class Sudden(Distortion, Protocol):
    """An error that jumps, at instants that are known only roughly."""

    def jumps(self, machine: Machine, values: Array, where: int) -> NDArray[np.bool_]:
        """At which samples (T,) of the values (T, S) it may jump."""
        ...


@runtime_checkable
class Alteration(Fault, Protocol):
    """Another machine than the machine file says."""

    def altered(self, machine: Machine, where: int, size: float) -> Machine:
        """The machine with the error; where it has no such part, the machine itself."""
        ...


@runtime_checkable
class MassChange(Fault, Protocol):
    """Masses that differ: a change of base parameters."""

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the M sizes of which it consists, the first that of the size proper."""
        ...

    @property
    def usual(self) -> tuple[float, ...]:
        """Usual values of those sizes."""
        ...

    def change(self, machine: Machine, where: int) -> Array:
        """(3N, M) change of (J, X, Z) of all links per unit of each size."""
        ...


@runtime_checkable
class Share(Fault, Protocol):
    """Known friction of a cylinder that changes as a whole."""

    @property
    def laws(self) -> tuple[str, ...]:
        """Names of the friction laws whose known sizes are multiplied by 1 + size course(t)."""
        ...

    def course(self, t: Array) -> Array:
        """How the change goes with the time t (T,) [s] since the field's start."""
        ...


@runtime_checkable
class PartOfFriction(Fault, Protocol):
    """A force that is no more than a part of a cylinder's dry friction."""

    @property
    def of_dry(self) -> float:
        """The largest plausible part."""
        ...


@runtime_checkable
class BaseMotion(Fault, Protocol):
    """What carries the first link moves, and the model takes it to stand still."""

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the M sizes of which it consists, the first that of the size proper."""
        ...

    @property
    def usual(self) -> tuple[float, ...]:
        """Usual values of those sizes."""
        ...

    def halves(self, machine: Machine, moving: Motion, turning: Array, base: Array) -> Halves:
        """Columns (..., N, M) along a motion whose rates lack that of the chassis in the arm's plane, `turning` (...,)
        [rad/s], for links whose (J, X, Z) are `base` (..., N, 3)."""
        ...


class TimeCourse(StrEnum):
    """How the sizes of an incident go with time."""

    WINDOWS = "some stretches, each with sizes of its own"
    AFTER = "nothing before an instant, the same after it"
    CLOCK = "after an instant, or in proportion to time"


@runtime_checkable
class Incident(Fault, Protocol):
    """Something that happens at a time, which the diagnosis has to find."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns whose sizes change (see `INCIDENTAL`)."""
        ...

    @property
    def course(self) -> TimeCourse:
        """How these sizes change with time."""
        ...


# Columns of incidents: what hangs in the bucket besides, a force at the teeth and the unit square of the slew rate with
# the course of a polynomial in each block, a second by which all pressures come late.
SHAPES = 6  # Legendre's polynomials: level, slope, bend, ..., each of mean square one over the block
INCIDENTAL = (
    *("load.mass", "load.X", "load.Z", "load.J", "clock"),
    *(f"{name}.{k}" for k in range(SHAPES) for name in ("tip.x", "tip.z", "slew")),
)
TORQUES = tuple(f"torque.{k}" for k in range(SHAPES))  # the same of a torque, once for every measured joint
ANGLES = (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION, Kind.CYLINDER_LENGTH)
PRESSURES = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE, Kind.FORCE_PIN)


def places(machine: Machine, place: Place) -> tuple[tuple[str, int], ...]:
    """(name, number) of every place of a kind: number of the cylinder, the signal or the link; 0 for the machine."""
    if place in (Place.PRESSURE, Place.ANGLE, Place.SENSOR):
        kinds = {Place.PRESSURE: PRESSURES, Place.ANGLE: ANGLES, Place.SENSOR: PRESSURES + ANGLES}[place]
        return tuple((s.name, k) for k, s in enumerate(machine.signals) if s.kind in kinds)
    if place is Place.CYLINDER:
        return tuple((c.name, k) for k, c in enumerate(machine.cylinders) if machine.forces_measured[k])
    if place is Place.LINK:
        return tuple((machine.links[j].name, j) for j in machine.rows)
    return (("machine", 0),) if place is Place.MACHINE else ((machine.links[-1].name, machine.size - 1),)
