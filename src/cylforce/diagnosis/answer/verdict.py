"""What is concluded: causes from the hypotheses, and the answer that costs least by their probabilities."""

from collections.abc import Callable, Sequence
from enum import StrEnum
from functools import partial
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.answer.belief import taught
from cylforce.diagnosis.answer.calibration import Outcomes
from cylforce.diagnosis.answer.causes import Cause, Suspect, best, candidates, happened, lasting, single
from cylforce.diagnosis.answer.fitting import Fitting, Sized
from cylforce.diagnosis.answer.learnt import AT_WORK, CALIBRATION
from cylforce.diagnosis.columns.problem import Problem
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.diagnosis.inference.asking import Asking
from cylforce.diagnosis.inference.found import Found
from cylforce.diagnosis.inference.posterior import NOTHING, UNKNOWN, Belief, Key
from cylforce.diagnosis.inference.residuals import added, counting, hung, residuals, rms
from cylforce.diagnosis.numbers import EMPTY_SET, MISSED, SET, SURE, UNSAID
from cylforce.signals.estimate import Array


class Verdict(StrEnum):
    """What is concluded."""

    NO_GAP = "no_gap"
    EXPLAINED = "explained"
    PARTLY = "partly_explained"
    AMBIGUOUS = "ambiguous"
    UNKNOWN = "unknown"
    NOT_OBSERVABLE = "not_observable"


class Search(NamedTuple):
    """All that was found: the `question`, the causes, `first`: all candidates, likeliest first; the `fit` of all
    causes, to recordings from which is taken out what bends; what is believed; whether the machine was at work; the
    smallest size of each effect that could be seen, `least`; the first cause `alone`, without those beside it, and its
    fit."""

    question: Asking
    causes: tuple[Cause, ...]
    first: tuple[Suspect, ...]
    fit: Fitting
    belief: Belief
    working: bool
    least: dict[Key, float]
    alone: Callable[[], tuple[tuple[Cause, ...], Fitting]]

    @property
    def original(self) -> Problem:
        """The recordings as they are."""
        return self.question.problem

    def without(self, causes: Sequence[Cause], told: Sized, values: Array) -> list[Array]:
        """What is left (T, R) [N m] by values (K,) of the columns that last and by some causes of a fit, `told`, of the
        recordings from which is taken out what bends."""
        problem = self.fit.question.problem
        left = residuals(problem, values)
        for c in causes:
            sizes = c.sizes if c.form is None else told.more[c.form].reshape(c.sizes.shape)
            left = [e - x for e, x in zip(left, added(problem, c.columns, sizes, c.course), strict=True)]
        return left

    def at_rest(self, causes: Sequence[Cause], told: Sized, values: Array) -> Array:
        """Values (K,) of the machine as it was, `values`, with where the field's loads hang beside some causes."""
        problem = self.fit.question.problem if causes else self.original
        left = self.without(causes, told, values) if causes else residuals(problem, values)
        return values + hung(problem, self.question.floor, counting(self.question, left))

    @property
    def viewer(self) -> Viewer:
        """Who looks."""
        return self.question.viewer


class Named(NamedTuple):
    """A cause that is named, its `confidence`, its share of the gap's energy, and what it might be `confused` with;
    `same`: another cause that is the same answer, if there is one."""

    cause: Cause
    confidence: float
    share: float
    confused: tuple[Suspect, ...]
    same: Key | None = None


class Judged(NamedTuple):
    """The verdict, the causes named, largest first, and the share of the gap's energy that they explain; `refuted`:
    causes that their simulation refutes."""

    verdict: Verdict
    named: tuple[Named, ...]
    explained: float
    refuted: tuple[Key, ...] = ()


def searched(
    found: Found, by: Outcomes | None = CALIBRATION, at_work: Outcomes | None = AT_WORK, surely: bool = False
) -> Search:
    """The causes of the most probable hypothesis whose main effect is the likeliest, and what is believed; `surely`:
    there is a gap."""
    told = taught(found, by, at_work, surely)
    suspects, h = candidates(found, told), best(found, told)
    causes, fit = lasting(found, h, told) if h else happened(found, told, suspects)
    alone = partial(lasting, found, single(found, h), told) if h else lambda: (causes, fit)
    return Search(found.question, causes, suspects, fit, told, found.working, found.least, alone)


def judged(found: Found, search: Search) -> Judged:
    """The answer that costs least."""
    belief, told = search.belief, found.asked
    named = tuple(n._replace(same=found.same.get(n.cause.key)) for n in _named(search))
    cost = costs(belief, *((named[0].confidence, [c.probability for c in named[0].confused]) if named else (0.0, ())))
    verdict = min(cost, key=lambda v: cost[v])
    if found.working and verdict in (Verdict.NO_GAP, Verdict.UNKNOWN):  # loads and contact may hide either
        return Judged(Verdict.NOT_OBSERVABLE, (), 0.0)
    if verdict in (Verdict.NO_GAP, Verdict.UNKNOWN):
        return Judged(verdict, (), 0.0)
    own = [x.rest for x in told.happened if search.causes and x.key == search.causes[0].key]
    rest = h.rest if (h := best(found, belief)) else min(own, default=told.none.rest)
    return Judged(verdict, named, float(np.clip(told.share(rest), 0.0, 1.0)))


def costs(belief: Belief, first: float, rivals: Sequence[float]) -> dict[Verdict, float]:
    """Expected cost of every answer, in units of a wrong name; `first`: the confidence in the main cause, 0 if none was
    found; `rivals`: the probabilities of all it might be confused with, which are checked one after the other."""
    held, checks = first + sum(rivals), first + sum(k * p for k, p in enumerate(rivals, 1))
    order, odd = belief.of.get(NOTHING, 0.0), belief.of.get(UNKNOWN, 0.0)
    effect = 1.0 - order - odd
    found = {Verdict.NO_GAP: MISSED * (effect + odd), Verdict.UNKNOWN: UNSAID * effect + order}
    if 0.0 < first < SURE:
        found[Verdict.AMBIGUOUS] = order + SET * checks + EMPTY_SET * max(1.0 - order - held, 0.0)
    if first >= SURE:
        found[Verdict.EXPLAINED] = 1.0 - first
    return found


def _named(search: Search) -> tuple[Named, ...]:
    """The main cause with its rivals, and those beside it that are as sure as a name must be; their shares of what all
    of them add to the torques, in units of the floor (squares)."""
    belief, causes = search.belief, [c for c in search.causes if c.known]
    if not causes:
        return ()
    sure = [c for c in causes[1:] if c.probability >= SURE]
    kept = {c.key for c in (causes[0], *sure)}
    rivals = tuple(c for c in search.first if c.key in belief.credible and c.key not in kept and c.key != UNKNOWN)
    each = [rms(added(search.original, c.columns, c.sizes, c.course)) for c in search.causes]
    squares = np.sum((np.array(each) / search.question.floor.rms) ** 2, axis=1)
    share = dict(zip((c.key for c in search.causes), squares / max(float(np.sum(squares)), 1e-300), strict=True))
    first = Named(causes[0], belief.of.get(causes[0].key, 0.0), float(share[causes[0].key]), rivals)
    return (first, *(Named(c, c.probability, float(share[c.key]), ()) for c in sure))
