"""Check of effects that a user has written, before they are simulated or searched for.

Each fault is one sentence with its cure.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import is_dataclass
from inspect import Parameter, signature
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from cylforce.effects.fault import (
    INCIDENTAL,
    About,
    Alteration,
    BaseMotion,
    Distortion,
    Fault,
    ForceLaw,
    GrowingMass,
    Incident,
    JointLaw,
    MassChange,
    Place,
    ShapeRange,
    Share,
    TimeCourse,
    places,
    shaped,
    shapes,
)
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion, motion
from cylforce.mechanics.workspace import working_range
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import SIDES, Kind

# Methods of the protocols with the arguments they are called with.
METHODS: dict[str, tuple[str, ...]] = {
    "force": ("speed", "force", "t"),
    "torque": ("machine", "moving", "t", "where"),
    "distorted": ("machine", "values", "t", "where", "size"),
    "altered": ("machine", "where", "size"),
    "change": ("machine", "where"),
    "grown": ("t",),
    "halves": ("machine", "moving", "turning", "base"),
}
PROTOCOLS = (ForceLaw, JointLaw, Distortion, Alteration, MassChange, BaseMotion, Share, Incident)
ACTING = ("force", "torque", "distorted", "altered", "change", "halves", "course")  # of these an effect has one at most
STEPS, STEP_S = 80, 0.05  # samples of the test motion, seconds between them; chosen: most of each joint's wave, or more
TRIAL_PRESSURES = {Kind.HEAD_PRESSURE: 100e5, Kind.ROD_PRESSURE: 40e5}  # Pa; chosen


class Trial(NamedTuple):
    """A motion on which effects are tried.

    moving: all joints swing through half of their working ranges, the cylinders push and pull
    values: (T, S) readings of all signals on the way [SI]; pressures are waves that do not match the forces of
            `moving`, readings other than pressures, joint angles, inclinations and cylinder lengths are 0
    t:      (T,) times [s]
    """

    moving: Motion
    values: Array
    t: Array


def check_groups(groups: Sequence[Any], taken: Collection[str], machine: Machine | None = None) -> None:
    """Check groups of effects that act together, group by group; with a `machine` also on a test motion.

    Raises ValueError that begins with the name of the class, or with LIBRARY where a group is no tuple, for the first
    fault.

    groups: each a tuple of effects with one name
    taken:  names that other effects have, and these must not
    """
    trial = None if machine is None else trial_motion(machine)
    for group in groups:
        if not isinstance(group, tuple) or not group:
            raise ValueError(f"LIBRARY: {group!r} is no group: write a tuple of effects, such as (Squeak(),)")
        for effect in group:
            with _of_class(effect):
                check_effect(effect, taken)
                if effect.about.name != group[0].about.name:
                    first = group[0].about.name
                    raise ValueError(f"is called {effect.about.name!r}, the first of its group {first!r}: use one name")
                if machine is not None and trial is not None:
                    _check_motion(effect, machine, trial)
        with _of_class(group[0]):
            _check_shapes(group)


@contextmanager
def _of_class(effect: object) -> Iterator[None]:
    """Prefix a ValueError that is raised inside the `with` block with the name of the effect's class."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{type(effect).__name__}: {error}") from error


def check_effect(effect: object, taken: Collection[str]) -> None:
    """Check class, description and methods of one effect. Raises ValueError, in one sentence with its cure.

    taken: names that other effects have
    """
    given: Any = effect
    if not is_dataclass(effect) or not given.__dataclass_params__.frozen:
        raise ValueError("is no frozen dataclass: write @dataclass(frozen=True) above the class")
    if not hasattr(type(effect), "about"):
        raise ValueError("has no `about`: add a property `about` that returns About(name, unit, ...)")
    try:
        about = given.about
    except Exception as error:
        raise ValueError(f"its `about` fails ({type(error).__name__}: {error}): correct it") from error
    if not isinstance(about, About):
        raise ValueError(f"its `about` is {about!r}: make it a property that returns About(name, unit, low, high, ...)")
    _check_about(about, taken)
    _check_methods(effect)


def _check_about(about: About, taken: Collection[str]) -> None:
    """Raise ValueError unless the description is complete and of the right types, and its name is free.

    taken: names that other effects have
    """
    given: dict[str, Any] = about._asdict()
    for field in ("name", "unit", "shows", "confirm"):
        if not isinstance(given[field], str) or not given[field].strip():
            raise ValueError(f"`{field}` of its About is {given[field]!r}: write it as text")
    if not about.name.isidentifier():
        raise ValueError(f"is called {about.name!r}: use letters, digits and underscores, such as cross_talk")
    if about.name in taken:
        raise ValueError(f"is called {about.name!r}, which another effect is: choose another name")
    numbers = [isinstance(given[field], int | float) and isfinite(given[field]) for field in ("low", "high", "form")]
    if not all(numbers) or not 0.0 < about.low < about.high:
        raise ValueError(f"its plausible range is {about.low!r} to {about.high!r}: give numbers with 0 < low < high")
    if not isinstance(given["place"], Place):
        listed = ", ".join(f"Place.{place.name}" for place in Place)
        raise ValueError(f"its place is {about.place!r}: choose one of {listed}")
    if about.sign not in (-1, 0, 1):
        raise ValueError(f"its sign is {about.sign!r}: give 1 or -1 where only that can be, else 0")
    if not isinstance(given["axes"], int) or about.axes < 1:
        raise ValueError(f"its axes are {about.axes!r}: give the number of sizes that make its magnitude, 1 or more")


def _check_methods(effect: object) -> None:
    """Raise ValueError unless the effect follows one of PROTOCOLS, with at most one of the methods ACTING.

    The methods' arguments and the values of incidents, units and typical sizes are checked, too.
    """
    found = [protocol for protocol in PROTOCOLS if isinstance(effect, protocol)]
    acts = [name for name in ACTING if callable(getattr(effect, name, None))]
    if len(acts) > 1:
        raise ValueError(f"has the methods {' and '.join(acts)}: give it one of them, and the other a class of its own")
    for name, wanted in METHODS.items():
        if callable(getattr(effect, name, None)):
            _check_arguments(name, getattr(effect, name), wanted)
    if not found:
        missing = {"change": "`units` and `typical`", "halves": "`units` and `typical`", "course": "`laws`"}
        if acts and acts[0] in missing:
            raise ValueError(f"has the method {acts[0]}, but not all of {missing[acts[0]]}: add them as properties")
        listed = ", ".join(f"{name}({', '.join(METHODS[name])})" for name in ACTING if name in METHODS)
        raise ValueError(f"does nothing: give it one of the methods {listed}")
    if isinstance(effect, Incident) and not callable(effect.course):
        _check_incident(effect)
    if isinstance(effect, MassChange | BaseMotion) and not 0 < len(effect.units) == len(effect.typical):
        raise ValueError(f"has {len(effect.units)} units and {len(effect.typical)} typical sizes: give each size both")


def _check_arguments(name: str, method: Callable[..., Any], wanted: tuple[str, ...]) -> None:
    """Raise ValueError unless the arguments of a method have the `wanted` names, in that order.

    A method with *arguments is accepted, and arguments that can only be given by name are ignored.
    """
    given = [p for p in signature(method).parameters.values() if p.kind is not Parameter.KEYWORD_ONLY]
    named = tuple(p.name for p in given)
    if any(p.kind is Parameter.VAR_POSITIONAL for p in given) or named == wanted:
        return
    raise ValueError(f"its method is {name}({', '.join(named)}): write {name}(self, {', '.join(wanted)})")


def _check_incident(effect: Incident) -> None:
    """Raise ValueError unless an incident changes columns of `INCIDENTAL` in a `TimeCourse`."""
    wrong = [column for column in effect.columns if column not in INCIDENTAL]
    if wrong or not effect.columns:
        raise ValueError(f"changes the columns {effect.columns!r}: choose among {', '.join(INCIDENTAL)}")
    if not isinstance(effect.course, TimeCourse):
        raise ValueError(f"its course is {effect.course!r}: choose a TimeCourse, such as TimeCourse.AFTER")


def _check_shapes(group: tuple[Fault, ...]) -> None:
    """Raise ValueError unless each shape parameter of a group is a float field of its first effect, within its range.

    Raises it for a range, too, that does not rise or has a logarithm of zero.
    """
    for shape in shapes(group):
        if not isinstance(shape, ShapeRange):
            raise ValueError(f"its shapes hold {shape!r}: write ShapeRange(field, low, high)")
        value = getattr(group[0], shape.field, None)
        if not isinstance(value, float):
            raise ValueError(f"its shape {shape.field!r} is {value!r}: make it a field with a decimal number")
        if not shape.low < shape.high:
            raise ValueError(f"its shape {shape.field!r} goes from {shape.low:g} to {shape.high:g}: give low < high")
        if shape.log and not shape.low + shape.shift > 0.0:
            raise ValueError(f"its shape {shape.field!r} is logarithmic and begins at zero: give it a shift > 0")
        if not shape.low <= value <= shape.high:
            raise ValueError(
                f"its shape {shape.field!r} is {value:g}: start within its range {shape.low:g} to {shape.high:g}"
            )
        shaped(group, {shape.field: shape.value(0.5)})


def trial_motion(machine: Machine) -> Trial:
    """Return a motion of all joints of a machine, with readings of all sensors.

    The readings of angles and lengths are those of the motion. Pressures and cylinder forces are independent waves.
    """
    t = STEP_S * np.arange(STEPS, dtype=np.float64)
    low, high = working_range(machine).T
    waves = 0.5 + 0.25 * np.sin(np.outer(t, 1.5 + 0.5 * np.arange(machine.size)))
    theta = low + waves * (high - low)
    shake = 1.0 + 0.5 * np.sin(np.outer(t, 2.0 + np.arange(len(machine.signals))))
    values = np.zeros_like(shake)
    for k, signal in enumerate(machine.signals):
        if signal.kind in SIDES:
            values[:, k] = TRIAL_PRESSURES[signal.kind] * shake[:, k]
        elif signal.kind is Kind.JOINT_ANGLE:
            values[:, k] = theta[:, signal.index]
        elif signal.kind is Kind.LINK_INCLINATION:
            values[:, k] = theta.cumsum(axis=1)[:, signal.index]
        elif signal.kind is Kind.CYLINDER_LENGTH:
            values[:, k] = machine.geometry(theta).length[:, signal.index]
    force = 5e4 * np.cos(np.outer(t, 1.0 + np.arange(len(machine.cylinders))))
    return Trial(motion(machine, theta, np.gradient(theta, t, axis=0), force), values, t)


def _check_motion(effect: Fault, machine: Machine, trial: Trial) -> None:
    """Raise ValueError unless the effect gives finite numbers of the right shape at all its places on the machine."""
    for at, where in places(machine, effect.about.place):
        try:
            found, wanted = _tried(effect, machine, trial, where)
        except Exception as error:
            raise ValueError(
                f"fails at {at} on a test motion ({type(error).__name__}: {error}): correct the method"
            ) from error
        if np.shape(found) != wanted:
            raise ValueError(f"gives an array of shape {np.shape(found)} at {at}: make it {wanted}")
        if not np.all(np.isfinite(found)):
            raise ValueError(f"gives numbers that are not finite at {at} on a test motion: find the division or root")


def _tried(effect: object, machine: Machine, trial: Trial, where: int) -> tuple[Array, tuple[int, ...]]:
    """Return the output of an effect on the test motion, and the shape that it must have.

    The output is that of the method of its protocol: force, torque, signals, lengths of the cylinders, share or change
    of the parameters. A sensor's or geometry's error has its least plausible size. A moving base and an incident are
    not tried: zeros of the right shape.

    where: number of the location (`fault.places`)
    """
    count, t = len(trial.t), trial.t
    found: Array = np.zeros(count)
    wanted: tuple[int, ...] = (count,)
    if isinstance(effect, ForceLaw):
        found = np.asarray(effect.force(trial.moving.speed[:, where], trial.moving.force[:, where], t))
    elif isinstance(effect, JointLaw):
        found, wanted = np.asarray(effect.torque(machine, trial.moving, t, where)), (count, machine.size)
    elif isinstance(effect, Distortion):
        before = trial.values.copy()
        found = np.asarray(effect.distorted(machine, trial.values, t, where, effect.about.low))
        wanted = before.shape
        if not np.array_equal(before, trial.values):
            raise ValueError("it changes the values that it is given: work on values.copy()")
    elif isinstance(effect, Alteration):
        theta = np.diff(trial.moving.a, axis=1, prepend=0.0)
        found = effect.altered(machine, where, effect.about.low).geometry(theta).length
        wanted = (count, len(machine.cylinders))
    elif isinstance(effect, GrowingMass) and np.shape(effect.grown(t)) != wanted:
        found = np.asarray(effect.grown(t))
    elif isinstance(effect, MassChange):
        found, wanted = np.asarray(effect.change(machine, where)), (3 * machine.size, len(effect.units))
    elif isinstance(effect, Share) and callable(effect.course):
        found = np.asarray(effect.course(t))
    return found, wanted
