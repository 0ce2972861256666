"""Lift: the recursive estimate of the load from the rows since its beginning, and the weight concluded from it."""

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
class SpillCheck:
    """Instant at which the lift was examined for a spill.

    moving: number of samples in motion before this instant
    tilt:   angle of the tool to the house at this instant [rad]; None where the tool does not empty by tilting
    """

    moving: int
    tilt: float | None


@dataclass(slots=True)
class Lift(Estimator):
    """Recursive estimate of the load's (m, m x, m z, J about the last pin), without drift.

    It depends on P tares (identified parameters of the empty machine) and D drifts (changes of friction and zeros). The
    gram (4, P + D) is the sensitivity to both, see `gram`. R is the number of measured torques (rows).

    numbers: information, estimate, covariance and gram, as the kernel keeps them (`LiftLayout`)
    taken:   number of samples that fit the load
    refused: number of samples in a row that do not fit the load
    moving:  number of samples in motion
    rested:  (R,) number of samples for which each row has been at rest, less those in motion since
    marks:   (M, 4, 5 + P + D) information about the load at the last M examinations for a spill, see `since`
    checks:  the last M examinations for a spill, oldest first
    mixed:   whether the filters still contain samples from before the lift
    tilt:    angle of the tool at the first examination, at the start of this load [rad]; None: not examined yet
    """

    numbers: Numbers
    taken: int
    refused: int
    moving: int
    rested: Numbers
    marks: Array
    checks: tuple[SpillCheck, ...]
    mixed: bool
    tilt: float | None = None

    @classmethod
    def start(cls, spread: Array, parameters: int, rows: int, *, mixed: bool = False) -> Self:
        """Return a lift without samples: the recursive estimate of a load (m, m x, m z, J) before its first row.

        spread:     (4,) prior standard errors of a load [kg, kg m, kg m, kg m^2]
        parameters: P + D, number of tares and drifts
        rows:       R, number of measured torques
        mixed:      whether the filters still contain another motion
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
            checks=(SpillCheck(0, None),),
            mixed=mixed,
        )

    @property
    def root(self) -> Root:
        """Information U'U on the load as its upper triangle U, with the right-hand side z: U load = z."""
        return Root(part(self.numbers, LIFT.factor).reshape(4, 4), part(self.numbers, LIFT.right))

    @property
    def values(self) -> Array:
        """Estimate (4,) of the load (m, m x, m z, J about the last pin) [kg, kg m, kg m, kg m^2]."""
        return part(self.numbers, LIFT.values)

    @property
    def covariance(self) -> Array:
        """Covariance (4, 4) of the load, in the units of `values`."""
        return part(self.numbers, LIFT.covariance).reshape(4, 4)

    @property
    def gram(self) -> Array:
        """Sum over the rows (4, P + D) of load columns times those of P tares and D drifts, over each row's variance.

        covariance @ gram is the change of the load (m, m x, m z, J) per unit of tares (identified parameters of the
        empty machine) and drifts (changes of friction and zeros), with the sign reversed."""
        return part(self.numbers, LIFT.gram).reshape(4, -1)

    def error_by_drift(self, covariance: Array) -> float:
        """Return the standard error [kg] of the mass by a drift with the `covariance` (D, D)."""
        gain = self.covariance[0] @ self.gram[:, -len(covariance) :]
        return sqrt(max(float(gain @ covariance @ gain), 0.0))

    def moments(self, tares: Array, drift: DriftKnowledge, colder: float = 1.0) -> tuple[Array, Array]:
        """Return mass [kg] and first moments x, z [kg m] (3,) of the load, and their covariance (3, 3).

        They are corrected by the drift. The covariance includes the errors of noise, tares and drift, but not of the
        scale.

        tares:  (P, P) covariance of the tares, the identified parameters of the empty machine
        drift:  of friction and zeros, with its covariance
        colder: factor on the covariance of the drift
        """
        change = (self.covariance @ self.gram)[:3]
        unsure = change @ block_diagonal(tares, colder * drift.covariance) @ change.T
        return self.values[:3] - change[:, len(tares) :] @ drift.values, self.covariance[:3, :3] + unsure

    def keep_check(self, now: Array, last: SpillCheck, most: int) -> None:
        """Append an examination for a spill, and drop the oldest one of more than `most`.

        The first one of a lift gives the `tilt` at the start of the load.

        now:  (4, 5 + P + D) information about the load at it
        last: the examination
        most: number of examinations that are kept
        """
        self.marks = np.concatenate([self.marks[1 - most :], now[None]])
        self.checks = (*self.checks[1 - most :], last)
        self.tilt = last.tilt if self.tilt is None else self.tilt

    def since(self, at: int, now: Array, last: SpillCheck, every: int, nothing: Array) -> "Lift":
        """Return the lift since an earlier examination for a spill, at which the load changed.

        Information on a load is its matrix U'U (4, 4), right-hand side U'z (4,) and gram (4, P + D) side by side. It is
        the prior plus a sum over the samples. The information at the earlier examination is therefore subtracted, and
        the prior added again.

        at:      place of that examination in `checks`
        now:     (4, 5 + P + D) information at the present examination
        last:    the present examination
        every:   samples between two examinations
        nothing: (4, 5 + P + D) information of a lift without samples: the prior
        """
        begun = self.checks[at]
        marks = np.concatenate([self.marks[at:], now[None]]) - self.marks[at] + nothing
        root, gram = root_and_gram(marks[-1])
        later = (*self.checks[at:], last)
        checks = tuple(SpillCheck(check.moving - begun.moving, check.tilt) for check in later)
        return Lift(
            lift_numbers(root, gram),
            taken=(len(marks) - 1) * every,
            refused=0,
            moving=checks[-1].moving,
            rested=self.rested,
            marks=marks,
            checks=checks,
            mixed=self.mixed,
            tilt=begun.tilt,
        )


def lift_numbers(root: Root, gram: Array, estimate: tuple[Array, Array] | None = None) -> Numbers:
    """Return the state of a lift as one flat array, in the kernel's order (`LiftLayout`).

    root:     information on the load (m, m x, m z, J): triangle (4, 4) and right-hand side (4,)
    gram:     (4, P + D) sum of load columns times columns of tares (identified parameters) and drift, over each row's
              variance, which is the sensitivity of the load to both
    estimate: values (4,) and covariance (4, 4) of the load; None: solved from the root
    """
    values, covariance = solution(root) if estimate is None else estimate
    return numbers(np.concatenate([np.ravel(each) for each in (*root, values, covariance, gram)]))


@dataclass(slots=True)
class Weight:
    """Load as concluded from a lift.

    mass:           of the load [kg]
    standard_error: of the mass by noise, tares, drift and scale [kg]
    centre:         of the load, x + i z in the last link's frame [m]
    centre_error:   standard errors of x and z by noise alone [m]
    drifted:        standard error of the first moment by a drift that is not estimated yet [kg m]
    """

    mass: float
    standard_error: float
    centre: complex
    centre_error: tuple[float, float]
    drifted: float
