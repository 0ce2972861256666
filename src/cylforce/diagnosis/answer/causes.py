"""Causes, from the hypotheses and from what is believed."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.answer.fitting import Fitting, fitting
from cylforce.diagnosis.columns.problem import GROWTH_S, Problem
from cylforce.diagnosis.inference.found import Found
from cylforce.diagnosis.inference.hypotheses import Hypothesis
from cylforce.diagnosis.inference.moments import sizes_of
from cylforce.diagnosis.inference.posterior import NOTHING, UNKNOWN, Belief, Key
from cylforce.diagnosis.inference.sizes import plausible
from cylforce.diagnosis.inference.working import Lost
from cylforce.effects.fault import TimeCourse
from cylforce.effects.library import Proposal
from cylforce.signals.estimate import Array

WIDE = 1.6449  # standard errors of a 90 % interval


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


def interval(cause: Cause) -> tuple[float, float, float]:
    """Return a cause's magnitude, and the bounds of its 90 % interval."""
    about = cause.proposal.about
    error = float(np.sqrt(np.mean(cause.errors[:, : about.axes] ** 2)))
    value = cause.size if about.axes > 1 or len(cause.sizes) > 1 else float(cause.sizes[0, 0])
    return value, value - WIDE * error, value + WIDE * error


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


def best(found: Found, belief: Belief) -> Hypothesis | None:
    """The most probable hypothesis of the likeliest effect; None where that is none or something at moments."""
    told = found.asked
    effects = [k for k in sorted(belief.of, key=lambda k: -belief.of[k]) if k not in (NOTHING, UNKNOWN)]
    own = [h for h in told.hypotheses if h.which and effects and told.main(h) == effects[0]]
    return max(own, key=lambda h: h.log + told.prior_of(h)) if own else None


def single(found: Found, h: Hypothesis) -> Hypothesis:
    """The most probable hypothesis of the main effect of another one by itself; that one where it was not asked so."""
    told = found.asked
    own = [each for each in told.hypotheses if len(each.which) == 1 and told.key(each.which[0]) == told.main(h)]
    return max(own, key=lambda each: each.log + told.prior_of(each), default=h)


def lasting(found: Found, h: Hypothesis, belief: Belief) -> tuple[tuple[Cause, ...], Fitting]:
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


def happened(found: Found, belief: Belief, candidates: Sequence[Suspect]) -> tuple[tuple[Cause, ...], Fitting]:
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


def candidates(found: Found, belief: Belief) -> tuple[Suspect, ...]:
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
