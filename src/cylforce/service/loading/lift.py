"""A lift, and what is concluded from it."""

from math import sqrt
from typing import NamedTuple

import numpy as np

from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.weighed import COVARIANCE, GRAM, VALUES
from cylforce.estimation.recursive import Root, solution
from cylforce.service.adaptation import Drift
from cylforce.service.spill import informed, side_by_side
from cylforce.signals.estimate import Array


class Look(NamedTuple):
    """A look for a spill: how many samples were in motion before it, and the tool's angle to the house then [rad], None
    where the tool does not empty by tilting."""

    moving: int
    tilt: float | None


class Lift(NamedTuple):
    """A lift: the recursive estimate of the load's (m, m x, m z, J about the last pin) without drift, as the kernel
    keeps it (`kept`); numbers of samples `taken`, `refused` in a row, and `moving`; `rested` (R,): number of samples
    for which each row has been at rest, less those in motion since; `marks` (M, 4, 5 + P + D): information about the
    load at the last `looks` (M,) for a spill; `mixed`: whether the filters still hold what was before the lift; `tilt`:
    that of the first look, when this load began to hang, None: none yet."""

    kept: Numbers
    taken: int
    refused: int
    moving: int
    rested: Numbers
    marks: Array
    looks: tuple[Look, ...]
    mixed: bool
    tilt: float | None = None

    @property
    def root(self) -> Root:
        """The information."""
        return Root(np.frombuffer(self.kept, count=VALUES - 4).reshape(4, 4), self._part(VALUES - 4, VALUES))

    @property
    def values(self) -> Array:
        """The estimate (4,)."""
        return self._part(VALUES, COVARIANCE)

    @property
    def covariance(self) -> Array:
        """Its covariance (4, 4)."""
        return self._part(COVARIANCE, GRAM).reshape(4, 4)

    @property
    def gram(self) -> Array:
        """(4, P + D), with which its sensitivity to tares and drift is covariance @ gram."""
        return self._part(GRAM, len(self.kept)).reshape(4, -1)

    def by_drift(self, covariance: Array) -> float:
        """Standard error [kg] of the mass by a drift of this `covariance` (D, D)."""
        gain = self.covariance[0] @ self.gram[:, -len(covariance) :]
        return sqrt(max(float(gain @ covariance @ gain), 0.0))

    def moments(self, tares: Array, drift: Drift, colder: float = 1.0) -> tuple[Array, Array]:
        """The load's mass [kg] and first moments [kg m] (3,) with the drift taken out, and their covariance (3, 3) by
        noise, by the `tares` (P, P), and by the drift's times `colder`."""
        change = (self.covariance @ self.gram)[:3]
        unsure = change @ side_by_side(tares, colder * drift.covariance) @ change.T
        return self.values[:3] - change[:, len(tares) :] @ drift.values, self.covariance[:3, :3] + unsure

    def _part(self, begin: int, end: int) -> Array:
        return np.frombuffer(self.kept)[begin:end]


def looked(lift: Lift, now: Array, last: Look, most: int) -> Lift:
    """The lift after its `last` look, with its information `now` (4, 5 + P + D); at `most` so many are kept."""
    marks, tilt = np.concatenate([lift.marks[1 - most :], now[None]]), lift.tilt
    looks = (*lift.looks[1 - most :], last)
    return lift._replace(marks=marks, looks=looks, tilt=last.tilt if tilt is None else tilt)


def shortened(lift: Lift, fresh: Lift, at: int, now: Array, last: Look, every: int) -> Lift:
    """A lift from its look `at` on, when another load began to hang; `now` (4, 5 + P + D): what is known at the `last`
    look; `every`: samples between looks. `fresh`: a lift of which nothing is known yet."""
    nothing, begun = fresh.marks[0], lift.looks[at]
    told = np.concatenate([lift.marks[at:], now[None]]) - lift.marks[at] + nothing
    root, gram = informed(told[-1])
    looks = tuple(look._replace(moving=look.moving - begun.moving) for look in (*lift.looks[at:], last))
    numbers, taken = kept(root, *solution(root), gram), (len(told) - 1) * every
    return Lift(numbers, taken, 0, looks[-1].moving, lift.rested, told, looks, lift.mixed, begun.tilt)


def kept(root: Root, values: Array, covariance: Array, gram: Array) -> Numbers:
    """The numbers of a lift, as the kernel keeps them."""
    return numbers(np.concatenate([np.ravel(part) for part in (*root, values, covariance, gram)]))


class Weight(NamedTuple):
    """Mass [kg] with standard error [kg]; centre x + i z [m] of the load in the last link's frame with the standard
    errors (x, z) [m]; `drifted` [kg m]: standard error of the first moment by a drift that is not known yet."""

    mass: float
    standard_error: float
    centre: complex
    centre_error: tuple[float, float]
    drifted: float
