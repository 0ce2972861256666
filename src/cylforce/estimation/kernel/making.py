"""The kernel's plan of a model: its machine, the numbers of its columns, its filters."""

from array import array
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from cylforce.effects.effect import Effect
from cylforce.effects.friction.asymmetric_friction import AsymmetricFriction
from cylforce.effects.friction.coulomb_friction import CoulombFriction
from cylforce.effects.friction.friction import AtRest
from cylforce.effects.friction.load_dependent_friction import LoadDependentFriction
from cylforce.effects.friction.stribeck import Stribeck
from cylforce.effects.friction.viscous_friction import ViscousFriction
from cylforce.effects.loads.cylinder_weight import CylinderWeight
from cylforce.effects.loads.rigid import Rigid
from cylforce.effects.loads.rocker_weight import RockerWeight
from cylforce.effects.loads.slew import Slew
from cylforce.effects.loads.tip_force import TipForce
from cylforce.effects.sensors.delay import Delay
from cylforce.effects.sensors.pressure_zero import PressureZero
from cylforce.estimation.filters import Filter
from cylforce.estimation.kernel import columns
from cylforce.estimation.kernel.plan import KernelPlan, KernelSensors
from cylforce.estimation.kernel.restricted import Counts, Numbers
from cylforce.estimation.model import Model
from cylforce.mechanics.linkages import FourBar
from cylforce.mechanics.machine import Machine
from cylforce.signals.kinds import Kind

FORCE_LAWS: dict[type, int] = {
    CoulombFriction: columns.COULOMB,
    ViscousFriction: columns.VISCOUS,
    LoadDependentFriction: columns.LOAD,
    AsymmetricFriction: columns.DIRECTIONAL,
    Stribeck: columns.STRIBECK,
    Delay: columns.DELAY,
    PressureZero: columns.ZERO,
    AtRest: columns.AT_REST,
}
# The other effects, with the ends of the names of the columns that no other effect has.
OTHERS: dict[type, tuple[str, ...]] = {
    Rigid: (),
    TipForce: (),
    Slew: ("D_excess", "E"),
    RockerWeight: ("rocker",),
    CylinderWeight: ("cylinder",),
}


def numbers(values: Iterable[Any]) -> Numbers:
    """Return numbers as an array of the kernel."""
    return array("d", [float(value) for value in values])


def counts(values: Iterable[int]) -> Counts:
    """Return integers as an array of the kernel."""
    return array("q", [int(value) for value in values])


def plan(model: Model, kind: Callable[..., KernelPlan]) -> KernelPlan:
    """Return the constants of a model in the form that the kernel takes: its machine's geometry, columns and filters.

    Raises TypeError for an effect whose law the kernel does not have.

    kind: class `KernelPlan` of the compiled or the interpreted kernel
    """
    return kind(*_arguments(model))


def _arguments(model: Model) -> tuple[Counts, Numbers, list[Counts], list[Numbers]]:
    """Return a machine's geometry, columns and filters as the four arguments of the kernel's class `KernelPlan`.

    They are: numbers of joints, cylinders, measured torques, columns, channels and laws, steps for which a bad lever
    spoils a row, two flags, first column of the tool; gravity [m/s^2], distance of the first pin from the slew axis and
    place of the inertial sensor [m], fixed step [s]; arrays of integers (numbers of rows, cylinders, bodies and
    columns); arrays of numbers (lengths, pins, bars, stops [m], constants of the laws, coefficients of the filters,
    room for results)."""
    machine, table = model.machine, _Table(model)
    n, c, r = machine.size, len(machine.cylinders), len(machine.rows)
    k, d = len(table.names), n + c + (6 if model.channels.inertial else 3)
    kinds = {signal.kind for signal in machine.signals}
    flags = (Kind.SLEW_RATE in kinds, model.channels.inertial)
    sizes = counts([n, c, r, k, d, len(table.laws) // 2, model.settle_steps, *flags, table.place("tip.x")])
    base, dt = machine.inertial, 1.0 / model.filters.rate_hz
    physics = numbers([machine.gravity, machine.slew_axis, base.real, base.imag, dt])
    used, moved = table.used()
    whole: list[Sequence[int]] = [
        _rows(machine),
        _acting(model),
        _bodies(machine),
        table.rigid,
        table.slewed,
        table.rocker,
        table.weight,
    ]
    whole += [table.laws, _levers(machine, k), used, moved, [0] * c]
    parts: list[Sequence[float]] = [
        machine.lengths.tolist(),
        _pairs(machine.arms),
        _pins(machine),
        _bars(machine),
        _stops(model),
        table.shapes,
    ]
    room = [d, d, n, n, 2 * n, 2 * n, 4 * n, 6 * (4 + 4 * n), c * n, c, c, r * k, r * k, r + 1]
    parts += [*_filters(model), *([0.0] * size for size in room)]
    return sizes, physics, [counts(x) for x in whole], [numbers(x) for x in parts]


def sensors(model: Model, kind: Callable[..., KernelSensors], most: float) -> KernelSensors:
    """Return which signals give the channels: joint angles, cylinder forces, motion of the base.

    kind: class `KernelSensors` of the compiled or the interpreted kernel
    most: tilt of the chassis above which samples are not used [rad]
    """
    machine, read = model.machine, model.channels
    of_house = [*read.base, *read.house]
    sizes = [machine.size, len(machine.cylinders), machine.size + len(machine.cylinders) + len(of_house)]
    tilts = [k for k, s in enumerate(machine.signals) if s.kind in (Kind.PITCH, Kind.ROLL)]
    whole = [
        [-1 if k is None else k for k in each] for each in ([*sum(read.turned, ())], [*sum(read.pushed, ())], of_house)
    ]
    areas = [x for c in machine.cylinders for x in (c.area_head, c.area_rod, c.rod_pressure)]
    return kind(counts([*sizes, len(tilts)]), most, [counts(x) for x in (*whole, tilts)], [numbers(areas)])


class _Table:
    """Columns of a model's effects, by their numbers among the K columns of the model.

    An effect is a term of the model with parameters of its own (weight of the links, friction, ...). It has one column
    for each parameter: the torques per unit of the parameter. A force law is an effect that is a force along each
    cylinder, with one column for each.

    names:  number of each column, by its name
    rigid:  (3 N) columns of inertia J and first moments X, Z of each link
    slewed: (2 N) columns of D_excess, E of each link, by the centrifugal force (`Slew`); empty without this effect
    laws:   of each force law: its kind (`FORCE_LAWS`), then its first column
    shapes: of each force law: two constants, `rounding` and `width`; 1 where the law has none
    rocker: (C,) columns of the weight of each cylinder's four-bar; -1: none
    weight: (C,) columns of the weight of each cylinder itself; -1: none
    """

    def __init__(self, model: Model) -> None:
        """Find the columns of each effect of a model by their names, for the kernel, which computes them.

        Raises TypeError for an effect that the kernel cannot compute."""
        self._model, machine = model, model.machine
        regressor = model.filtered.regressor
        self.names = {name: k for k, name in enumerate(regressor.names)}
        links = [link.name for link in machine.links]
        self.rigid = [self.names[f"{link}.{symbol}"] for link in links for symbol in ("J", "X", "Z")]
        self.slewed: list[int] = []
        self.laws: list[int] = []
        self.shapes: list[float] = []
        self.rocker, self.weight = [-1] * len(machine.cylinders), [-1] * len(machine.cylinders)
        for effect in regressor.effects:
            self._take(effect, links)

    def place(self, name: str) -> int:
        """Return the number of a column."""
        return self.names[name]

    def _take(self, effect: Effect, links: Sequence[str]) -> None:
        """Store the numbers of the columns of one effect, and the constants of its law.

        links: names of the machine's links
        """
        machine, law = self._model.machine, getattr(effect, "law", effect)  # the law of a friction
        if type(law) in FORCE_LAWS:
            self.laws += [FORCE_LAWS[type(law)], self.names[effect.parameters(machine)[0].name]]
            self.shapes += [getattr(law, "rounding", 1.0), getattr(law, "width", 1.0)]
        elif type(law) not in OTHERS:
            raise TypeError(f"the kernel does not know the law of {type(effect).__name__}")
        elif "D_excess" in OTHERS[type(law)]:
            self.slewed = [self.names[f"{link}.{symbol}"] for link in links for symbol in OTHERS[type(law)]]
        elif "rocker" in OTHERS[type(law)]:
            self.rocker = [self.names.get(f"{c.name}.rocker", -1) for c in machine.cylinders]
        elif "cylinder" in OTHERS[type(law)]:
            self.weight = [self.names.get(f"{c.name}.cylinder", -1) for c in machine.cylinders]

    def used(self) -> tuple[list[int], list[int]]:
        """Return the places in a (R, K) table that can differ from zero, and those of them that have momentum.

        A place is row K + column. A link's columns can differ from zero in the torques of its own joint and of those
        before it, a force law's columns in those of the joints that the cylinder spans. Columns of the tool, and of the
        weight of bars and cylinders, can in all torques. Columns J, X, Z of links and these weights have momentum."""
        machine, size = self._model.machine, len(self.names)
        farthest = {k: i // 3 for i, k in enumerate(self.rigid)} | {k: i // 2 for i, k in enumerate(self.slewed)}
        farthest |= {self.names["tip.x"] + i: machine.size for i in range(3)}
        weights = {k for k in (*self.rocker, *self.weight) if k >= 0}
        farthest |= dict.fromkeys(weights, machine.size)
        spans = {first + c: span for first in self.laws[1::2] for c, span in enumerate(machine.spans)}
        used, moved = [], []
        for row, joint in enumerate(machine.rows):
            for k in range(size):
                if joint <= farthest.get(k, -1) or joint in spans.get(k, ()):
                    used.append(row * size + k)
                    if k in weights or k in self.rigid:
                        moved.append(row * size + k)
        return used, moved


def _rows(machine: Machine) -> list[int]:
    """Return (N,) the row of each joint's measured torque; -1: not measured."""
    return [machine.rows.index(j) if j in machine.rows else -1 for j in range(machine.size)]


def _levers(machine: Machine, columns: int) -> list[int]:
    """Return three numbers for each pair of a measured joint and a cylinder that acts on it.

    The numbers are the place of the lever in a (C, N) table; row K + cylinder, to which the first column of a force law
    is added for the place of its column in a (R, K) table; and the cylinder.

    columns: K
    """
    found = []
    for row, joint in enumerate(machine.rows):
        for c, span in enumerate(machine.spans):
            if joint in span:
                found += [c * machine.size + joint, row * columns + c, c]
    return found


def _acting(model: Model) -> list[int]:
    """Return (R, C) whether each cylinder acts on the joint of each row."""
    return [c in acting for acting in model.acting for c in range(len(model.machine.cylinders))]


def _bodies(machine: Machine) -> list[int]:
    """Return the numbers (C, 3) of the bodies that carry each cylinder's pins, flat: 0 is the house, then the links.

    The pins are foot and eye, then -1; of a four-bar foot, pin of the rocker and pin of the connecting link."""
    found = []
    for cylinder in machine.cylinders:
        bodies = [body for body, _ in cylinder.linkage.pins]
        found += [*bodies, -1][:3]
    return found


def _pairs(points: Iterable[complex]) -> list[float]:
    """Return x and z of each point x + i z, one after the other."""
    return [x for point in points for x in (point.real, point.imag)]


def _pins(machine: Machine) -> list[float]:
    """Return the places (C, 6) of each cylinder's three pins, x and z one after the other, flat [m].

    They are foot and eye, or foot, rocker pin and pin of the connecting link, each in its own body's axes. An absent
    third pin has 0."""
    found = []
    for cylinder in machine.cylinders:
        found += [*_pairs(local for _, local in cylinder.linkage.pins), 0.0, 0.0][:6]
    return found


def _bars(machine: Machine) -> list[float]:
    """Return the bars of each cylinder, a flat list of 6 C numbers in the order of `bodies.ROCKER_LENGTH` to
    `bodies.HALF_LENGTH`.

    The six are the lengths of rocker and connecting link [m], the side of the rocker (1 or -1), the place of the eye
    along and across the rocker in units of the rocker's length, and half of the shortest length of the cylinder [m].
    Without a four-bar the first five are 1 and are not used."""
    found = []
    for cylinder in machine.cylinders:
        bar, half = cylinder.linkage, cylinder.length_low / 2.0
        own = (
            [bar.rocker_length, bar.link_length, bar.side, bar.eye.real, bar.eye.imag]
            if isinstance(bar, FourBar)
            else [1.0] * 5
        )
        found += [*own, half]
    return found


def _stops(model: Model) -> list[float]:
    """Return (C, 2) shortest and longest length at which each cylinder's force is used [m]."""
    low, high = model.channels.stops
    return [float(x) for pair in zip(low, high, strict=True) for x in pair]


def _filters(model: Model) -> list[list[float]]:
    """Return eight lists: coefficients and initial states of the filters, in the order of the plan's fields.

    A filter's coefficients are b0, b1, ..., a1, a2, ...; a0 is 1.

    channel: (5) low-pass of the channels
    mean:    (7) filter of static columns and torques
    begun:   (3) its state before a first input of 1 after zeros (`FilteredRegressor.shares`)
    slope:   (2) b0 and b3 of the momentum's filter; its b1 and b2 are 0, its a1 to a3 those of `mean`
    rest:    (3) its state settled at the input 1, with output 0
    quick:   (5) low-pass of the forces
    settled: (2) its state settled at the input 1
    slow:    (3) low-pass of the inertia
    """
    slow, fast = model.filtered, model.fast
    return [
        _coefficients(model.channels.smooth),
        _coefficients(slow.mean),
        list(slow.shares),
        [slow.slope.b[0], slow.slope.b[-1]],
        [-float(np.sum(slow.slope.b[:k])) for k in range(1, 4)],
        _coefficients(fast.quick),
        fast.quick.steady(np.ones(())).tolist(),
        _coefficients(fast.slow),
    ]


def _coefficients(filter_: Filter) -> list[float]:
    """Return b0, b1, ..., a1, a2, ... of a filter; a0 is 1."""
    return [*filter_.b, *filter_.a[1:]]
