"""Protocols of the effects by which a machine may differ from its model: their description, and their ways of acting.

Simulated machine and diagnosis call the same methods.
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from enum import StrEnum
from math import exp, log
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from cylforce.effects.effect import Halves
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind


class Place(StrEnum):
    """Kind of location of an effect; `places` lists those of a machine.

    CYLINDER: a cylinder whose force is measured
    PRESSURE: a pressure sensor or force pin
    ANGLE:    an encoder, inclinometer or cylinder length sensor
    SENSOR:   one of either
    LINK:     a link, or its joint, whose torque is measured
    MACHINE:  the machine as a whole
    TOOL:     the last link
    """

    CYLINDER = "cylinder"
    PRESSURE = "pressure sensor"
    ANGLE = "angle sensor"
    SENSOR = "sensor"
    LINK = "link"
    MACHINE = "machine"
    TOOL = "last link"


class RunToRun(StrEnum):
    """How an effect varies on a healthy machine from one recording to the next.

    STATIC:     hardly, as geometry, masses and gains; the default
    VARYING:    by its nature: friction and the zeros of pressure sensors, which follow the temperature
    CREEP:      as friction at creep, whose law is the least certain
    EACH_START: with each start of the machine, as the phases of clocks: references of one start do not show it
    """

    STATIC = "static"
    VARYING = "varying"
    CREEP = "creep"
    EACH_START = "each start"


LAW_ERROR = 0.2  # of a torque: relative error of the law of most effects; chosen


class About(NamedTuple):
    """Description of an effect.

    name:    name in reports
    unit:    SI unit of its (first) size
    low:     least plausible magnitude, in that unit
    high:    largest plausible magnitude, in that unit
    place:   kind of its location
    shows:   regimes in which it is visible
    confirm: experiment that would confirm it
    sign:    1 or -1 where only that sign is possible, else 0
    axes:    number of its first sizes that are components of the magnitude, the length of their vector
    form:    relative standard error of a size because the law is only approximate; at least 0.01, the error of levers
             and areas, which turn the size into torque
    varies:  how it varies on a healthy machine from one recording to the next
    torque_error: relative error of its torque that the law leaves at the right size
    """

    name: str
    unit: str
    low: float
    high: float
    place: Place
    shows: str
    confirm: str
    sign: int = 0
    axes: int = 1
    form: float = 0.01
    varies: RunToRun = RunToRun.STATIC
    torque_error: float = LAW_ERROR


class ShapeRange(NamedTuple):
    """Plausible values of a continuous parameter of an effect's shape, among which a search refines the best one.

    field: name of the field of the effect's dataclass, a float
    low:   smallest plausible value, in the unit of the field
    high:  largest plausible value, in the same unit
    log:   equal steps of the search are equal ratios of (value + `shift`), not equal differences
    shift: added to the value before its logarithm, > 0 where `low` is zero
    """

    field: str
    low: float
    high: float
    log: bool = False
    shift: float = 0.0

    def position(self, value: float) -> float:
        """Return the position of a value (in the unit of `low`) between `low` (0) and `high` (1).

        Equal steps of the search are equal differences of the position.
        """
        if not self.log:
            return (value - self.low) / (self.high - self.low)
        whole = log((self.high + self.shift) / (self.low + self.shift))
        return log((value + self.shift) / (self.low + self.shift)) / whole

    def value(self, position: float) -> float:
        """Return the value, in the unit of `low`, at a position from 0 to 1; positions outside give the nearest end."""
        share = min(max(position, 0.0), 1.0)
        if not self.log:
            return self.low + share * (self.high - self.low)
        ratio = (self.high + self.shift) / (self.low + self.shift)
        found = (self.low + self.shift) * exp(share * log(ratio)) - self.shift
        return min(max(found, self.low), self.high)


ProtocolType: Any = type(Protocol)
_known: dict[tuple[type, type], bool] = {}


class Remembered(ProtocolType):  # type: ignore[misc] # its type is not public
    """Type of a protocol that checks each class once whether its objects follow it.

    `typing` checks every attribute of every object anew, which takes a tenth of the time of a diagnosis.
    """

    def __instancecheck__(cls, instance: object) -> bool:  # noqa: N805 - a metaclass
        """Return whether the object follows the protocol, from the first answer for its class."""
        pair = cls, type(instance)
        if pair not in _known:
            _known[pair] = super().__instancecheck__(instance)
        return _known[pair]


class Fault(Protocol, metaclass=Remembered):
    """Any effect of the library."""

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        ...


@runtime_checkable
class Shaped(Fault, Protocol):
    """An effect whose law has continuous parameters besides its size, such as a time constant or a width."""

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """The parameters that a search may refine, with their plausible ranges."""
        ...


@runtime_checkable
class ForceLaw(Fault, Protocol):
    """A force along one cylinder, which the cylinder must supply in addition and its sensors therefore measure.

    A friction force against the motion has the sign of the speed here: it makes the measured force larger while the
    cylinder extends.
    """

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """Return the additional force (T,) [N] that the cylinder supplies, per unit of size; positive: it pushes.

        speed: (T,) of the cylinder [m/s], positive: it extends
        force: (T,) of the cylinder [N], positive: it pushes
        t:     (T,) time since the start of the recording [s]
        """
        ...


@runtime_checkable
class JointLaw(Fault, Protocol):
    """A torque about the joints that depends on where and how fast the machine moves, and on its cylinders' forces
    (`moving.force`)."""

    def torque(self, machine: Machine, moving: Motion, t: Array, where: int) -> Array:
        """Return the additional torques (T, N) [N m] that the cylinders supply, per unit of size, along a motion.

        t:     (T,) time since the start of the recording [s]
        where: number (from 0) of the cylinder or link; 0 for the whole machine (see `places`)
        """
        ...


@runtime_checkable
class Distortion(Fault, Protocol):
    """An error of a sensor: it changes the measured values, not the machine."""

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the values (T, S) of all signals as measured with an error of `size`, a new array.

        The same object where the machine lacks the sensor that would read the error.

        values: (T, S) signals without the error [SI]
        t:      (T,) time since the start of the recording [s]
        where:  number (from 0) of the signal, link or cylinder with the error; 0 for the whole machine (see `places`)
        size:   of the error, in the unit of `about`
        """
        ...


@runtime_checkable
class Alteration(Fault, Protocol):
    """A geometry that differs from the machine file."""

    def altered(self, machine: Machine, where: int, size: float) -> Machine:
        """Return the machine with an error of `size`; the same object where the machine lacks the component.

        where: number (from 0) of the link (see `places`)
        size:  of the error, in the unit of `about`
        """
        ...


@runtime_checkable
class MassChange(Fault, Protocol):
    """Masses that differ from the data sheet: a change of base parameters."""

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the M sizes of which it consists; the first is the size that `About` describes."""
        ...

    @property
    def typical(self) -> tuple[float, ...]:
        """Typical values of those sizes, in their units: the scale of the diagnosis' prior."""
        ...

    def change(self, machine: Machine, where: int) -> Array:
        """Return the change (3N, M) of the links' base parameters per unit of each of the M sizes.

        The rows are J [kg m^2], X and Z [kg m] of the first of N links, then those of the second one, and so on.

        where: number (from 0) of the link
        """
        ...


@runtime_checkable
class GrowingMass(MassChange, Protocol):
    """Masses that come in the course of a recording, so slowly that they bring no momentum."""

    def grown(self, t: Array) -> Array:
        """Return the share (T,) of the sizes that is present at times t (T,) [s] since the start of the recording.

        It may exceed 1 after the time for which the sizes are stated.
        """
        ...


@runtime_checkable
class Share(Fault, Protocol):
    """The identified friction of a cylinder, or of all cylinders of the machine, changed as a whole by a factor."""

    @property
    def laws(self) -> tuple[str, ...]:
        """Names of the friction laws whose identified coefficients are multiplied by 1 + size course(t)."""
        ...

    def course(self, t: Array) -> Array:
        """Return the course (T,) of the change at times t (T,) [s] since the start of the recording.

        The friction is multiplied by 1 + size course(t).
        """
        ...


@runtime_checkable
class PartOfFriction(Fault, Protocol):
    """Change of a friction force, which is limited because no friction is less than none."""

    @property
    def of_dry(self) -> float:
        """Largest plausible magnitude of the size, as a multiple of the cylinder's dry friction (both [N])."""
        ...


@runtime_checkable
class BaseMotion(Fault, Protocol):
    """The body that carries the first link moves, but the model assumes that it stands still."""

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the M sizes of which it consists; the first is the size that `About` describes."""
        ...

    @property
    def typical(self) -> tuple[float, ...]:
        """Typical values of those sizes, in their units: the scale of the diagnosis' prior."""
        ...

    def halves(self, machine: Machine, moving: Motion, turning: Array, base: Array) -> Halves:
        """Return the columns (..., N, M) along a motion, per unit of each size, in joint torques.

        Their two halves are momentum [N m s] and static torque [N m].

        turning: (...,) rate of the chassis in the arm's plane [rad/s], which the rates of `moving` do not contain
        base:    (..., N, 3) base parameters (J, X, Z) of the links [kg m^2, kg m, kg m]
        """
        ...


class TimeCourse(StrEnum):
    """Course of the sizes of an incident over time.

    WINDOWS: sizes of their own in each of some blocks, none in the others
    AFTER:   none before an instant, the same sizes after it; changes of the load only
    CLOCK:   a delay of the pressures after an instant, or one that grows in proportion to time
    """

    WINDOWS = "some stretches, each with sizes of its own"
    AFTER = "nothing before an instant, the same after it"
    CLOCK = "after an instant, or in proportion to time"


@runtime_checkable
class Incident(Fault, Protocol):
    """An effect that is present from an instant on, or in single blocks, which the diagnosis has to find."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns whose sizes change: of `INCIDENTAL`; only the unknown torque has those of `TORQUES`."""
        ...

    @property
    def course(self) -> TimeCourse:
        """Course of the sizes over time."""
        ...


def acting(law: ForceLaw | JointLaw, machine: Machine, moving: Motion, t: Array, where: int) -> Array:
    """Return the torques (T, N) [N m] that the cylinders supply in addition, per unit of a law's size.

    t:     (T,) time since the start of the recording [s]
    where: number (from 0) of the cylinder of a force law; of the cylinder or link of a torque law, 0 for the whole
           machine (see `places`)
    """
    if isinstance(law, JointLaw):
        return law.torque(machine, moving, t, where)
    return np.asarray(law.force(moving.speed[:, where], moving.force[:, where], t)[:, None] * moving.lever[:, where, :])


def rubbing(share: Share, where: int, cylinders: int) -> range:
    """Return the numbers (from 0) of the cylinders whose friction a share changes: of one, or of all of the machine.

    where:     number of the cylinder, if the share acts on one
    cylinders: how many cylinders the machine has
    """
    return range(where, where + 1) if share.about.place is Place.CYLINDER else range(cylinders)


def shapes(group: tuple[Fault, ...]) -> tuple[ShapeRange, ...]:
    """Return the continuous shape parameters of a group of effects: those of its first effect; empty if it has none."""
    return group[0].shapes if isinstance(group[0], Shaped) else ()


def shaped(group: tuple[Fault, ...], values: Mapping[str, float]) -> tuple[Fault, ...]:
    """Return the group with other `values` of its fields, by name.

    The first effect takes all of them; the others take those in which all effects of the group were alike. A value is
    converted to the type that the field has in the first effect. Raises ValueError for a name that is no field of it.
    """
    if not values:
        return group
    first: Any = group[0]
    known = [f.name for f in fields(first)] if is_dataclass(first) else []
    wrong = [name for name in values if name not in known]
    if wrong:
        listed = ", ".join(known) or "it has none"
        raise ValueError(f"effect {first.about.name!r} has no parameter {wrong[0]!r} of its shape: {listed}")
    typed = {name: type(getattr(first, name))(value) for name, value in values.items()}
    alike = {n: v for n, v in typed.items() if all(getattr(e, n, None) == getattr(first, n) for e in group)}
    others: tuple[Any, ...] = group[1:]
    return (replace(first, **typed), *(replace(effect, **alike) for effect in others))


ABSENT = 1e-4  # share of a typical size that counts as none


def usual_sizes(effect: Fault) -> tuple[float, ...]:
    """Return the typical sizes of an effect's columns, the units in which the diagnosis computes sizes.

    An effect has one size: half its largest plausible magnitude, in the unit of `about`. Masses and motions of the base
    have several, and declare them (`typical`, in `units`).
    """
    if isinstance(effect, MassChange | BaseMotion):
        return effect.typical
    return (effect.about.high / 2.0,)


def unnoticed_sizes(effect: Fault) -> tuple[float, ...]:
    """Return the standard deviations of the sizes of an effect's columns among healthy machines, in their units.

    Sensors, linkages and laws of joint torque have the least plausible size, masses in proportion. Laws of cylinder
    force and shares of friction have their typical size, because the model's laws are approximate. A growing mass or a
    motion of the base is nearly absent.
    """
    if isinstance(effect, BaseMotion | GrowingMass):
        return tuple(ABSENT * size for size in effect.typical)
    if isinstance(effect, MassChange):
        return tuple(size * effect.about.low / effect.typical[0] for size in effect.typical)
    return (effect.about.low,) if isinstance(effect, Distortion | Alteration | JointLaw) else usual_sizes(effect)


BEYOND = 1.3  # times the largest plausible magnitude: what is larger is neither found nor simulated; convention
SHAPES = 6  # Legendre polynomials of degree 0 to 5, each of mean square one over the block; number chosen
# Columns of incidents by name, with their typical sizes [SI]: an additional load in the bucket, a delay of all
# pressures; over each block, with the course of each of SHAPES polynomials, a force at the teeth and a square of the
# slew rate.
ALL_ALONG = {"load.mass": 500.0, "load.X": 300.0, "load.Z": 300.0, "load.J": 600.0, "clock": 0.05}
OVER_BLOCKS = {"tip.x": 8e3, "tip.z": 8e3, "slew": 0.3}
INCIDENTAL = (*ALL_ALONG, *(f"{name}.{k}" for k in range(SHAPES) for name in OVER_BLOCKS))
TORQUES = tuple(f"torque.{k}" for k in range(SHAPES))  # the same for a torque, once for every measured joint
ANGLES = (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION, Kind.CYLINDER_LENGTH)
PRESSURES = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE, Kind.FORCE_PIN)


def places(machine: Machine, place: Place) -> tuple[tuple[str, int], ...]:
    """Return name and number of every location of a kind on the machine at which an effect could be found.

    The number (from 0) is that of the cylinder, signal or link; 0 for the machine as a whole. Cylinders whose force is
    not measured and links whose joint torque is not measured are left out.
    """
    if place in (Place.PRESSURE, Place.ANGLE, Place.SENSOR):
        kinds = {Place.PRESSURE: PRESSURES, Place.ANGLE: ANGLES, Place.SENSOR: PRESSURES + ANGLES}[place]
        return tuple((s.name, k) for k, s in enumerate(machine.signals) if s.kind in kinds)
    if place is Place.CYLINDER:
        return tuple((c.name, k) for k, c in enumerate(machine.cylinders) if machine.forces_measured[k])
    if place is Place.LINK:
        return tuple((machine.links[j].name, j) for j in machine.rows)
    return (("machine", 0),) if place is Place.MACHINE else ((machine.links[-1].name, machine.size - 1),)
