"""How well a motion would tell the most probable candidates apart: expected information (ASID, arXiv 2404.12308).

Candidate a, with the size found, leaves the signature X_a s_a in the torques. Another candidate b, and the machine's
parameters as well as the references tell them, take up of it what they can; what they cannot, squared and in units of
noise and discrepancy, is the distance D_ab. Two candidates are then confused with at most the probability
sqrt(p_a p_b) exp(-D_ab / 8) (Bhattacharyya); -8 log of the sum over all that may be confused with the likeliest one is
the information of a recording."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis import Diagnosis
from cylforce.diagnosis.recordings import Recording
from cylforce.diagnosis.regressors import LOAD_CENTRE
from cylforce.diagnosis.search import NO_GAP, UNKNOWN, Key, Question
from cylforce.diagnosis.statistics import Blocks, Gram, SharedNoise
from cylforce.effects.library import Proposal
from cylforce.programs.experiments.catalogue import SECONDS, Trial, catalogue
from cylforce.signals.estimate import Array
from cylforce.simulation.sensing import true_values
from cylforce.simulation.simulator import Truth, draw_truth, simulate

MOST_CANDIDATES = 3
MOST_TOLD = 3  # motions
AGAIN = "the same as in this recording, but for twice as long"
LONGER = 2.0  # times as long as the recording is the motion that anybody thinks of
WORTH = 1.25  # times as much must a load, a slope, warm oil tell; chosen
TIMES = 100.0  # a figure beyond which no number is told


class Candidate(NamedTuple):
    """What may be the cause, with its probability: its proposal and sizes (M,), none for a machine in order."""

    key: Key
    probability: float
    proposal: Proposal | None
    sizes: Array


class Told(NamedTuple):
    """What to record, and how many times the information of the present recording it brings in the same time."""

    words: str
    times: float


def candidates(found: Diagnosis) -> tuple[Candidate, ...]:
    """Return the most probable ones whose signature is known: none that happens in blocks, or that is unknown."""
    evidence, alone = found.evidence, {}
    for c in sorted((c for c in evidence.candidates if len(c.hypothesis.forms) == 1), key=lambda c: c.log):
        alone[c.key(c.hypothesis.forms[0])] = c
    each = []
    for key, probability in sorted(evidence.posterior.items(), key=lambda item: -item[1]):
        if key == NO_GAP:
            each.append(Candidate(key, probability, None, np.zeros(0)))
        elif key != UNKNOWN and key in alone:
            question, (form,) = alone[key].question, alone[key].hypothesis.forms
            if question.proposals[form].course is None:
                sizes = alone[key].hypothesis.sizes * question.unit_of(form)
                each.append(Candidate(key, probability, question.proposals[form], sizes))
    return tuple(c for c in each[:MOST_CANDIDATES] if c.probability > 0.0)


@dataclass(frozen=True)
class Separation:
    """Distances between candidates on recordings of one machine."""

    question: Question
    rivals: tuple[Candidate, ...]

    @cached_property
    def _wanted(self) -> list[Proposal]:
        return [c.proposal for c in self.rivals if c.proposal]

    @cached_property
    def _prior(self) -> tuple[Array, Array]:
        """Of the machine's parameters: units (P,), and precision (P, P) in these."""
        machine = self.question.machine
        size = len(machine.regressors.parameters)
        covariance = machine.machine.covariance[:size, :size]
        return machine.layout.unit[:size], np.asarray(np.linalg.inv(covariance + 1e-12 * np.eye(size)))

    @cached_property
    def _unit(self) -> Array:
        """Of the candidates' sizes (K,)."""
        return np.array([size for p in self._wanted for size in p.usual])

    @cached_property
    def _columns(self) -> list[Array]:
        """Columns (T, R, K) of the candidates in the present recordings."""
        regressors = self.question.machine.regressors
        each = self.question.seen
        found = (regressors.rows(s.recording, self._wanted, np.isnan(s.rows.residual)).effects for s in each)
        return [effects.astype(np.float64) for effects in found]

    def recorded(self) -> Array:
        """Information (K, K) on the candidates' sizes in the present recordings."""
        pairs = zip(self.question.seen, self._columns, strict=True)
        each = [self._told(s.rows.base, effects, s.rows.residual, s.recording.load_kg) for s, effects in pairs]
        return self._marginal(*(np.sum(part, axis=0) for part in zip(*each, strict=True)))

    def of(self, motion: Trial) -> Array:
        """The same in a recording of a motion, as long as the present ones."""
        recording = Recording(motion.words, self._values(motion), motion.load, motion.after)
        rows = self.question.machine.regressors.rows(recording, self._wanted)
        information, loads = self._told(rows.base, rows.effects.astype(np.float64), rows.residual, motion.load)
        return self._marginal(information * self.seconds / SECONDS, loads)

    @cached_property
    def seconds(self) -> float:
        """Length of the present recordings."""
        return sum(len(s.rows.t) for s in self.question.seen) / self.question.machine.regressors.rows_hz

    def _values(self, motion: Trial) -> Array:
        """Samples (T, S) of ideal sensors."""
        model = self.question.machine.regressors.model
        t = np.arange(round(SECONDS * model.filters.rate_hz)) / model.filters.rate_hz
        truth = self._truth._replace(pitch=motion.pitch)
        return true_values(model.machine, simulate(model.machine, truth, motion.scene, t, 0.0))

    @cached_property
    def _truth(self) -> Truth:
        """A machine as the file has it."""
        machine = self.question.machine.regressors.model.machine
        return draw_truth(machine, np.random.default_rng(0), 0.0)._replace(roll=0.0)

    def _told(self, base: Array, effects: Array, residual: Array, load_kg: float) -> tuple[Array, Array]:
        """Information (N, N) on parameters, load and candidates' sizes in a recording, in units of their spread; the
        prior precision of the load (3,)."""
        machine = self.question.machine
        centre = base @ machine.regressors.model.load[:, 1:] * LOAD_CENTRE
        usable = np.isfinite(residual)[..., None]
        columns = np.concatenate([base * self._prior[0], centre, effects * self._unit, residual[..., None]], -1)
        blocks, size = Blocks.whitened(np.where(usable, columns, np.nan), machine.floor), columns.shape[-1]
        gram = Gram.of(blocks, range(size - 1), np.ones(size - 1), SharedNoise.none(residual.shape[1], size))
        return machine.machine.noise.information(gram)[:-1, :-1], np.full(len(LOAD_CENTRE), 1.0 if load_kg else 1e12)

    def _marginal(self, information: Array, loads: Array) -> Array:
        """What is left of the information on the candidates' sizes (K, K), the others unknown as they are."""
        first = len(self._prior[0]) + len(loads)
        precision = np.zeros((first, first))
        precision[: len(self._prior[0]), : len(self._prior[0])] = self._prior[1]
        precision[len(self._prior[0]) :, len(self._prior[0]) :] = np.diag(loads)
        across = information[:first, first:]
        taken = across.T @ np.linalg.solve(information[:first, :first] + precision, across)
        return np.asarray(information[first:, first:] - taken)

    def information(self, told: Array) -> float:
        """-8 log of the probability that the first candidate is confused with another, by information (K, K)."""
        weight = np.sqrt([c.probability for c in self.rivals[1:]])
        others = range(1, len(self.rivals))
        apart = np.array([(self._distance(told, 0, j) + self._distance(told, j, 0)) / 2.0 for j in others])
        least = float(np.min(apart))
        return least - 8.0 * float(np.log(np.sum(weight * np.exp(-(apart - least) / 8.0)) / np.sum(weight)))

    def _distance(self, told: Array, i: int, j: int) -> float:
        """Squared distance of candidate i's signature from what candidate j can take up of it."""
        a, b = self._own(i), self._own(j)
        sizes = self.rivals[i].sizes / self._unit[a]
        across = told[np.ix_(b, a)] @ sizes
        own = told[np.ix_(b, b)] + np.eye(len(b))
        taken = float(across @ np.linalg.solve(own, across))
        return max(float(sizes @ told[np.ix_(a, a)] @ sizes) - taken, 0.0)

    def joints(self) -> list[int]:
        """The joints at which the candidates' signatures are largest in the present recordings."""
        machine, chosen, k = self.question.machine, list[int](), 0
        for c in self.rivals:
            if c.proposal is None:
                continue
            own = slice(k, k + len(c.sizes))
            k += len(c.sizes)
            energy = np.sum([np.nansum((x[..., own] @ c.sizes) ** 2, axis=0) for x in self._columns], axis=0)
            chosen.append(machine.regressors.model.machine.rows[int(np.argmax(energy / machine.floor.rms**2))])
        return list(dict.fromkeys(chosen))

    def _own(self, k: int) -> list[int]:
        """The columns of a candidate."""
        first = sum(len(c.sizes) for c in self.rivals[:k])
        return list(range(first, first + len(self.rivals[k].sizes)))


def planned(found: Diagnosis) -> tuple[Told, ...]:
    """The motions that tell the likeliest candidates apart best, the best first; none where there is but one."""
    rivals = candidates(found)
    if len(rivals) < 2:
        return ()
    separation = Separation(found.evidence.found.question, rivals)
    present = separation.information(separation.recorded())
    motions = catalogue(separation.question.machine.regressors.model.machine, separation.joints())
    each = [Told(m.words, _times(separation.information(separation.of(m)), present)) for m in motions]
    each.append(Told(AGAIN, LONGER))
    return tuple(t for t in sorted(_worth(each), key=lambda t: -t.times)[:MOST_TOLD] if t.times >= LONGER)


def _worth(each: Sequence[Told]) -> list[Told]:
    """Without those that ask for more than another motion, and tell hardly more."""
    return [t for t in each if not any(t.words.startswith(f"{o.words},") and t.times < WORTH * o.times for o in each)]


def _times(information: float, present: float) -> float:
    return information / present if present > 0.0 else np.inf


def said(told: Sequence[Told]) -> list[str]:
    """The motions as sentences."""
    return [f"{t.words}: tells {_many(t.times)} as much{_than(t)}" for t in told]


def _than(each: Told) -> str:
    return "" if each.words == AGAIN else " as this recording does in the same time"


def _many(times: float) -> str:
    return f"more than {TIMES:.0f} times" if times > TIMES else f"{times:.2g} times"
