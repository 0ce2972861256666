"""A lift: what the rows since its beginning say about the load, and what is concluded from them."""

from dataclasses import dataclass
from math import sqrt
from typing import Self

import numpy as np

from cylforce.estimation.kernel.layout import LIFT, part
from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.estimation.recursive import Root, known, solution
from cylforce.service.adaptation import DriftKnowledge
from cylforce.service.snapshot import Estimator
from cylforce.service.spill import block_diagonal, information, root_and_gram
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class Look:
    """A moment at which the lift was examined for a spill.

    moving: number of samples in motion before it
    tilt:   angle of the tool to the house then [rad]; None where the tool does not empty by tilting
    """

    moving: int
    tilt: float | None


@dataclass(slots=True)
class Lift(Estimator):
    """Recursive estimate of the load's (m, m x, m z, J about the last pin), without drift.

    numbers: information, estimate, covariance and gram, as the kernel keeps them (`LiftLayout`)
    taken:   number of samples that the load fits
    refused: number of samples in a row that it does not fit
    moving:  number of samples in motion
    rested:  (R,) number of samples for which each row has been at rest, less those in motion since
    marks:   (M, 4, 5 + P + D) information about the load at the last looks
    looks:   the last M looks for a spill
    mixed:   whether the filters still contain what was before the lift
    tilt:    angle of the tool at the first look, when this load began to hang [rad]; None: no look yet
    """

    numbers: Numbers
    taken: int
    refused: int
    moving: int
    rested: Numbers
    marks: Array
    looks: tuple[Look, ...]
    mixed: bool
    tilt: float | None = None

    @classmethod
    def start(cls, spread: Array, parameters: int, rows: int, *, mixed: bool = False) -> Self:
        """Return a lift of which nothing is known.

        spread:     (4,) standard errors of a load before anything is seen
        parameters: P + D
        rows:       R
        """
        root, nothing = known(np.zeros(4), spread), np.zeros((4, parameters))
        marks = information(root, nothing)[None]
        return cls(
            lift_numbers(root, nothing),
            taken=0,
            refused=0,
            moving=0,
            rested=ZERO * rows,
            marks=marks,
            looks=(Look(0, None),),
            mixed=mixed,
        )

    @property
    def root(self) -> Root:
        """The information R'R on the load as its triangle, with the right-hand side."""
        return Root(part(self.numbers, LIFT.factor).reshape(4, 4), part(self.numbers, LIFT.right))

    @property
    def values(self) -> Array:
        """The estimate (4,)."""
        return part(self.numbers, LIFT.values)

    @property
    def covariance(self) -> Array:
        """Its covariance (4, 4)."""
        return part(self.numbers, LIFT.covariance).reshape(4, 4)

    @property
    def gram(self) -> Array:
        """(4, P + D), with which its sensitivity to tares and drift is covariance @ gram."""
        return part(self.numbers, LIFT.gram).reshape(4, -1)

    def error_by_drift(self, covariance: Array) -> float:
        """Return the standard error [kg] of the mass by a drift of this `covariance` (D, D)."""
        gain = self.covariance[0] @ self.gram[:, -len(covariance) :]
        return sqrt(max(float(gain @ covariance @ gain), 0.0))

    def moments(self, tares: Array, drift: DriftKnowledge, colder: float = 1.0) -> tuple[Array, Array]:
        """Return mass [kg] and first moments [kg m] (3,) less the drift, and their covariance (3, 3).

        tares:  (P, P) covariance of the tares
        colder: factor on the covariance of the drift
        """
        change = (self.covariance @ self.gram)[:3]
        unsure = change @ block_diagonal(tares, colder * drift.covariance) @ change.T
        return self.values[:3] - change[:, len(tares) :] @ drift.values, self.covariance[:3, :3] + unsure

    def look(self, now: Array, last: Look, most: int) -> None:
        """Keep a look and its information `now` (4, 5 + P + D); at `most` so many are kept."""
        self.marks = np.concatenate([self.marks[1 - most :], now[None]])
        self.looks = (*self.looks[1 - most :], last)
        self.tilt = last.tilt if self.tilt is None else self.tilt

    def since(self, at: int, now: Array, last: Look, every: int, nothing: Array) -> "Lift":
        """Return the lift from its look `at` on, when another load began to hang.

        now:     (4, 5 + P + D) information at the `last` look
        every:   samples between two looks
        nothing: (4, 5 + P + D) information of a lift of which nothing is known
        """
        begun = self.looks[at]
        marks = np.concatenate([self.marks[at:], now[None]]) - self.marks[at] + nothing
        root, gram = root_and_gram(marks[-1])
        looks = tuple(Look(look.moving - begun.moving, look.tilt) for look in (*self.looks[at:], last))
        return Lift(
            lift_numbers(root, gram),
            taken=(len(marks) - 1) * every,
            refused=0,
            moving=looks[-1].moving,
            rested=self.rested,
            marks=marks,
            looks=looks,
            mixed=self.mixed,
            tilt=begun.tilt,
        )


def lift_numbers(root: Root, gram: Array, estimate: tuple[Array, Array] | None = None) -> Numbers:
    """Return the numbers of a lift as the kernel keeps them; `estimate`: values (4,) and covariance (4, 4) where they
    are known, else they are solved from the root."""
    values, covariance = solution(root) if estimate is None else estimate
    return numbers(np.concatenate([np.ravel(each) for each in (*root, values, covariance, gram)]))


@dataclass(slots=True)
class Weight:
    """What a lift concludes about the load.

    mass:           [kg]
    standard_error: of the mass by noise, tares, drift and scale [kg]
    centre:         x + i z of the load in the last link's frame [m]
    centre_error:   standard errors of x and z [m]
    drifted:        standard error of the first moment by a drift that is not known yet [kg m]
    """

    mass: float
    standard_error: float
    centre: complex
    centre_error: tuple[float, float]
    drifted: float
