"""What is concluded: causes from the hypotheses, and the answer that costs least by their probabilities."""

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.answer.belief import taught
from cylforce.diagnosis.answer.calibration import Outcomes
from cylforce.diagnosis.answer.fitting import Fitting, Sized, fitting
from cylforce.diagnosis.answer.learnt import AT_WORK, CALIBRATION
from cylforce.diagnosis.columns.problem import GROWTH_S, Problem
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.diagnosis.inference.asking import Asking
from cylforce.diagnosis.inference.found import Found
from cylforce.diagnosis.inference.hypotheses import Hypothesis
from cylforce.diagnosis.inference.moments import sizes_of
from cylforce.diagnosis.inference.posterior import NOTHING, UNKNOWN, Belief, Key
from cylforce.diagnosis.inference.residuals import added, counting, hung, residuals, rms
from cylforce.diagnosis.inference.sizes import plausible
from cylforce.diagnosis.inference.working import Lost
from cylforce.diagnosis.numbers import EMPTY_SET, MISSED, SET, SURE, UNSAID
from cylforce.effects.fault import TimeCourse
from cylforce.effects.library import Proposal
from cylforce.signals.estimate import Array


class Verdict(StrEnum):
    """What is concluded."""

    NO_GAP = "no_gap"
    EXPLAINED = "explained"
    PARTLY = "partly_explained"
    AMBIGUOUS = "ambiguous"
    UNKNOWN = "unknown"
    NOT_OBSERVABLE = "not_observable"


class Cause(NamedTuple):
    """An effect that was found: the proposal, its course in words, which `form` of the question it is (None of what
    happens at moments), its columns, sizes (W, M) and standard errors (W, M), each row of them with its `course` (W, B)
    over the faulty blocks, NaN where it begins, the `probability` of it, `nats` of evidence against its absence."""

    proposal: Proposal
    when: str
    form: int | None
    columns: tuple[int, ...]
    course: Array
    sizes: Array
    errors: Array
    probability: float
    nats: float

    @property
    def key(self) -> Key:
        """Name and place."""
        return self.proposal.name, self.proposal.at

    @property
    def known(self) -> bool:
        """Whether it is an effect, not a torque of which nothing is known."""
        return self.key[0] != UNKNOWN[0]

    @property
    def lasts(self) -> bool:
        """Whether it has the same sizes as long as it is there."""
        return self.proposal.course is not TimeCourse.WINDOWS

    @property
    def size(self) -> float:
        """Its magnitude, with its sign if it has one; the root mean square over windows."""
        each = self.sizes[:, : self.proposal.about.axes]
        sign = np.sign(each[0, 0]) if each.size == 1 else self.proposal.about.sign or 1
        return float(sign * np.sqrt(np.mean(np.sum(each**2, axis=1))))


class Suspect(NamedTuple):
    """An effect by itself: name and place, its evidence against none [nats], its probability."""

    key: Key
    proposal: Proposal
    nats: float
    probability: float

    @property
    def known(self) -> bool:
        """Whether it is an effect, not a torque of which nothing is known."""
        return self.key != UNKNOWN


class Search(NamedTuple):
    """All that was found: the `question`, the causes, `first`: all candidates, likeliest first; the `fit` of all
    causes, to recordings from which is taken out what bends; what is believed; whether the machine was at work; the
    smallest size of each effect that could be seen, `least`."""

    question: Asking
    causes: tuple[Cause, ...]
    first: tuple[Suspect, ...]
    fit: Fitting
    belief: Belief
    working: bool
    least: dict[Key, float]

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
    """A cause that is named, its `confidence`, its share of the gap's energy, and what it might be `confused` with."""

    cause: Cause
    confidence: float
    share: float
    confused: tuple[Suspect, ...]


class Judged(NamedTuple):
    """The verdict, the causes named, largest first, and the share of the gap's energy that they explain."""

    verdict: Verdict
    named: tuple[Named, ...]
    explained: float


def searched(
    found: Found, by: Outcomes | None = CALIBRATION, at_work: Outcomes | None = AT_WORK, surely: bool = False
) -> Search:
    """The causes of the most probable hypothesis whose main effect is the likeliest, and what is believed; `surely`:
    there is a gap."""
    told = taught(found, by, at_work, surely)
    candidates = _candidates(found, told)
    h = _best(found, told)
    causes, fit = _causes(found, h, told) if h else _happened(found, told, candidates)
    return Search(found.question, causes, candidates, fit, told, found.working, found.least)


def _best(found: Found, belief: Belief) -> Hypothesis | None:
    """The most probable hypothesis of the likeliest effect; None where that is none or something at moments."""
    told = found.asked
    effects = [k for k in sorted(belief.of, key=lambda k: -belief.of[k]) if k not in (NOTHING, UNKNOWN)]
    own = [h for h in told.hypotheses if h.which and effects and told.main(h) == effects[0]]
    return max(own, key=lambda h: h.log + told.prior_of(h)) if own else None


def _causes(found: Found, h: Hypothesis, belief: Belief) -> tuple[tuple[Cause, ...], Fitting]:
    """The effects of a hypothesis, the main one first, and its fit."""
    told, causes, k = found.asked, [], 0
    for p in h.which:
        m = len(found.question.forms[p][1].columns)
        unit = found.question.scene.spread[list(found.question.forms[p][1].columns)]
        sizes = h.sizes[k : k + m] * unit, h.errors[k : k + m] * unit
        k += m
        nats = h.log - told.without(h, told.key(p))
        p_of = belief.of.get(told.key(p), 0.0) if told.key(p) == told.main(h) else _included(found, told.key(p))
        causes.append(_cause(found, p, sizes, p_of, nats))
    return tuple(sorted(causes, key=lambda c: c.key != told.main(h))), fitting(found, h)


def _included(found: Found, key: Key) -> float:
    """The probability that an effect is there, beside another or alone."""
    told = found.asked
    weights = list(zip(told.hypotheses, told.weights, strict=False))
    whole = sum(told.weights)
    return sum(w for h, w in weights if key in {told.key(p) for p in h.which}) / whole


def _cause(found: Found, form: int, told: tuple[Array, Array], probability: float, nats: float) -> Cause:
    problem, (proposal, column) = found.question.problem, found.question.forms[form]
    sizes = plausible(column, told[0])
    errors = np.hypot(told[1], proposal.about.form * np.abs(sizes))
    number, when = np.arange(len(problem.times)), ""
    course, rows = np.ones((1, len(number))), 1
    if proposal.course is TimeCourse.CLOCK:
        course, rows = np.stack([course[0], problem.times / GROWTH_S]), 2
    elif proposal.course is TimeCourse.AFTER and found.question.step:
        first, last = found.question.step
        course[0] = np.where(number == first, np.nan, (number > first) & (number < last))
        when = f"from {problem.times[first]:.0f} s on"
    places = problem.places[problem.proposals.index(proposal)]
    shaped, uncertain = (x.reshape(rows, -1) for x in (sizes, errors))
    return Cause(proposal, when, form, places, course, shaped, uncertain, probability, nats)


def _happened(found: Found, belief: Belief, candidates: Sequence[Suspect]) -> tuple[tuple[Cause, ...], Fitting]:
    """What happens at moments, if that is the likeliest effect: sizes of its own in every block; and the fit."""
    question, case = found.plain
    key = next((c.key for c in candidates), NOTHING)
    if found.lost and key == found.lost.happened.key and belief.of.get(key, 0.0) > 0.0:
        return _fallen(found, found.lost, belief.of[key])
    where = found.when.get(key, np.zeros(len(question.problem.times), dtype=np.bool_))
    if key in (NOTHING, UNKNOWN) or not np.any(where) or belief.of.get(key, 0.0) <= 0.0:
        return (), Fitting(found.question, found.case, (), found.asked.none.noise)
    proposal, places = _asked(question.problem)[key]
    happened = max((h for h in found.asked.happened if h.key == key), key=lambda h: h.log)
    usual = np.where(where, 1.0, 0.0) if happened.usual is None else happened.usual
    case = replace(case, moments=question.moments(places).only(usual))
    h = case.hypothesis((), case.usual)
    sizes, errors = (x[where] for x in sizes_of(case, h, usual[:, None] * question.problem.spread[list(places)]))
    nats = happened.log - found.asked.none.log
    course, words = np.eye(len(where))[where], f"{np.count_nonzero(where)} times"
    cause = Cause(proposal, words, None, places, course, sizes, errors, belief.of[key], nats)
    return (cause,), Fitting(question, case, (), h.noise)


def _fallen(found: Found, lost: Lost, probability: float) -> tuple[tuple[Cause, ...], Fitting]:
    """What fell out of loads of which nothing is known, and the fit."""
    proposal, places = _asked(found.question.problem)[lost.happened.key]
    words, nats = f"{len(lost.sizes)} times", lost.happened.log - found.asked.none.log
    course = lost.after.astype(np.float64)
    cause = Cause(proposal, words, None, places, course, lost.sizes, lost.errors, probability, nats)
    return (cause,), Fitting(found.question, found.case, (), found.asked.none.noise)


def _candidates(found: Found, belief: Belief) -> tuple[Suspect, ...]:
    """All effects by themselves, likeliest first, then by evidence."""
    told, best = found.asked, dict[Key, Suspect]()
    alone, asked = [h for h in told.hypotheses if len(h.which) == 1], _asked(found.question.problem)
    each = [(told.key(h.which[0]), found.question.forms[h.which[0]][0], h.log) for h in alone]
    each += [(h.key, asked[h.key][0], h.log) for h in told.happened if h.key in asked]
    for key, proposal, log in each:
        nats = log - told.none.log
        if key not in best or best[key].nats < nats:
            best[key] = Suspect(key, proposal, nats, belief.of.get(key, 0.0))
    return tuple(sorted(best.values(), key=lambda c: (-c.probability, -c.nats)))


def _asked(problem: Problem) -> dict[Key, tuple[Proposal, tuple[int, ...]]]:
    """The first form of every effect at its place, and its columns."""
    each = zip(reversed(problem.proposals), reversed(problem.places), strict=True)
    return {(p.name, p.at): (p, places) for p, places in each}


def judged(found: Found, search: Search) -> Judged:
    """The answer that costs least."""
    belief, told = search.belief, found.asked
    named = _named(search)
    cost = costs(belief, *((named[0].confidence, [c.probability for c in named[0].confused]) if named else (0.0, ())))
    verdict = min(cost, key=lambda v: cost[v])
    if found.working and verdict in (Verdict.NO_GAP, Verdict.UNKNOWN):  # loads and contact may hide either
        return Judged(Verdict.NOT_OBSERVABLE, (), 0.0)
    if verdict in (Verdict.NO_GAP, Verdict.UNKNOWN):
        return Judged(verdict, (), 0.0)
    own = [x.rest for x in told.happened if search.causes and x.key == search.causes[0].key]
    rest = h.rest if (h := _best(found, belief)) else min(own, default=told.none.rest)
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
