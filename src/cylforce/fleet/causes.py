"""What may change in a machine, as directions in which its quantities move together."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cylforce.effects.fault import About
from cylforce.effects.friction.coulomb_friction import CoulombFriction
from cylforce.effects.friction.friction_level_change import FrictionLevelChange
from cylforce.effects.loads.extra_mass import ExtraMass
from cylforce.effects.sensors.angle_offset import AngleOffset
from cylforce.effects.sensors.pressure_offset import PressureOffset
from cylforce.fleet.coordinates import CARRIED, LEVEL, OFFSET, ZERO, Coordinate
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

UNKNOWN = "unknown"
SIZES = 4  # standard deviations of a size, evenly in its logarithm from the least plausible to the largest
FRICTIONS = frozenset({CoulombFriction().about.name, FrictionLevelChange().about.name})  # tell of one thing
BEYOND = (5.0, 25.0)  # times the usual difference from day to day: something that no other direction tells
SINGLE: dict[str, About] = {
    "coulomb": CoulombFriction().about,
    LEVEL: FrictionLevelChange().about,
    ZERO: PressureOffset().about,
    OFFSET: AngleOffset().about,
}


class Culprit(NamedTuple):
    """Something that may change: its `name` in the library of effects and the place `at`; `directions` (K, M), the
    first of which is its size, in `unit`; `spreads` (G, M): standard deviations of the sizes, one set as probable as
    the other; a change is none when its size is below `least`."""

    name: str
    at: str
    unit: str
    directions: Array
    spreads: Array
    least: float


def culprits(machine: Machine, known: Sequence[Coordinate], days: Array) -> tuple[Culprit, ...]:
    """All that may change in a machine whose quantities `known` (K,) differ by `days` (K,) from day to day."""
    found = []
    for k, c in enumerate(known):
        unit = np.eye(len(known))[k]
        if c.quantity in SINGLE:
            about = SINGLE[c.quantity]
            spreads = np.geomspace(about.low, about.high, SIZES)[:, None]
            found.append(Culprit(about.name, c.at, c.unit, unit[:, None], spreads, about.low))
        elif c.quantity == CARRIED:
            found.append(_mass(machine, c, unit))
    factors = np.array(BEYOND)[:, None] * days
    return (*found, Culprit(UNKNOWN, "", "", np.eye(len(known)), factors, 0.0))


def _mass(machine: Machine, carried: Coordinate, unit: Array) -> Culprit:
    """A mass anywhere along a link, on it rather than far above it."""
    effect, about = ExtraMass(), ExtraMass().about
    link = next(j for j in machine.rows if machine.links[j].name == carried.at)
    moments = np.zeros((len(unit), len(effect.typical)))
    moments[: 3 * machine.size] = effect.change(machine, link)
    along, across = machine.links[link].length / np.sqrt(12.0), effect.typical[2] / effect.typical[0]
    arms = np.array([1.0, along, across, along**2])
    spreads = np.geomspace(about.low, about.high, SIZES)[:, None] * arms
    directions = np.column_stack([unit, moments[:, 1:]])
    return Culprit(about.name, carried.at, about.unit, directions, spreads, about.low)
