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

STEEL = 7850.0  # density [kg/m^3]
# Width and thickness of a bar [m], which weighs 79 kg per metre then; and the relative standard error of that mass. The
# bars of an excavator of 20 t weigh some 75 to 110 kg per metre; those of a loader crane, by its makers' drawings, 26
# and 83.
BAR, ERROR = 0.1, 0.5
POSTURES = 7  # of each joint, over which the links represent the bars in the mean; chosen
# Sine of the angle between rocker and connecting link below which a posture does not count; as in `channels`
CLOSED = 0.15


class Guess(NamedTuple):
    """Prior of a first moment.

    mean:           [kg m]
    standard_error: [kg m]
    """

    mean: float
    standard_error: float


def guess(cylinder: Cylinder, linkage: FourBar) -> Guess:
    """Return the prior of the first moment [kg m] of a four-bar's rocker about its pin, positive towards its end.

    The rocker is a square steel bar of width BAR. Half of the connecting link, such a bar too, acts at its end. Half of
    the piston rod acts at the cylinder's eye. If the eye is not at the rocker's end, a second bar joins it to the
    rocker's pin. The standard error is ERROR times the sum of the parts' first moments without their signs: an eye
    behind the pin reduces the mean, but not the standard error.

    cylinder: with the areas of its sides [m^2] and its shortest length [m]
    linkage:  lengths of rocker and connecting link [m]; place of the eye, a complex number in units of the rocker, with
              the real part along it; 1 is the rocker's end
    """
    rocker, eye, per_metre = linkage.rocker_length, linkage.eye, STEEL * BAR**2  # mass per length [kg/m] of a bar
    rod = STEEL * (cylinder.area_head - cylinder.area_rod) * cylinder.length_low  # kg; area_rod: of the annulus
    far = per_metre * (rocker / 2.0 + linkage.link_length / 2.0) * rocker  # of rocker and connecting link [kg m]
    # of piston rod and second bar [kg m], over the place of the eye, which is a number without a unit
    near = rod / 2.0 * rocker + (0.0 if eye == 1.0 else per_metre * abs(eye) * rocker**2 / 2.0)
    return Guess(far + near * eye.real, ERROR * (far + near * abs(eye)))


def of_cylinder(cylinder: Cylinder) -> Guess:
    """Return the prior of a cylinder's first moment [kg m]: that of the barrel about the pin of its foot, less that of
    the rod about the pin of its eye.

    Barrel and rod are each as long as the shortest cylinder, weigh as much as a steel rod of the piston rod's section,
    and have their centre in the middle. The two moments are equal in the mean, so that the prior mean is zero. Their
    relative standard errors ERROR are independent, so that the difference has sqrt(2) times that of one moment."""
    section = cylinder.area_head - cylinder.area_rod  # of the piston rod: `area_rod` is the annulus on the rod's side
    rod = STEEL * section * cylinder.length_low
    return Guess(mean=0.0, standard_error=sqrt(2.0) * ERROR * rod * cylinder.length_low / 2.0)


def of_bars(machine: Machine) -> tuple[Effect, ...]:
    """Return the effects of the weight of bars and cylinders that have parameters on this machine."""
    effects = (RockerWeight(), CylinderWeight())
    return tuple(e for e in effects if e.parameters(machine))


def with_bars(machine: Machine, names: tuple[str, ...], prior: Prior) -> Prior:
    """Return the prior of a machine's parameters with the bars' own weights in place of zero.

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
    taken = 2.0 * np.eye(len(names)) - represented(machine, names)  # 2 I - S: subtracts from the links what S adds
    return Prior(taken @ mean, taken @ covariance @ taken.T)


def represented(machine: Machine, names: tuple[str, ...]) -> Array:
    """Return the matrix S (P, P) that adds the bars' and cylinders' weight to the links' parameters.

    S @ parameters are the parameters of links that contain their bars, as in a data sheet. Only the 3N parameters of
    the links change: J [kg m^2], X and Z [kg m] of each of N links, in this order (`Rigid`).

    names: of the P parameters, those of the links first
    """
    sums, columns = np.eye(len(names)), _columns(machine, names)
    if columns:
        sums[: 3 * machine.size, columns] = _shares(machine)
    return sums


def balanced(machine: Machine) -> frozenset[str]:
    """Return the names of the parameters of bars on both sides of the rocker's pin, whose first moment may have either
    sign."""
    return frozenset(f"{name}.rocker" for name, bars in machine.four_bars.items() if bars.eye.real < 0.0)


def _columns(machine: Machine, names: tuple[str, ...]) -> list[int]:
    """Return the numbers of the parameters of bars and cylinders among the parameters `names` (P,)."""
    return [names.index(p.name) for effect in of_bars(machine) for p in effect.parameters(machine) if p.name in names]


def _shares(machine: Machine) -> Array:
    """Return (3N, K): the J [kg m^2], X and Z [kg m] of each of the N links that best represent K bars and cylinders.

    Column k is for 1 kg m of first moment of bar k, by least squares. The static torques of links and bars are compared
    in POSTURES postures of each joint, without those in which a four-bar is near a dead point."""
    ranges = [np.linspace(k.angle_low, k.angle_high, POSTURES) for k in machine.links]
    theta = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, machine.size)
    still = motion(machine, theta, np.zeros_like(theta), np.zeros((len(theta), len(machine.cylinders))))
    closed = np.all(still.transmission > CLOSED, axis=-1)
    links, *parts = (effect.halves(machine, still).static[closed] for effect in (Rigid(), *of_bars(machine)))
    bars = np.concatenate(parts, axis=-1)
    size, count = links.shape[-1], bars.shape[-1]
    return np.asarray(np.linalg.lstsq(links.reshape(-1, size), bars.reshape(-1, count), rcond=None)[0])
