"""What is concluded: causes from the hypotheses, and the answer that costs least by their probabilities."""

from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.diagnosis import Found
from cylforce.diagnosis.evidence import Blocks, Evidence, Term
from cylforce.diagnosis.hypotheses import Hypothesis
from cylforce.diagnosis.learnt import CALIBRATION
from cylforce.diagnosis.numbers import EMPTY_SET, GAP, MISSED, SET, UNSAID
from cylforce.diagnosis.posterior import NOTHING, UNKNOWN, Belief, Key, Outcomes, believed, calibrated
from cylforce.diagnosis.problem import GROWTH_S, Problem
from cylforce.diagnosis.rows import Viewer
from cylforce.diagnosis.whitening import Floor
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
    """An effect that was found: the proposal, its course in words, its columns with their course, total sizes (M,) and
    standard errors (M,), the `probability` of it, `nats` of evidence against its absence."""

    proposal: Proposal
    when: str
    term: Term
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
    def free(self) -> bool:
        """Whether its sizes are free at any instant."""
        return self.proposal.course is TimeCourse.WINDOWS

    @property
    def clock(self) -> bool:
        """Whether it is clocks that are apart: of all readings, after whatever else is wrong with them."""
        return self.proposal.course is TimeCourse.CLOCK

    @property
    def size(self) -> float:
        """Its magnitude; the root mean square over windows."""
        about, width = self.proposal.about, len(dict.fromkeys(self.term.columns))
        each = self.sizes.reshape(-1, width)[:, : about.axes]
        if each.size == 1:
            return float(each[0, 0])
        return float(np.sqrt(np.mean(np.sum(each**2, axis=1))))


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
    """All that was found: the `original` problem, the problem and blocks with what bends taken out, the floor, the
    causes, `first`: all candidates, likeliest first; `evidence`: the fit of all causes; who looked, `viewer`; what is
    believed; whether the machine was at work; the smallest size of each effect that could be seen, `least`."""

    original: Problem
    problem: Problem
    blocks: Blocks
    floor: Floor
    causes: tuple[Cause, ...]
    first: tuple[Suspect, ...]
    evidence: Evidence
    viewer: Viewer
    belief: Belief
    working: bool
    least: dict[Key, float]


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


def searched(found: Found, by: Outcomes | None = CALIBRATION) -> Search:
    """The causes of the most probable hypothesis whose main effect is the likeliest, and what is believed."""
    belief = believed(found.asked)
    belief = calibrated(belief, by) if by else belief
    candidates = _candidates(found, belief)
    h = _best(found, belief)
    problem = found.problem(h.which) if h else found.question.problem
    original, floor = found.question.problem, found.question.floor
    causes = _causes(found, h, belief) if h else _happened(found, belief, candidates)
    blocks = problem.blocks(floor)
    evidence = Evidence(blocks, [cause.term for cause in causes])
    if not h and causes:
        errors = np.sqrt(np.diag(evidence.covariance))[len(blocks.shared) :]
        causes = (causes[0]._replace(sizes=evidence.fitted[len(blocks.shared) :], errors=errors),)
    return Search(
        *(original, problem, blocks, floor, causes, candidates, evidence, found.question.viewer, belief, found.working),
        found.least,
    )


def _best(found: Found, belief: Belief) -> Hypothesis | None:
    """The most probable hypothesis of the likeliest effect; None where that is none or something at moments."""
    told = found.asked
    effects = [k for k in sorted(belief.of, key=lambda k: -belief.of[k]) if k not in (NOTHING, UNKNOWN)]
    own = [h for h in told.hypotheses if h.which and effects and told.main(h) == effects[0]]
    return max(own, key=lambda h: h.log + told.prior_of(h)) if own else None


def _causes(found: Found, h: Hypothesis, belief: Belief) -> tuple[Cause, ...]:
    """The effects of a hypothesis, the main one first."""
    told, causes, k = found.asked, [], 0
    for p in h.which:
        proposal, column = found.question.forms[p]
        m = len(column.columns)
        unit = found.question.scene.spread[list(column.columns)]
        sizes, errors = h.sizes[k : k + m] * unit, h.errors[k : k + m] * unit
        k += m
        without = [g for g in told.hypotheses if g.which == tuple(x for x in h.which if x != p)]
        nats = h.log - (without[0] if without else told.none).log
        p_of = belief.of.get(told.key(p), 0.0) if told.key(p) == told.main(h) else _included(found, told.key(p))
        causes.append(_cause(found, proposal, (sizes, errors), p_of, nats))
    return tuple(sorted(causes, key=lambda c: c.key != told.main(h)))


def _included(found: Found, key: Key) -> float:
    """The probability that an effect is there, beside another or alone."""
    told = found.asked
    weights = list(zip(told.hypotheses, told.weights, strict=False))
    whole = sum(told.weights)
    return sum(w for h, w in weights if key in {told.key(p) for p in h.which}) / whole


def _cause(found: Found, proposal: Proposal, told: tuple[Array, Array], probability: float, nats: float) -> Cause:
    problem, (sizes, errors) = found.question.problem, told
    places = problem.places[problem.proposals.index(proposal)]
    one = np.ones(len(problem.times))
    form = proposal.about.form * np.abs(sizes)
    errors = np.hypot(errors, form)
    if proposal.course is TimeCourse.CLOCK:
        return Cause(
            proposal, "", Term(places * 2, np.stack([one, problem.times / GROWTH_S])), sizes, errors, probability, nats
        )
    if proposal.course is TimeCourse.AFTER and found.question.step:
        first, last = found.question.step
        number = np.arange(len(one))
        course = np.stack([(number > first) & (number < last), number == first]).astype(np.float64)
        term = Term(places * 2, np.repeat(course, len(places), axis=0))
        when = f"from {problem.times[first]:.0f} s on"
        return Cause(proposal, when, term, np.tile(sizes, 2), np.tile(errors, 2), probability, nats)
    return Cause(proposal, "", Term(places, np.tile(one, (len(places), 1))), sizes, errors, probability, nats)


def _happened(found: Found, belief: Belief, candidates: Sequence[Suspect]) -> tuple[Cause, ...]:
    """What happens at moments, if that is the likeliest effect: sizes of its own in every block."""
    problem = found.question.problem
    key = next((c.key for c in candidates), NOTHING)
    where = np.flatnonzero(found.when.get(key, np.zeros(0)))
    if key in (NOTHING, UNKNOWN) or not where.size or belief.of.get(key, 0.0) <= 0.0:
        return ()
    proposal = next(p for p in problem.proposals if (p.name, p.at) == key)
    places = problem.places[problem.proposals.index(proposal)]
    course = np.repeat(np.eye(len(problem.times))[where], len(places), axis=0)
    told = next(h for h in found.asked.happened if h.key == key)
    zero = np.zeros(len(course))
    term = Term(places * len(where), course)
    nats = told.log - found.asked.none.log
    return (Cause(proposal, f"{len(where)} times", term, zero, zero, belief.of[key], nats),)


def _candidates(found: Found, belief: Belief) -> tuple[Suspect, ...]:
    """All effects by themselves, likeliest first, then by evidence."""
    told, best = found.asked, dict[Key, Suspect]()
    alone = [(h.which[0], h.log) for h in told.hypotheses if len(h.which) == 1]
    for p, log in alone:
        key, proposal = told.key(p), found.question.forms[p][0]
        _keep(best, Suspect(key, proposal, log - told.none.log, belief.of.get(key, 0.0)))
    for h in told.happened:
        proposals = [p for p in found.question.problem.proposals if (p.name, p.at) == h.key]
        for proposal in proposals[:1]:
            _keep(best, Suspect(h.key, proposal, h.log - told.none.log, belief.of.get(h.key, 0.0)))
    return tuple(sorted(best.values(), key=lambda c: (-c.probability, -c.nats)))


def _keep(best: dict[Key, Suspect], candidate: Suspect) -> None:
    if candidate.key not in best or best[candidate.key].nats < candidate.nats:
        best[candidate.key] = candidate


def judged(found: Found, search: Search, shares: Sequence[float]) -> Judged:
    """The answer that costs least; `shares`: of the gap's energy by cause."""
    belief, told = search.belief, found.asked
    named = _named(search, shares)
    if found.working:
        return Judged(Verdict.NOT_OBSERVABLE, (), 0.0)
    costs = _costs(belief, named)
    verdict = min(costs, key=lambda v: costs[v])
    if verdict is Verdict.NO_GAP and told.gap >= GAP and told.none.rest >= GAP:
        verdict = Verdict.AMBIGUOUS if named and belief.of[UNKNOWN] < named[0].confidence else Verdict.UNKNOWN
    if verdict in (Verdict.NO_GAP, Verdict.UNKNOWN):
        return Judged(verdict, (), 0.0)
    h = _best(found, belief)
    rest = (
        h.rest if h else min((x.rest for x in told.happened if x.key == search.causes[0].key), default=told.none.rest)
    )
    return Judged(verdict, named, float(np.clip(told.share(rest), 0.0, 1.0)))


def _costs(belief: Belief, named: Sequence[Named]) -> dict[Verdict, float]:
    """Expected cost of every answer, in units of a wrong name."""
    order, odd = belief.of.get(NOTHING, 0.0), belief.of.get(UNKNOWN, 0.0)
    effect = 1.0 - order - odd
    found = {Verdict.NO_GAP: MISSED * (effect + odd), Verdict.UNKNOWN: UNSAID * effect + order}
    if not named:
        return found
    first = named[0].confidence
    held = first + sum(c.probability for c in named[0].confused)
    found[Verdict.EXPLAINED] = 1.0 - first
    found[Verdict.AMBIGUOUS] = order + SET * held + EMPTY_SET * max(1.0 - order - held, 0.0)
    return found


def _named(search: Search, shares: Sequence[float]) -> tuple[Named, ...]:
    """The main cause with its rivals, and those beside it that are as sure as a name must be."""
    belief, causes = search.belief, [c for c in search.causes if c.known]
    if not causes:
        return ()
    sure = [c for c in causes[1:] if c.probability >= 1.0 / (1.0 + UNSAID)]
    kept = {c.key for c in (causes[0], *sure)}
    rivals = tuple(c for c in search.first if c.key in belief.credible and c.key not in kept and c.key != UNKNOWN)
    weight = {c.key: s for c, s in zip(search.causes, shares, strict=True)}
    first = Named(causes[0], belief.of.get(causes[0].key, 0.0), weight[causes[0].key], rivals)
    return (first, *(Named(c, c.probability, weight[c.key], ()) for c in sure))
