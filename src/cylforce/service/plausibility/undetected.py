"""Undetected bias: the probable error of each signal that no detector finds, and its effect on weight and force.

Every signal has an error. Large errors are detected. The probable size of a smaller one explains the torques of all
joints best, beside a load of its own in each lift and the usual changes of friction and zeros. A load
explains nearly as much, so that this size is hardly ever evidence, although it changes the load's mass. These changes,
of each signal by itself, are a part of the standard errors of weight and force.

In the weight they count by the probability that any signal has an error at all. A priori no error, and an error of
each single signal, are equally probable. The prior of the size carries the information of one independent sample (unit
information prior, Kass and Wasserman, doi:10.1080/01621459.1995.10476592). An error of a pressure is bounded by its
sensor's class unless the torques determine it. With an error of signal h that is z_h standard errors large, N
independent samples are exp(z_h^2 / 2) / sqrt(1 + N) times as probable as without. Where the torques scatter more than
at commissioning, z_h is divided by that factor (Birge ratio)."""

from dataclasses import dataclass
from math import exp, sqrt
from typing import Self

import numpy as np

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.service.adaptation import DriftFilter
from cylforce.service.booking import ProbableErrors
from cylforce.service.plausibility.blocks import EVERY, LOAD, SAMPLES, BlockConstants, BlockGatherer
from cylforce.service.snapshot import Estimator
from cylforce.signals.estimate import Array, Force, Status

# Seconds in the air after which those of earlier lifts have faded to 1/e: about a working cycle's, so that a new error
# soon counts; 10 to 48 give the same standard errors on healthy machines.
MEMORY = 10.0
CLASS = 2.0 / 3.0**0.5  # bar: standard error of a pressure sensor of class 0.5 and 400 bar, evenly within 2 bar
MOST = 50.0  # logarithm of odds from which on an error is certain: beyond the precision of a probability, 1e-16


@dataclass(slots=True)
class UndetectedErrors(Estimator):
    """Estimator of the probable errors of H signals, and of their effect.

    constants: of the blocks
    lift:      (K, K) products of the rows of the present lift, from seconds that a load explains
    before:    (K-4, K-4) products of the rows of earlier lifts, their loads eliminated, faded
    taken:     number of samples of the lift
    probable:  errors of the signals, in the blocks' units
    slopes:    (H,) change of the mass in the bucket per unit of each error [kg]
    torques:   (R, H) present torques by these errors [N m]
    mass:      standard error of the mass in the bucket by these errors [kg]
    of_lift:   number of seconds in `lift`
    of_before: number of seconds in `before`, faded
    """

    constants: BlockConstants
    lift: Array
    before: Array
    taken: int
    probable: ProbableErrors
    slopes: Array
    torques: Array
    mass: float = 0.0
    of_lift: float = 0.0
    of_before: float = 0.0

    @classmethod
    def start(cls, constants: BlockConstants) -> Self:
        """Return the state before any sample: no lift, no signal with a probable error.

        The products of rows have K columns: load (4), friction and zeros (D), errors of signals (H), residual (1)."""
        size, none = len(constants.prior) + constants.size + 1, np.zeros(constants.size)
        lift, torques = np.zeros((size, size)), np.zeros((constants.rows, constants.size))
        return cls(
            constants,
            lift=lift,
            before=lift[LOAD:, LOAD:],
            taken=0,
            probable=ProbableErrors(none, none),
            slopes=none,
            torques=torques,
        )

    def end_lift(self) -> None:
        """Begin another lift, because the present one has ended or the measurement stopped.

        The products of the ended lift's rows in motion (measured torques, and the columns that explain them) are added
        to those of earlier lifts, with the load eliminated."""
        self.before = self.before + self._without_load(self.lift)
        self.of_lift, self.of_before = 0.0, self.of_lift + self.of_before
        self.lift, self.taken = np.zeros_like(self.lift), 0

    def update(
        self, blocks: BlockGatherer, channels: Numbers, resultant: Force, taken: int, drift: DriftFilter
    ) -> None:
        """Update the probable errors of the signals, and their effect on weight and torques, with one sample.

        The errors change after a second of motion in the air that a load explains. Their effect on the mass [kg] and on
        the joint torques [N m] follows each sample.

        blocks:    seconds of motion, including this sample
        channels:  (D,) joint angles [rad], cylinder forces [N] and attitude, filtered like the rows of the weighing
        resultant: force at the tool, which an error of an angle seems to rotate
        taken:     number of samples of the lift; a smaller one than before means another lift
        drift:     of friction and zeros that is subtracted in the weight
        """
        c = self.constants
        if taken < self.taken:
            self.end_lift()
        self.taken = taken
        if blocks.explained and taken >= SAMPLES * EVERY:
            self._take_second(c.without_zeros(blocks.last, drift))
        slopes, room = ZERO * c.size, ZERO * (2 * LOAD * LOAD)
        c.kernel.mass_slopes(self.lift, blocks.products, len(self.lift), c.prior, c.memory, c.size, room, slopes)
        self.slopes = np.frombuffer(slopes)
        turned = c.turned_force(channels, acting(resultant))
        self.torques = (blocks.errors + turned) * self.probable.sizes
        errors = self.slopes * self.probable.expected
        self.mass = sqrt(float(errors @ errors))

    def _take_second(self, block: Array) -> None:
        """Estimate the probable errors of the signals anew with one more second of the lift.

        Load, friction and zeros are eliminated from the products of all rows; the seconds of earlier lifts fade with
        MEMORY [s], those of the present lift do not. Each error by itself is the one that explains the remaining
        residual best.

        block: (K, K) products of the rows [load (4) | friction and zeros (D) | errors (H) | residual] of this second
        """
        c, fading = self.constants, exp(-1.0 / MEMORY)
        self.of_lift, self.of_before = self.of_lift + 1.0, fading * self.of_before
        self.lift, self.before = self.lift + block, self.before * fading
        gram = self.before + self._without_load(self.lift)
        known = len(gram) - c.size - 1
        changes = np.linalg.inv(gram[:known, :known] + np.eye(known))  # covariance of friction and zeros
        # (H + 1, H + 1) products of [errors | residual] with friction and zeros eliminated
        own = gram[known:, known:] - gram[known:, :known] @ changes @ gram[:known, known:]
        square = np.diagonal(own)[:-1]  # (H,) information on each error by itself
        square = np.where(square > 0.0, square, np.inf)
        sizes = own[:-1, -1] / square
        certain = np.sqrt(np.maximum(sizes**2 - 1.0 / square, 0.0))
        samples = (self.of_lift + self.of_before) * SAMPLES * len(self.torques) / c.memory
        probability = off_probability(sizes * own[:-1, -1], float(own[-1, -1]), samples)
        self.probable = ProbableErrors(self.within_class(sizes, square), certain, probability)

    def within_class(self, sizes: Array, square: Array) -> Array:
        """Return the errors (H,), those of pressures with the prior of their sensors' class, 0 +- CLASS.

        An angle may slip by any size, so that its error is unchanged.

        sizes:  (H,) errors that explain the torques best
        square: (H,) information of the torques on them
        """
        pressures = len(self.constants.pressed)
        known = 1.0 / (1.0 + CLASS**-2.0 / square[:pressures])
        return np.concatenate([known * sizes[:pressures], sizes[pressures:]])

    def _without_load(self, rows: Array) -> Array:
        """Return the products (K-4, K-4) of a lift's rows with its own load eliminated.

        They are divided by `memory`, the number of samples that count as one independent sample.

        rows: (K, K) products of the columns [load (4) | friction and zeros | errors | residual]
        """
        c, own = self.constants, rows / self.constants.memory
        load = np.linalg.inv(own[:LOAD, :LOAD] + np.diag(c.prior[:LOAD]))
        return np.asarray(own[LOAD:, LOAD:] - own[LOAD:, :LOAD] @ load @ own[:LOAD, LOAD:])


def off_probability(evidence: Array, residual: float, samples: float) -> float:
    """Return the probability that any of H signals has an error, a priori as probable for each as for none.

    evidence: (H,) squares of the errors that explain the torques best, each over its variance
    residual: sum of squares of the residual without an error, in squares of standard errors
    samples:  N, number of independent samples
    """
    scatter = max(1.0, (residual - float(evidence.max())) / samples)
    likely = np.exp(np.minimum(evidence / (2.0 * scatter), MOST)) / sqrt(1.0 + samples)
    odds = float(likely.sum())
    return odds / (1.0 + odds)


def acting(force: Force) -> complex:
    """Return a force as x + i z [N]; 0 where it is not known."""
    known = Status.INVALID not in (force.x.status, force.z.status)
    return complex(force.x.value, force.z.value) if known else 0j
