"""Priors of the bars of four-bar linkages (rocker, connecting link and piston rod: `RockerWeight`) and of cylinders
(`CylinderWeight`), from the machine file.

The data sheet's links include their masses, but they turn with none of the links."""

from math import sqrt
from typing import NamedTuple

import numpy as np

from cylforce.effects.effect import Effect
from cylforce.effects.loads.cylinder_weight import CylinderWeight
from cylforce.effects.loads.rigid import Rigid
from cylforce.effects.loads.rocker_weight import RockerWeight
from cylforce.estimation.priors.prior import Prior
from cylforce.mechanics.linkages import FourBar
from cylforce.mechanics.machine import Cylinder, Machine
from cylforce.mechanics.motion import motion
from cylforce.signals.estimate import Array

STEEL = 7850.0  # kg/m^3
# m, width and thickness of a bar: 79 kg per metre; and the relative standard error of that. The bars of an excavator of
# 20 t weigh some 75 to 110 kg per metre; those of a loader crane, by its makers' drawings, 26 and 83.
BAR, ERROR = 0.1, 0.5
POSTURES = 7  # of each joint, over which the links represent the bars in the mean; chosen
CLOSED = 0.15  # sine of the angle between rocker and link, below which a posture does not count; as in `channels`


class Guess(NamedTuple):
    """Prior of a first moment.

    mean:           [kg m]
    standard_error: [kg m]
    """

    mean: float
    standard_error: float


def guess(cylinder: Cylinder, linkage: FourBar) -> Guess:
    """Return the prior of a rocker's first moment: half of the link and half of the rod act at the rocker, which is a
    bar itself."""
    rocker, eye, section = linkage.rocker_length, linkage.eye, STEEL * BAR**2
    rod = STEEL * (cylinder.area_head - cylinder.area_rod) * cylinder.length_low
    far = section * (rocker / 2.0 + linkage.link_length / 2.0) * rocker
    near = rod / 2.0 * rocker + (0.0 if eye == 1.0 else section * abs(eye) * rocker**2 / 2.0)
    return Guess(far + near * eye.real, ERROR * (far + near * abs(eye)))


def of_cylinder(cylinder: Cylinder) -> Guess:
    """Return the prior of a cylinder's first moment, zero in the mean.

    Barrel and rod are as long as the shortest cylinder. Each weighs as much as a rod of steel, with an error of its
    own. About their pins they balance each other in the mean."""
    rod = STEEL * (cylinder.area_head - cylinder.area_rod) * cylinder.length_low
    return Guess(0.0, sqrt(2.0) * ERROR * rod * cylinder.length_low / 2.0)


def of_bars(machine: Machine) -> tuple[Effect, ...]:
    """Return the effects of bars and cylinders."""
    effects = (RockerWeight(), CylinderWeight())
    return tuple(e for e in effects if e.parameters(machine))


def with_bars(machine: Machine, names: tuple[str, ...], prior: Prior) -> Prior:
    """Return the prior with the bars' own priors in place of zero weight.

    The part of the bars that the data sheet's links contain is subtracted from the links' first moments. The sum of
    both keeps its uncertainty.

    names: (P,) parameters
    prior: of these parameters, in which the bars weigh nothing
    """
    columns = _columns(machine, names)
    if not columns:
        return prior
    guesses = [guess(c, machine.four_bars[c.name]) for c in machine.cylinders if c.name in machine.four_bars]
    guesses += [of_cylinder(c) for c in machine.carried]
    mean, covariance = prior.mean.copy(), prior.covariance.copy()
    mean[columns] = [g.mean for g in guesses]
    covariance[columns, columns] = [g.standard_error**2 for g in guesses]
    taken = 2.0 * np.eye(len(names)) - represented(machine, names)
    return Prior(taken @ mean, taken @ covariance @ taken.T)


def represented(machine: Machine, names: tuple[str, ...]) -> Array:
    """Return (P, P), from parameters `names` to those with the links of a data sheet, which contain the bars."""
    sums, columns = np.eye(len(names)), _columns(machine, names)
    if columns:
        sums[: 3 * machine.size, columns] = _shares(machine)
    return sums


def balanced(machine: Machine) -> frozenset[str]:
    """Return the names of the parameters of bars on both sides of the rocker's pin, whose first moment may have either
    sign."""
    return frozenset(f"{name}.rocker" for name, bars in machine.four_bars.items() if bars.eye.real < 0.0)


def _columns(machine: Machine, names: tuple[str, ...]) -> list[int]:
    return [names.index(p.name) for effect in of_bars(machine) for p in effect.parameters(machine) if p.name in names]


def _shares(machine: Machine) -> Array:
    """Return (3N, K), the links' (J, X, Z) that best represent a unit of each bar in all postures."""
    ranges = [np.linspace(k.angle_low, k.angle_high, POSTURES) for k in machine.links]
    theta = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, machine.size)
    still = motion(machine, theta, np.zeros_like(theta), np.zeros((len(theta), len(machine.cylinders))))
    closed = np.all(still.transmission > CLOSED, axis=-1)
    links, *parts = (effect.halves(machine, still).static[closed] for effect in (Rigid(), *of_bars(machine)))
    bars = np.concatenate(parts, axis=-1)
    size, count = links.shape[-1], bars.shape[-1]
    return np.asarray(np.linalg.lstsq(links.reshape(-1, size), bars.reshape(-1, count), rcond=None)[0])
