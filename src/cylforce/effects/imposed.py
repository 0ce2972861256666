"""Effects of the library switched on in the simulated machine: at a location, with sizes, for a time."""

from collections.abc import Mapping, Sequence
from math import hypot, inf
from typing import NamedTuple

import numpy as np

from cylforce.effects.fault import (
    BEYOND,
    PRESSURES,
    Alteration,
    BaseMotion,
    Distortion,
    Fault,
    ForceLaw,
    GrowingMass,
    Incident,
    JointLaw,
    MassChange,
    Share,
    TimeCourse,
    places,
    rubbing,
    shaped,
)
from cylforce.effects.library import LIBRARY, Group
from cylforce.effects.loads.carried import RAMP, CarriedLoad, smooth
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array

# Quantities that incidents change, with units: mass and first moments of the load in the last link's frame, force at
# the teeth, square of the slew rate, delay of all pressures.
CHANGED = {
    "load.mass": "kg",
    "load.X": "kg m",
    "load.Z": "kg m",
    "tip.x": "N",
    "tip.z": "N",
    "slew": "rad^2/s^2",
    "clock": "s",
}


class Imposed(NamedTuple):
    """Group of effects, switched on.

    group: the effects, which have one name and act at one location
    at:    name of the location
    where: number of the location (see `fault.places`)
    sizes: sizes of the group, in the `units` of the group (SI)
    begin: time of the run from which on they act [s]
    end:   time of the run at which they end [s]
    """

    group: Group
    at: str
    where: int
    sizes: tuple[float, ...]
    begin: float = 0.0
    end: float = inf

    def during(self, t: Array) -> Array:
        """Return 1 at the times t (T,) [s] at which the effect acts, else 0."""
        return np.where((t >= self.begin) & (t < self.end), 1.0, 0.0)

    def members(self) -> list[tuple[Fault, float]]:
        """Return the effects of the group, each with one size.

        A single effect with several sizes (masses, a moving base, incidents) comes with the first one only.
        """
        return list(zip(self.group, self.sizes, strict=False))


def imposed(
    machine: Machine,
    name: str,
    at: str,
    value: float | Sequence[float],
    *,
    shape: Mapping[str, float] | None = None,
    begin: float = 0.0,
    end: float = inf,
    library: tuple[Group, ...] = LIBRARY,
) -> Imposed:
    """Return the effect `name` of the library at the location `at` of the machine, from `begin` to `end` [s].

    at:      name of the location: of a sensor, cylinder or link, or "machine"
    value:   its size (SI), or a list where it has several (see `units`)
    shape:   values of the effect's own fields, such as a width, by name
    begin:   time of the run from which on it acts [s]
    end:     time of the run at which it ends [s]
    library: groups among which the name is searched for

    Raises ValueError, in one sentence, for an unknown name, location or field, a wrong number of sizes, an implausible
    size, an end before the begin, and a part that the machine lacks at that location.
    """
    group = shaped(_named(machine, name, at, library), shape or {})
    about = group[0].about
    where = dict(places(machine, about.place))
    if at not in where:
        known = ", ".join(where) or "none on this machine"
        raise ValueError(f"effect {name!r} sits at {at!r}, which is no {about.place}: choose one of {known}")
    sizes = tuple(map(float, value if isinstance(value, Sequence) else (value,)))
    found = Imposed(group, at, where[at], sizes, begin, end)
    _check(found)
    _check_part(machine, found)
    return found


def units(group: Group) -> tuple[str, ...]:
    """Return the units of all sizes of a group, in their order.

    A clock fault has two: the delay of the pressures at its begin [s] and its growth [s/s].
    """
    first = group[0]
    if isinstance(first, MassChange | BaseMotion):
        return first.units
    if isinstance(first, Incident):
        each = tuple(CHANGED[what] for what in _changed(first))
        return (*each, "s/s") if first.course is TimeCourse.CLOCK else each
    return tuple(effect.about.unit for effect in group)


def _named(machine: Machine, name: str, at: str, library: tuple[Group, ...]) -> Group:
    """Return the first group of effects of that name, if possible one that can act at the location `at`.

    Raises ValueError for an unknown name.
    """
    found = [group for group in library if group[0].about.name == name]
    if not found:
        known = ", ".join(dict.fromkeys(group[0].about.name for group in library))
        raise ValueError(f"effect {name!r} is not known: choose one of {known}")
    return next((group for group in found if at in dict(places(machine, group[0].about.place))), found[0])


def _check(candidate: Imposed) -> None:
    """Raise ValueError unless begin, end, number, magnitude and sign of the sizes are plausible.

    The effect must begin at 0 or later and before it ends. The magnitude, of the first `about.axes` sizes, may be up to
    BEYOND times the largest plausible one. The sign is that of the first size.
    """
    about, wanted, sizes = candidate.group[0].about, units(candidate.group), candidate.sizes
    name = about.name
    if not 0.0 <= candidate.begin < candidate.end:
        raise ValueError(
            f"effect {name!r} from {candidate.begin:g} s until {candidate.end:g} s: it must begin before it ends"
        )
    if len(sizes) != len(wanted):
        raise ValueError(f"effect {name!r} wants {len(wanted)} value(s) ({', '.join(wanted)}), not {len(sizes)}")
    if not hypot(*sizes[: about.axes]) <= BEYOND * about.high:
        raise ValueError(f"effect {name!r} of {sizes[0]:g} {about.unit}: plausible is up to {about.high:g}")
    if about.sign * sizes[0] < 0.0:
        raise ValueError(f"effect {name!r} of {sizes[0]:g} {about.unit}: only the other sign can be")


def _check_part(machine: Machine, candidate: Imposed) -> None:
    """Raise ValueError when the machine lacks the component, or the sensor that would read the error.

    An effect shows this by returning the same machine or the same readings that it was given.
    """
    effect, values = candidate.group[0], np.zeros((2, len(machine.signals)))
    t = np.array([0.0, 1.0])
    nothing = (isinstance(effect, Alteration) and effect.altered(machine, candidate.where, 1e-3) is machine) or (
        isinstance(effect, Distortion) and effect.distorted(machine, values, t, candidate.where, 1e-3) is values
    )
    if nothing:
        raise ValueError(
            f"effect {effect.about.name!r} cannot be at {candidate.at!r}: this machine has no such part there"
        )


def altered(machine: Machine, effects: Sequence[Imposed]) -> Machine:
    """Return the machine with all geometry errors among `effects`; the same object where there are none.

    Begin and end of these effects are ignored: the geometry is wrong during the whole run.
    """
    for each in effects:
        for effect, size in each.members():
            if isinstance(effect, Alteration):
                machine = effect.altered(machine, each.where, size)
    return machine


def excess_force(effects: Sequence[Imposed], moving: Motion, t: Array) -> Array:
    """Return the additional force (T, C) [N] that every cylinder supplies, at times t (T,) [s] of the run.

    It is that of the laws of cylinder force among `effects` (`ForceLaw`), positive: it pushes.
    """
    force = np.zeros_like(moving.speed)
    for each in effects:
        for law, size in each.members():
            if isinstance(law, ForceLaw):
                c = each.where
                force[:, c] += each.during(t) * size * law.force(moving.speed[:, c], moving.force[:, c], t)
    return force


def excess_torque(machine: Machine, effects: Sequence[Imposed], moving: Motion, t: Array) -> Array:
    """Return the additional joint torques (T, N) [N m] that the cylinders supply, at times t (T,) [s] of the run.

    They are those of the laws of joint torque among `effects` (`JointLaw`).
    """
    torque = np.zeros_like(moving.q)
    for each in effects:
        for law, size in each.members():
            if isinstance(law, JointLaw):
                torque += (size * each.during(t))[:, None] * law.torque(machine, moving, t, each.where)
    return torque


def friction_level(effects: Sequence[Imposed], cylinders: int, t: Array, law: str) -> Array:
    """Return the factor (T, C) on the friction `law` of every cylinder at times t (T,) [s] of the run; 1: unchanged.

    An effect that changes dry friction changes every law of the simulated machine.

    cylinders: number C of cylinders
    law:       name of the friction law, such as "viscous"
    """
    level = np.ones((len(t), cylinders))
    for each in effects:
        for share, size in each.members():
            if isinstance(share, Share) and ("coulomb" in share.laws or law in share.laws):
                level[:, rubbing(share, each.where, cylinders)] += (size * each.during(t) * share.course(t))[:, None]
    return level


def changed_laws(effects: Sequence[Imposed]) -> tuple[str, ...]:
    """Return the names of the friction laws whose coefficients the effects change, each once; "coulomb" and so on."""
    shares = [share for each in effects for share in each.group if isinstance(share, Share)]
    return tuple(dict.fromkeys(law for share in shares for law in share.laws))


def added_parameters(machine: Machine, effects: Sequence[Imposed], t: Array) -> Array:
    """Return the changes (T, N, 3) of the links' base parameters (J, X, Z) [kg m^2, kg m, kg m] by changed masses.

    t: (T,) times of the run [s]
    """
    found = np.zeros((len(t), machine.size, 3))
    for each in effects:
        weight = each.group[0]
        if isinstance(weight, MassChange):
            change = (weight.change(machine, each.where) @ np.array(each.sizes)).reshape(machine.size, 3)
            there = each.during(t) * (weight.grown(t) if isinstance(weight, GrowingMass) else 1.0)
            found += there[:, None, None] * change
    return found


def _changed(effect: Incident) -> list[str]:
    """Return the keys of `CHANGED` that an incident changes, each once, in the order of its columns and sizes.

    Its own columns may be numbered, `slew.0`, `slew.1`, ...
    """
    return list(dict.fromkeys(what for column in effect.columns for what in CHANGED if column.startswith(what)))


def _incidents(effects: Sequence[Imposed], t: Array, wanted: Sequence[str]) -> Array:
    """Return the sum (T, K) of the sizes of the incidents present at times t (T,) [s], for the K `wanted` quantities.

    wanted: keys of `CHANGED`; a column of the result has the unit of its key
    """
    found = np.zeros((len(t), len(wanted)))
    for each in effects:
        effect = each.group[0]
        if isinstance(effect, Incident):
            for what, size in zip(_changed(effect), each.sizes, strict=False):
                if what in wanted:
                    found[:, wanted.index(what)] += size * each.during(t)
    return found


def changed_load(effects: Sequence[Imposed], carried: CarriedLoad, t: Array) -> CarriedLoad:
    """Return the load `carried`, changed by incidents (spilled, shifted) at times t (T,) [s] of the run.

    An incident changes the load that is in the bucket when it begins, until the bucket is emptied or the incident ends;
    the next load is not changed. While the bucket is being emptied the change shrinks with the load. The inertia is
    scaled with the mass. Raises ValueError when more is spilled than carried.

    carried: the load without incidents
    """
    changes = np.zeros((len(t), 3))
    for each in effects:
        wanted = np.array([_size(each, what) for what in ("load.mass", "load.X", "load.Z")])
        if np.any(wanted):
            changes += (each.during(t) * _still_carried(carried.mass, t, each.begin))[:, None] * wanted
    mass, x, z = (carried.mass + changes[:, 0], *carried.centre.T)
    if np.any(mass < 0.0):
        raise ValueError("more falls out of the bucket than there is in it")
    some = np.maximum(mass, 1e-9)
    moments = carried.mass[:, None] * np.stack([x, z], axis=-1) + changes[:, 1:]
    inertia = carried.inertia * mass / np.maximum(carried.mass, 1e-9)
    return CarriedLoad(mass, np.where(mass[:, None] > 0.0, moments / some[:, None], 0.0), inertia)


def _still_carried(mass: Array, t: Array, begin: float) -> Array:
    """Return the share (T,) of the load in the bucket at `begin` [s] that is still carried at times t (T,) [s].

    It is 0 before `begin` and once the bucket is empty. From `begin` on it is 1 for an unknown load, without any mass,
    and for a bucket that is empty when the incident begins within these times.

    mass: (T,) mass carried without incidents [kg]
    """
    after = t >= begin
    if not np.any(mass > 0.0) or not np.any(after):
        return np.where(after, 1.0, 0.0)
    first = int(np.argmax(after))
    if mass[first] <= 0.0:  # emptied since then, or, within these times, empty when it begins
        return np.where(after, 0.0 if begin < t[0] else 1.0, 0.0)
    same_load = np.logical_and.accumulate((mass > 0.0) | ~after)
    return np.asarray(np.where(after & same_load, np.minimum(mass / mass[first], 1.0), 0.0))


def _size(incident: Imposed, quantity: str) -> float:
    """Return the size, in the unit of `CHANGED`, with which an incident changes a quantity; 0 if it does not.

    quantity: key of `CHANGED`
    """
    effect = incident.group[0]
    changed = _changed(effect) if isinstance(effect, Incident) else []
    return incident.sizes[changed.index(quantity)] if quantity in changed else 0.0


def unseen_slew(effects: Sequence[Imposed], t: Array) -> Array:
    """Return the square (T,) [rad^2/s^2] of a slew rate that no sensor measures, at times t (T,) [s] of the run.

    The square of the true rate is that of the measured rate plus this one.
    """
    return _incidents(effects, t, ("slew",))[:, 0]


def contact_force(effects: Sequence[Imposed], t: Array) -> Array:
    """Return the force (T, 2) [N] of an obstacle or the soil on the teeth, x forward and z up.

    It rises and falls smoothly, for RAMP [s] after the begin and before the end of each effect.

    t: (T,) times of the run [s]
    """
    found = np.zeros((len(t), 2))
    for each in effects:
        effect = each.group[0]
        if isinstance(effect, Incident) and _changed(effect) == ["tip.x", "tip.z"]:
            inside = smooth(t, each.begin, each.begin + RAMP)
            if each.end < inf:
                inside = inside * (1.0 - smooth(t, each.end - RAMP, each.end))
            found += inside[:, None] * np.array(each.sizes)
    return found


def base_motions(effects: Sequence[Imposed]) -> list[tuple[BaseMotion, Imposed]]:
    """Return the effects that move the body which carries the first link, each with its group as imposed."""
    return [(effect, each) for each in effects for effect in each.group if isinstance(effect, BaseMotion)]


def distorted(machine: Machine, effects: Sequence[Imposed], values: Array, t: Array) -> Array:
    """Return the signals (T, S) [SI] with all sensor and clock errors among `effects`, at times t (T,) [s] of the run.

    The errors act one after the other, in the order of `effects`. A clock error delays all pressures and force pins.

    values: (T, S) signals without these errors [SI]; the same object is returned where there are none
    """
    for each in effects:
        during = each.during(t)[:, None] > 0.0
        for effect, size in each.members():
            if isinstance(effect, Distortion):
                values = np.where(during, effect.distorted(machine, values, t, each.where, size), values)
        if isinstance(each.group[0], Incident) and each.group[0].course is TimeCourse.CLOCK:
            values = np.where(during, _late(machine, values, t, each), values)
    return values


def undistorted(machine: Machine, effects: Sequence[Imposed], values: Array, t: Array) -> Array:
    """Return the signals (T, S) [SI] without the sensor and clock errors among `effects`: the inverse of `distorted`.

    The error depends on the true values: it is computed once more from values that are nearly true.

    values: (T, S) signals with the errors [SI]
    t:      (T,) times of the run [s]
    """
    against = [each._replace(sizes=tuple(-size for size in each.sizes)) for each in reversed(effects)]
    first = distorted(machine, against, values, t)
    return first + values - distorted(machine, effects, first, t)


def _late(machine: Machine, values: Array, t: Array, incident: Imposed) -> Array:
    """Return the signals (T, S) [SI] with all pressures and force pins delayed by sizes[0] + sizes[1] (t - begin) [s].

    values:   (T, S) signals without the delay [SI]
    t:        (T,) times of the run [s]
    incident: a clock fault, with its delay at the begin [s] and its growth [s/s]
    """
    found, late = values.copy(), incident.sizes[0] + incident.sizes[1] * np.maximum(t - incident.begin, 0.0)
    for k, signal in enumerate(machine.signals):
        if signal.kind in PRESSURES:
            found[:, k] = np.interp(t - late, t, values[:, k])
    return found
