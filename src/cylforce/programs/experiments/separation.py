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

from cylforce.diagnosis.answer.verdict import Search
from cylforce.diagnosis.columns.recorded import Columns, GapRows, Recorded
from cylforce.diagnosis.columns.rows import CENTRE
from cylforce.diagnosis.columns.statistics import Shared, statistics, white
from cylforce.diagnosis.inference.discrepancy import sums
from cylforce.diagnosis.inference.found import Found
from cylforce.diagnosis.inference.posterior import NOTHING, UNKNOWN, Key
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


def candidates(found: Found, search: Search) -> tuple[Candidate, ...]:
    """The most probable ones whose signature is known: none of those that come at moments, or are unknown."""
    alone = {}
    for h in sorted((h for h in found.asked.hypotheses if len(h.which) == 1), key=lambda h: h.log):
        alone[found.asked.key(h.which[0])] = h
    each = []
    for key, probability in sorted(search.belief.of.items(), key=lambda item: -item[1]):
        if key == NOTHING:
            each.append(Candidate(key, probability, None, np.zeros(0)))
        elif key != UNKNOWN and key in alone and found.question.forms[alone[key].which[0]][0].course is None:
            proposal, column = found.question.forms[alone[key].which[0]]
            sizes = alone[key].sizes * found.question.scene.spread[list(column.columns)]
            each.append(Candidate(key, probability, proposal, sizes))
    return tuple(c for c in each[:MOST_CANDIDATES] if c.probability > 0.0)


@dataclass(frozen=True)
class Separation:
    """Distances between candidates on recordings of one machine."""

    found: Found
    rivals: tuple[Candidate, ...]

    @cached_property
    def _wanted(self) -> list[Proposal]:
        return [c.proposal for c in self.rivals if c.proposal]

    @cached_property
    def _prior(self) -> tuple[Array, Array]:
        """Of the machine's parameters: units (P,), and precision (P, P) in these."""
        size = len(self.found.question.problem.model.parameters)
        covariance = self.found.machine.covariance[:size, :size]
        return self.found.question.problem.spread[:size], np.asarray(np.linalg.inv(covariance + 1e-12 * np.eye(size)))

    @cached_property
    def _unit(self) -> Array:
        """Of the candidates' sizes (K,)."""
        problem = self.found.question.problem
        own = [k for p in self._wanted for k in problem.places[problem.proposals.index(p)]]
        return np.asarray(problem.spread[own])

    def recorded(self) -> Array:
        """Information (K, K) on the candidates' sizes in the present recordings."""
        problem = self.found.question.problem
        own = [k - problem.first for p in self._wanted for k in problem.places[problem.proposals.index(p)]]
        each = [(seen.rows, seen.rows.effects[..., own], seen.recorded.load) for seen in problem.faulty]
        return self._marginal(*(np.sum(part, axis=0) for part in zip(*(self._told(*e) for e in each), strict=True)))

    def of(self, motion: Trial) -> Array:
        """The same in a recording of a motion, as long as the present ones."""
        viewer = self.found.question.viewer
        recorded = Recorded(motion.words, self._values(motion), motion.load, motion.after)
        rows = viewer.rows(recorded, self._wanted)
        information, loads = self._told(rows, rows.effects, motion.load)
        return self._marginal(information * self.seconds / SECONDS, loads)

    @cached_property
    def seconds(self) -> float:
        """Length of the present recordings."""
        return sum(len(seen.rows.t) for seen in self.found.question.problem.faulty) / self.found.question.viewer.rows_hz

    def _values(self, motion: Trial) -> Array:
        """Samples (T, S) of ideal sensors."""
        model = self.found.question.viewer.model
        t = np.arange(round(SECONDS * model.filters.rate_hz)) / model.filters.rate_hz
        truth = self._truth._replace(pitch=motion.pitch)
        return true_values(model.machine, simulate(model.machine, truth, motion.scene, t, 0.0))

    @cached_property
    def _truth(self) -> Truth:
        """A machine as the file has it."""
        return draw_truth(self.found.question.viewer.model.machine, np.random.default_rng(0), 0.0)._replace(roll=0.0)

    def _told(self, rows: GapRows, effects: Columns, load: float) -> tuple[Array, Array]:
        """Information (N, N) on parameters, load and candidates' sizes in a recording, in units of their spread; the
        prior precision of the load (3,)."""
        model, question = self.found.question.viewer.model, self.found.question
        hanging = rows.base @ model.load[:, 1:] * np.array(CENTRE)
        usable = np.isfinite(rows.left)[..., None]
        columns = np.concatenate([rows.base * self._prior[0], hanging, effects * self._unit, rows.left[..., None]], -1)
        whitened = white(np.where(usable, columns, np.nan), question.floor)
        size = columns.shape[-1]
        part = statistics(whitened, range(size - 1), Shared.nothing(rows.left.shape[1], size))
        information = sums(np.ones(size - 1), [part]).information(self.found.machine.noise)[:-1, :-1]
        return information, np.full(len(CENTRE), 1.0 if load else 1e12)

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

    def _own(self, k: int) -> list[int]:
        """The columns of a candidate."""
        first = sum(len(c.sizes) for c in self.rivals[:k])
        return list(range(first, first + len(self.rivals[k].sizes)))


def planned(found: Found, search: Search) -> tuple[Told, ...]:
    """The motions that tell the likeliest candidates apart best, the best first; none where there is but one."""
    rivals = candidates(found, search)
    if len(rivals) < 2:
        return ()
    separation = Separation(found, rivals)
    present = separation.information(separation.recorded())
    motions = catalogue(found.question.viewer.model.machine, _joints(found, rivals))
    each = [Told(m.words, _times(separation.information(separation.of(m)), present)) for m in motions]
    each.append(Told(AGAIN, LONGER))
    return tuple(t for t in sorted(_worth(each), key=lambda t: -t.times)[:MOST_TOLD] if t.times >= LONGER)


def _worth(each: Sequence[Told]) -> list[Told]:
    """Without those that ask for more than another motion, and tell hardly more."""
    return [t for t in each if not any(t.words.startswith(f"{o.words},") and t.times < WORTH * o.times for o in each)]


def _times(information: float, present: float) -> float:
    return information / present if present > 0.0 else np.inf


def _joints(found: Found, rivals: Sequence[Candidate]) -> list[int]:
    """The joints at which the candidates' signatures are largest in the present recordings."""
    problem, chosen = found.question.problem, list[int]()
    for c in rivals:
        if c.proposal is None:
            continue
        own = [k - problem.first for k in problem.places[problem.proposals.index(c.proposal)]]
        energy = np.sum([np.nansum((s.rows.effects[..., own] @ c.sizes) ** 2, axis=0) for s in problem.faulty], axis=0)
        chosen.append(problem.model.machine.rows[int(np.argmax(energy / found.question.floor.rms**2))])
    return list(dict.fromkeys(chosen))


def said(told: Sequence[Told]) -> list[str]:
    """The motions as sentences."""
    return [f"{t.words}: tells {_many(t.times)} as much{_than(t)}" for t in told]


def _than(each: Told) -> str:
    return "" if each.words == AGAIN else " as this recording does in the same time"


def _many(times: float) -> str:
    return f"more than {TIMES:.0f} times" if times > TIMES else f"{times:.2g} times"
