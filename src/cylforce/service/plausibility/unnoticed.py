"""Which error of each signal does the motion allow, and what would it do to a weight or a force?

Each signal is off by something. What is far off is noticed. For the rest the torques of all joints tell how large it
probably is: the size with which they are explained best, beside a load of its own in each lift and everyday changes of
friction and zeros. A load explains nearly as much, so that this is hardly ever evidence, and yet its mass would change.
Such changes, of each signal by itself, are a part of the standard errors of weight and force.

In the weight they count as far as there is evidence that any signal is off at all. That none is, or one of them, each
by itself, is as probable before anything is seen; how large an error is, is then known no better than from one
independent sample (the unit information prior of Kass and Wasserman, doi:10.1080/01621459.1995.10476592), a pressure's
no larger than its sensor's class unless the torques tell. With an error
of signal h that is z_h standard errors large, N independent samples are exp(z_h^2 / 2) / sqrt(1 + N) times as probable
as without. Where the torques scatter more than at commissioning, z_h is that much smaller (Birge ratio)."""

from dataclasses import dataclass
from math import exp, sqrt
from typing import NamedTuple

import numpy as np

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.solving import ZERO
from cylforce.service.adaptation import Drift
from cylforce.service.booking import Probable
from cylforce.service.plausibility.blocks import EVERY, LOAD, SAMPLES, Gatherer, Gathering
from cylforce.signals.estimate import Array

# Seconds in the air after which older ones have faded to 1/e: about a working cycle's, so that an error that has just
# come counts as soon; 10 to 48 give the same standard errors in order.
MEMORY = 10.0
CLASS = 2.0 / 3.0**0.5  # bar: standard error of a pressure sensor of class 0.5 and 400 bar, evenly within 2 bar
MOST = 50.0  # logarithm of odds from which on an error is certain: beyond the precision of a probability, 1e-16


class Unnoticed(NamedTuple):
    """State, of H signals: rows (K, K) of the `lift` so far, in seconds that a load explains; those of the lifts
    `before` (K-4, K-4), their loads taken out, faded; samples `taken` of the lift; probable error of each signal,
    in the gatherer's units; change of the mass [kg] in the bucket per unit of each (`slopes`) (H,); `torques` (R, H)
    [N m] by these errors at the moment; standard error `mass` [kg] of the mass in the bucket by these errors; how many
    `seconds` are in `lift` and in `before`."""

    lift: Array
    before: Array
    taken: int
    probable: Probable
    slopes: Array
    torques: Array
    mass: float = 0.0
    seconds: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Noticing:
    """The errors of one machine's signals."""

    gatherer: Gatherer

    def begin(self) -> Unnoticed:
        """Nothing was seen."""
        empty, none = self.gatherer.begin(), np.zeros(self.gatherer.size)
        return Unnoticed(empty.gram, empty.gram[LOAD:, LOAD:], 0, Probable(none, none), none, empty.errors)

    def interrupt(self, state: Unnoticed) -> Unnoticed:
        """The lift has ended, or the measurement stopped."""
        before, seconds = state.before + self._without_load(state.lift), (0.0, sum(state.seconds))
        return state._replace(lift=np.zeros_like(state.lift), before=before, taken=0, seconds=seconds)

    def step(
        self, state: Unnoticed, gathering: Gathering, turned: Array, taken: int, drift: Drift, *, hangs: bool
    ) -> Unnoticed:
        """The state after a sample of `gathering`, what errors seem to take from a force at the tool (`turned` (R, H)
        [N m]), the lift's `taken` samples, the `drift` that is taken out of the weight, and whether this was the last
        one of a second that a load explains."""
        state = (self.interrupt(state) if taken < state.taken else state)._replace(taken=taken)
        if hangs and taken >= SAMPLES * EVERY:
            state = self._with(state, self.gatherer.less(gathering.last, drift))
        of, slopes = self.gatherer, ZERO * self.gatherer.size
        told = (len(state.lift), of.prior, of.memory, of.size, ZERO * (2 * LOAD * LOAD))
        choice.chosen().notice(state.lift, gathering.gram, *told, slopes)
        return self._wider(state, np.frombuffer(slopes), (gathering.errors + turned) * state.probable.sizes)

    def _wider(self, state: Unnoticed, slopes: Array, torques: Array) -> Unnoticed:
        """With what errors of signals do at the moment."""
        wrong = slopes * state.probable.expected
        return state._replace(slopes=slopes, torques=torques, mass=sqrt(float(wrong @ wrong)))

    def _with(self, state: Unnoticed, block: Array) -> Unnoticed:
        """With one more second of the lift, (K, K)."""
        fading, (of_lift, of_before) = exp(-1.0 / MEMORY), state.seconds
        seconds = (of_lift + 1.0, fading * of_before)
        state = state._replace(lift=state.lift + block, before=state.before * fading, seconds=seconds)
        left = state.before + self._without_load(state.lift)
        known = len(left) - self.gatherer.size - 1
        changes = np.linalg.inv(left[:known, :known] + np.eye(known))
        own = left[known:, known:] - left[known:, :known] @ changes @ left[:known, known:]
        square = np.diagonal(own)[:-1]
        square = np.where(square > 0.0, square, np.inf)
        sizes = own[:-1, -1] / square
        certain = np.sqrt(np.maximum(sizes**2 - 1.0 / square, 0.0))
        samples = sum(seconds) * SAMPLES * len(state.torques) / self.gatherer.memory
        evidence = sizes * own[:-1, -1]
        sizes = self._plausible(sizes, square)
        return state._replace(probable=Probable(sizes, certain, off(evidence, float(own[-1, -1]), samples)))

    def _plausible(self, sizes: Array, square: Array) -> Array:
        """The errors (H,) that explain the torques best, known with the information `square` (H,), and what sensors'
        classes say of pressures: where the torques hardly tell, nothing. An angle may slip by any size."""
        pressures = len(self.gatherer.pressed)
        known = 1.0 / (1.0 + CLASS**-2.0 / square[:pressures])
        return np.concatenate([known * sizes[:pressures], sizes[pressures:]])

    def _without_load(self, rows: Array) -> Array:
        """Rows (K-4, K-4) of a lift (K, K), its load taken out."""
        own = rows / self.gatherer.memory
        load = np.linalg.inv(own[:LOAD, :LOAD] + np.diag(self.gatherer.prior[:LOAD]))
        return np.asarray(own[LOAD:, LOAD:] - own[LOAD:, :LOAD] @ load @ own[:LOAD, LOAD:])


def off(evidence: Array, left: float, samples: float) -> float:
    """Probability that a signal is off, from the squares (H,) of the errors that explain the torques best, each over
    its variance, and what is `left` of the squares of so many independent `samples`, without an error."""
    scatter = max(1.0, (left - float(evidence.max())) / samples)
    likely = np.exp(np.minimum(evidence / (2.0 * scatter), MOST)) / sqrt(1.0 + samples)
    odds = float(likely.sum())
    return odds / (1.0 + odds)
