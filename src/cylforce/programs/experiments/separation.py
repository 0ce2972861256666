"""Separation of the causes that are still possible by a motion: expected information (ASID, arXiv 2404.12308).

Cause a with sizes s_a adds X_a s_a to the torques. Another cause b with free sizes, and the uncertain parameters of the
machine, reproduce some of it. The remainder, squared and in units of noise and discrepancy, is the distance D_ab. The
probability that two causes are confused is at most sqrt(p_a p_b) exp(-D_ab / 8) (Bhattacharyya). The information of a
recording is -8 log of the sum over all causes that may be confused with the likeliest one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from cylforce.diagnosis.constants import SAME_EVIDENCE
from cylforce.diagnosis.decide import HypothesisEvidence
from cylforce.diagnosis.model import CENTRE, ColumnLayout, HealthyMachine
from cylforce.diagnosis.search import NO_GAP, UNKNOWN, Candidate, Key
from cylforce.diagnosis.statistics import Blocks, Gram, SharedNoise
from cylforce.effects.library import Proposal
from cylforce.programs.experiments.catalogue import SECONDS, STAIRS_S, TOGETHER_S, RecommendedMotion, catalogue
from cylforce.readings.constants import LOAD_CENTRE
from cylforce.readings.recording import Recording
from cylforce.signals.estimate import Array
from cylforce.simulation.sensing import true_values
from cylforce.simulation.simulator import Truth, draw_truth, simulate

MOST_RIVALS = 4  # causes that are compared
MOST_ADVICE = 3  # motions that are recommended
WORTH = 1.25  # times as much information must a load, a slope, warm oil bring to be recommended; chosen
TIMES = 100.0  # a factor beyond which no number is printed
LONGEST = (TOGETHER_S + STAIRS_S) / SECONDS  # times a motion of the catalogue: as long as a whole check-up


@dataclass(frozen=True)
class RivalCause:
    """Cause that is still possible.

    key:         name and location
    probability: posterior
    proposal:    the effect; None: the machine is healthy
    sizes:       (M,) its most probable sizes [SI]; (0,) without an effect
    """

    key: Key
    probability: float
    proposal: Proposal | None
    sizes: Array


@dataclass(frozen=True)
class MotionAdvice:
    """A motion to record next.

    motion:    the motion
    times:     its information in units of that of the present recordings, for the same duration
    separates: pairs of causes of which it makes one more probable by SAME_EVIDENCE at least
    """

    motion: RecommendedMotion
    times: float
    separates: tuple[tuple[Key, Key], ...]


@dataclass(frozen=True)
class MotionPlan:
    """Plan of the next recordings.

    advice:      motions, the best one first; empty where nothing is open, or no motion of the catalogue helps
    inseparable: causes, the likeliest one first, that no motion of the catalogue separates; empty if there are none
    stop_first:  whether the machine works in the recordings: it has to stop and move in the air
    """

    advice: tuple[MotionAdvice, ...] = ()
    inseparable: tuple[Key, ...] = ()
    stop_first: bool = False


def rivals(evidence: HypothesisEvidence) -> tuple[RivalCause, ...]:
    """Return the causes of the credible set that have a signature: no transients, and not the unknown cause."""
    found = list[RivalCause]()
    for key in evidence.credible:
        probability = evidence.posterior[key]
        if key == NO_GAP:
            found.append(RivalCause(key, probability, None, np.zeros(0)))
            continue
        candidate = None if key == UNKNOWN else _simplest(evidence, key)
        if candidate is None:
            continue
        proposal, sizes = _of_candidate(candidate, key)
        if proposal.course is None or proposal.clock:
            found.append(RivalCause(key, probability, proposal, sizes))
    return tuple(found[:MOST_RIVALS])


def _simplest(evidence: HypothesisEvidence, key: Key) -> Candidate | None:
    """Return the most probable hypothesis of a cause by itself, else the most probable one with others."""
    alone = [c for c in evidence.candidates if c.keys == {key} and len(c.hypothesis.forms) == 1]
    return max(alone, key=lambda c: c.log + evidence.prior_of(c), default=evidence.best_of(key))


def _of_candidate(candidate: Candidate, key: Key) -> tuple[Proposal, Array]:
    """Return the effect of a hypothesis with this name and location, and its sizes (M,) [SI]."""
    question, hypothesis = candidate.question, candidate.hypothesis
    ends = np.cumsum([0, *(len(question.forms[form].columns) for form in hypothesis.forms)]).tolist()
    for form, (first, last) in zip(hypothesis.forms, pairwise(ends), strict=True):
        if candidate.key(form) == key:
            return question.proposals[form], hypothesis.sizes[first:last] * question.unit_of(form)
    raise ValueError(f"{key} is no effect of this hypothesis")


@dataclass(frozen=True)
class Separation:
    """Distances between causes on recordings of one machine.

    machine:  the healthy machine
    rivals:   the causes, K sizes in all
    strength: factor that tempers all evidence
    """

    machine: HealthyMachine
    rivals: tuple[RivalCause, ...]
    strength: float = 1.0

    @cached_property
    def _layout(self) -> ColumnLayout:
        effects = tuple(r.proposal for r in self.rivals if r.proposal is not None)
        return ColumnLayout(self.machine.regressors.model, effects, self.machine.layout.base_moves)

    @cached_property
    def _columns(self) -> list[int]:
        """Columns of the causes' sizes (K,)."""
        return [column for columns in self._layout.places for column in columns]

    @cached_property
    def unit(self) -> Array:
        """Typical sizes (K,)."""
        return np.asarray(self._layout.unit[self._columns])

    @cached_property
    def _own(self) -> list[list[int]]:
        """Numbers of the sizes of each cause, 0..K-1."""
        ends = np.cumsum([0, *(len(r.sizes) for r in self.rivals)]).tolist()
        return [list(range(first, last)) for first, last in pairwise(ends)]

    @cached_property
    def _prior(self) -> Array:
        """Prior precision (P, P) of the machine's parameters and bars, in units of their typical sizes."""
        count, known = self._layout.first, self.machine.machine
        covariance = known.covariance[:count, :count] + np.diag(known.variation[:count] ** 2 + 1e-12)
        return np.asarray(np.linalg.inv(covariance))

    # Information on the sizes

    def recorded(self, recordings: Sequence[Recording]) -> Array:
        """Return the information (K, K) of recordings on the causes' sizes."""
        return np.asarray(np.sum([self._marginal(each) for each in recordings], axis=0))

    def of(self, motion: RecommendedMotion) -> Array:
        """Return the same of one recording of a motion."""
        machine, filters = self.machine.regressors.model.machine, self.machine.regressors.model.filters
        t = np.arange(round(motion.scene.duration * filters.rate_hz)) / filters.rate_hz
        truth = self._nominal._replace(pitch=motion.pitch)
        values = true_values(machine, simulate(machine, truth, motion.scene, t, 0.0))
        return self._marginal(Recording(motion.words, values, motion.load_kg, motion.worked_s))

    @cached_property
    def _nominal(self) -> Truth:
        """A machine as the machine file has it, on level ground."""
        machine = self.machine.regressors.model.machine
        return draw_truth(machine, np.random.default_rng(0), 0.0)._replace(pitch=0.0, roll=0.0)

    def _marginal(self, recording: Recording) -> Array:
        """Return the information (K, K) of a recording, the machine's parameters and its load's centre unknown.

        S = I_ss - I_sg (I_gg + C^-1)^-1 I_gs, s the sizes, g the parameters.
        """
        layout, regressors = self._layout, self.machine.regressors
        whole = layout.columns(regressors.rows(recording, layout.proposals), recording)
        count = layout.first
        load = [layout.size + 1 + k for k in range(CENTRE)] if recording.load_kg else []
        columns = whole[..., [*range(count), *load, *self._columns, -1]]
        unit = np.concatenate([layout.unit[:count], LOAD_CENTRE[: len(load)], self.unit])
        blocks = Blocks.whitened(columns, self.machine.floor)
        none = SharedNoise.none(columns.shape[1], len(unit) + 1)
        gram = Gram.of(blocks, range(len(unit)), unit, none)
        information = self.machine.machine.noise.information(gram)[:-1, :-1]
        first = count + len(load)
        precision = np.eye(first)
        precision[:count, :count] = self._prior
        across = information[:first, first:]
        taken = across.T @ np.linalg.solve(information[:first, :first] + precision, across)
        return np.asarray(information[first:, first:] - taken)

    # Distances

    def information(self, sizes: Array) -> float:
        """Return -8 log of the probability that the first cause is confused with another, by information (K, K)."""
        weight = np.sqrt([r.probability for r in self.rivals[1:]])
        apart = np.array([self.distance(sizes, 0, j) for j in range(1, len(self.rivals))])
        least = float(np.min(apart))
        return least - 8.0 * float(np.log(np.sum(weight * np.exp(-(apart - least) / 8.0)) / np.sum(weight)))

    def distance(self, sizes: Array, i: int, j: int) -> float:
        """Return the squared distance of the signatures of two causes, the mean of both ways, tempered."""
        return self.strength * (self._remainder(sizes, i, j) + self._remainder(sizes, j, i)) / 2.0

    def _remainder(self, information: Array, i: int, j: int) -> float:
        """Return the square of the signature of cause i that cause j does not reproduce."""
        a, b = self._own[i], self._own[j]
        sizes = self.rivals[i].sizes / self.unit[a]
        across = information[np.ix_(b, a)] @ sizes
        own = information[np.ix_(b, b)] + np.eye(len(b))
        taken = float(across @ np.linalg.solve(own, across))
        return max(float(sizes @ information[np.ix_(a, a)] @ sizes) - taken, 0.0)

    def pairs(self, sizes: Array) -> frozenset[tuple[Key, Key]]:
        """Return the pairs of causes that information (K, K) separates: D / 2 nats are SAME_EVIDENCE or more."""
        numbers = range(len(self.rivals))
        return frozenset(
            (self.rivals[i].key, self.rivals[j].key)
            for i in numbers
            for j in numbers[i + 1 :]
            if self.distance(sizes, i, j) / 2.0 >= SAME_EVIDENCE
        )


def planned(evidence: HypothesisEvidence) -> MotionPlan:
    """Return the motions that best separate the causes that are still possible, and the causes that no motion
    separates.
    """
    question = evidence.found.question
    stop, open_causes = evidence.found.work is not None, rivals(evidence)
    if len(open_causes) < 2:
        return MotionPlan(stop_first=stop)
    separation = Separation(question.machine, open_causes, evidence.strength)
    recordings = [seen.recording for seen in question.seen]
    seconds = sum(len(each.values) for each in recordings) / question.machine.regressors.model.filters.rate_hz
    present = separation.information(separation.recorded(recordings))
    machine = question.machine.regressors.model.machine
    motions = list(catalogue(machine, _joints(evidence, open_causes)))
    matrices = [separation.of(motion) for motion in motions]
    each = []
    for motion, matrix in zip(motions, matrices, strict=True):
        information = separation.information(matrix * seconds / motion.scene.duration)
        times = information / present if present > 0.0 else np.inf
        each.append(MotionAdvice(motion, times, tuple(sorted(separation.pairs(matrix)))))
    ever = frozenset[tuple[Key, Key]]().union(*(separation.pairs(LONGEST * matrix) for matrix in matrices))
    first = open_causes[0].key
    alike = tuple(r.key for r in open_causes[1:] if (first, r.key) not in ever)
    if len(alike) == len(open_causes) - 1:
        return MotionPlan(inseparable=(first, *alike), stop_first=stop)
    best = sorted(_worth(each), key=lambda advice: -advice.times)[:MOST_ADVICE]
    return MotionPlan(tuple(best), (first, *alike) if alike else (), stop)


def _worth(each: Sequence[MotionAdvice]) -> list[MotionAdvice]:
    """Return the motions without those that need more than another one, and bring hardly more information."""
    return [
        a
        for a in each
        if not any(a.motion.words.startswith(f"{o.motion.words},") and a.times < WORTH * o.times for o in each)
    ]


def _joints(evidence: HypothesisEvidence, causes: Sequence[RivalCause]) -> list[int]:
    """Return the joints at which the gap is largest over its noise floor, as many as there are causes at most."""
    model = evidence.found.question.machine.regressors.model
    order = np.argsort(-evidence.found.gaps)[: max(len(causes) - 1, 1)]
    return [model.machine.rows[r] for r in order.tolist()]


def sentences(plan: MotionPlan) -> list[str]:
    """Return a plan as sentences."""
    found = [STOP] if plan.stop_first else []
    for each in plan.advice:
        many = f"more than {TIMES:.0f} times" if each.times > TIMES else f"{each.times:.2g} times"
        found.append(f"{each.motion.words}: {many} the information of this recording in the same time")
    return found


STOP = "stop working, and move all joints in the air with an empty bucket: cylforce checkup says which motion decides"
