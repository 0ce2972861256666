"""Possible causes of a change in a machine, as directions in which its quantities move together."""

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
SIZES = 4  # prior standard deviations of a size, evenly in its logarithm from the least plausible to the largest
FRICTIONS = frozenset({CoulombFriction().about.name, FrictionLevelChange().about.name})  # two names of one cause
BEYOND = (5.0, 25.0)  # prior standard deviations of an unknown cause, times the usual day-to-day spread; chosen
SINGLE: dict[str, About] = {
    "coulomb": CoulombFriction().about,
    LEVEL: FrictionLevelChange().about,
    ZERO: PressureOffset().about,
    OFFSET: AngleOffset().about,
}


class ChangeCause(NamedTuple):
    """A possible cause of a change in a machine with K quantities.

    name: name in the library of effects
    at: location: link, cylinder or sensor
    unit: unit of its size
    directions: (K, M) directions in which the quantities move; the first one is that of its size
    spreads: (G, M) prior standard deviations of the sizes; all G sets are equally probable
    least: size below which there is no change
    """

    name: str
    at: str
    unit: str
    directions: Array
    spreads: Array
    least: float


def possible_causes(machine: Machine, known: Sequence[Coordinate], days: Array) -> tuple[ChangeCause, ...]:
    """Return all possible causes of a change in a machine.

    known: (K,) its quantities
    days: (K,) usual day-to-day spread of each
    """
    causes = []
    for k, c in enumerate(known):
        unit = np.eye(len(known))[k]
        if c.quantity in SINGLE:
            about = SINGLE[c.quantity]
            spreads = np.geomspace(about.low, about.high, SIZES)[:, None]
            causes.append(
                ChangeCause(
                    name=about.name,
                    at=c.at,
                    unit=c.unit,
                    directions=unit[:, None],
                    spreads=spreads,
                    least=about.low,
                )
            )
        elif c.quantity == CARRIED:
            causes.append(_mass(machine, c, unit))
    factors = np.array(BEYOND)[:, None] * days
    unknown = ChangeCause(name=UNKNOWN, at="", unit="", directions=np.eye(len(known)), spreads=factors, least=0.0)
    return (*causes, unknown)


def _mass(machine: Machine, carried: Coordinate, unit: Array) -> ChangeCause:
    """Return a mass anywhere along a link, on it rather than far above it, as a cause."""
    effect, about = ExtraMass(), ExtraMass().about
    link = next(j for j in machine.rows if machine.links[j].name == carried.at)
    moments = np.zeros((len(unit), len(effect.typical)))
    moments[: 3 * machine.size] = effect.change(machine, link)
    along, across = machine.links[link].length / np.sqrt(12.0), effect.typical[2] / effect.typical[0]
    arms = np.array([1.0, along, across, along**2])
    spreads = np.geomspace(about.low, about.high, SIZES)[:, None] * arms
    directions = np.column_stack([unit, moments[:, 1:]])
    return ChangeCause(
        name=about.name, at=carried.at, unit=about.unit, directions=directions, spreads=spreads, least=about.low
    )
