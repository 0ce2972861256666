"""The verdict: which causes are named, with what confidence, what they might be confused with, or that none fits."""

from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.diagnosis import ENOUGH, Cause, Search
from cylforce.diagnosis.problem import TEMPER
from cylforce.diagnosis.rank import FREER, LARGEST, TIE, Ranked, too_large, width
from cylforce.diagnosis.residuals import contributions, rms
from cylforce.diagnosis.residuals import fixed as fixed_residuals
from cylforce.effects.fault import SHAPES, TimeCourse
from cylforce.effects.friction.coulomb_friction import CoulombFriction
from cylforce.effects.friction.friction_level_change import FrictionLevelChange
from cylforce.effects.loads.extra_mass import ExtraMass
from cylforce.effects.loads.first_moment_change import FirstMomentChange
from cylforce.signals.estimate import Array

# Sizes, of an effect's least plausible one.
BESIDES, PLAINLY = 2.0, 1.0  # what a cause beside a larger one must have, and what where evidence is SOUND
NEGLIGIBLE = 0.5  # what any must have
CROWDED = 2.0  # which many small ones may make
ORDINARY, STRIKING = 3.0, 5.0  # below which it is the less a fault; from which on the less must speak for it
# Evidence [nats].
TOLD, APART = 18.0, 30.0  # for an effect (more below its least size); for the lesser of two beside which nothing speaks
PLAIN, SOUND = 50.0, 2000.0  # of what is plain; with which its size says nothing against it
ONCE = 200.0  # for what happens at an instant: nothing repeats it
EACH, LONE = 80.0, 25.0  # for each of the sizes of what is free at any instant; beside which nothing speaks
APIECE = 4.0  # times what a touch says that is too faint to be one: below it, it may be another such
NEARLY = 0.8  # of all evidence, with which what has one axis is as good as alone
EVIDENT = 200.0  # for each of them, with which it is no touch too faint to be one, of whatever size
CLEAR, STRONG = 100.0, 4000.0  # by which what is free at any instant must be ahead of a touch; from which on it is none
FREE = 75.0  # for a torque of which nothing is known: it follows anything
HINT = 25.0  # with which an effect speaks, if only of something of another shape
LOUD = 400.0  # nats that no many small ones of one form have
OUTSTANDING = 200.0  # for what is more than one of many small causes; for all of them together, to be a gap
FAINT, SHAPELESS, ALIEN = 60.0, 2.5, 50.0  # nats; misfits of what is fainter, and of all else: no effect of the library
ROUGH, ROUGHER = 0.1, 2.0  # a form's error, from which on it is one; how much more misfit it may have
# Shares of the largest score.
FIRST, MINOR = 0.2, 0.02  # what the first cause that is named needs, and any other
FOLLOWS, STRANGE = 0.15, 1 / 3  # of its own score: how much counts of what is free at any instant, and of the unknown
SELDOM, OFTEN = 0.2, 0.3  # of all blocks: what a touch may be in; from which on something goes on all the time
AMID, CROWD = 0.5, 0.4  # of the first cause's score: what is unknown beside what is free; what many small ones are
FITS = 3.0  # a misfit, up to which a form counts in full
CLEAN = 1.2  # a misfit, up to which a form leaves nothing that a lesser cause could be taken for
SIGNIFICANT, DOUBTED = 2.0, 3.0  # standard errors, of what is plain and of what is not
# Shares of energy.
STRAY, OTHER = 0.15, 0.03  # of the gap's: what the first cause's form may leave at its joint, and elsewhere
EXPLAINED, PARTLY = 0.1, 0.4  # of what the causes take away: what they may leave
NOISE, LARGE = 0.75, 1.0  # of the floor's: an excess that no verdict hangs on; one that is a gap, whatever explains it
# Rivals: how many nats, or which share of a score, they must be behind; what is less so is told with it.
LEAD, RETURNED = 5.0, 3.5  # of the same shape; what return pressures say
CLOSE, BENT = 0.01, 5.0  # share where a form does not fit, and the inflation that tells so
FORM, DRY = 0.01, 0.005  # of any score: no form is quite that of a real machine; of two laws of dry friction
MESS = 0.01  # of the evidence of small causes beside: by which any other may be off
LATER, ODDS = 0.7, 0.075  # the odds of a rival that does as well; those from which on it is told
# Fitted on development machines of the withheld trial: the log odds that a cause without a rival is right, how much
# less if its evidence is weak, its form does not fit, small causes stand beside it.
RELIABLE, WEAK, MISSHAPEN, CLUTTERED = 4.0, 1.5, 0.7, 1.0
FADING, WARPED = 300.0, 10.0  # nats, misfit
SURE, INSTEAD = 0.8, 1  # the confidence with which one cause is named alone; else how many are told with it
HARDLY = 0.25  # the confidence below which nothing is named
RATHER, BARELY = 0.5, 1 / 3  # the confidence with which one is named beside others, and beside a single one


class Verdict(StrEnum):
    """What is concluded."""

    NO_GAP = "no_gap"
    EXPLAINED = "explained"
    PARTLY = "partly_explained"
    AMBIGUOUS = "ambiguous"
    UNKNOWN = "unknown"
    NOT_OBSERVABLE = "not_observable"


class Named(NamedTuple):
    """A cause that is named, its `confidence`, its share of the gap's energy, and what it might be `confused` with."""

    cause: Cause
    confidence: float
    share: float
    confused: tuple[Ranked, ...]


class Judged(NamedTuple):
    """The verdict, the causes named, largest first, and the share of the gap's energy that they explain."""

    verdict: Verdict
    named: tuple[Named, ...]
    explained: float


def judged(search: Search) -> Judged:
    """The verdict on a search."""
    before, after, floor = _totals(search)
    removed, left = max(before - after, 1e-9), max(after - floor, 0.0)
    explained = removed / (removed + left)
    named = _causes(search, removed + left)
    if not named or (not search.original.clean and before <= floor):
        most = before if search.original.clean else max(before, float(np.sum(search.energy.fixed)))
        much = removed > 2.0 * TEMPER * OUTSTANDING
        told = much or any(_shapeless(c) or _plain(c) for c in search.causes)
        found = told or most > (1.0 + LARGE) * floor
        return Judged(_without_name(search) if found else Verdict.NO_GAP, (), explained)
    doubtful = _strange(search, named[0].cause) or named[0].confidence < HARDLY
    if left > max(PARTLY * removed, NOISE * floor) or doubtful:
        return Judged(_without_name(search), (), explained)
    if len(named) == 1 and named[0].confidence < SURE and not named[0].confused:
        named = (named[0]._replace(confused=_instead(search, named[0].cause)),)
    if named[0].confused:
        return Judged(Verdict.AMBIGUOUS, named, explained)
    enough = left <= max(EXPLAINED * removed, NOISE * floor)
    return Judged(Verdict.EXPLAINED if enough else Verdict.PARTLY, named, explained)


def _without_name(search: Search) -> Verdict:
    """Where no cause is named, whether that is because none of many small ones stands out, or nothing known fits."""
    explained = bool(search.original.clean) and _fits(search)
    several = len(search.causes) > 1 or any(_faint(cause) for cause in search.causes)
    small = several and not any(_stands_out(cause) for cause in search.causes)
    return Verdict.NOT_OBSERVABLE if explained and small else Verdict.UNKNOWN


def _totals(search: Search) -> tuple[float, float, float]:
    """The energy before, after, and of the floor, of all faulty blocks."""
    energy = search.energy
    return float(np.sum(energy.before)), float(np.sum(energy.after)), float(np.sum(energy.floor))


def _fits(search: Search) -> bool:
    """Whether all causes together leave no more than noise."""
    _, after, floor = _totals(search)
    return after <= (1.0 + NOISE) * floor


def _stands_out(cause: Cause) -> bool:
    """Whether a cause is more than one of many small ones."""
    if not (cause.known or _counts(cause, 0.0)):
        return False
    if cause.ranked.free:
        touch = _touching(cause) or (cause.known and _sized(cause) < BESIDES and _little(cause))
        return not (touch and _during([cause]) < SELDOM)
    if not cause.known or _plain(cause):
        return True
    return cause.tempered >= OUTSTANDING * min(STRIKING / _sized(cause), 1.0) and _counts(cause, BESIDES)


def _instead(search: Search, cause: Cause) -> tuple[Ranked, ...]:
    """What else it may be where the confidence is low: the nearest rival, and what stands beside it, most telling
    first."""
    beside = sorted((c for c in search.causes if c.known and c is not cause), key=lambda c: -_weight(c))
    return (*cause.rivals[:1], *(c.ranked for c in beside))[:INSTEAD]


def _causes(search: Search, excess: float) -> tuple[Named, ...]:
    """The first cause and those that stand beside it."""
    parts = contributions(search)
    joints = np.argmax(parts / search.floor.rms, axis=1).tolist() if len(parts) else []
    each = zip(search.causes, _shares(search, parts, excess), joints, strict=True)
    speaking = len([c for c in search.causes if not _otherwise(c) and c.tempered >= (HINT if c.known else FREE)])
    counted = [e for e in each if _counts(e[0], NEGLIGIBLE, LONE if speaking == 1 else _bar(search, e[0]))]
    found = sorted(counted, key=lambda e: -_weight(e[0]))
    largest = max((c.score for c in search.causes if not c.ranked.free), default=0.0)
    most = max((_weight(c) for c in search.causes if not c.ranked.free), default=0.0)
    kept = [e for e in found[:1] if _weight(e[0]) >= FIRST * most]
    for cause, share, joint in found[1:] if kept else ():
        stray = STRAY if joint in [j for *_, j in kept] else OTHER
        clear = cause.score >= FIRST * largest or kept[0][0].misfit <= CLEAN
        plain = cause.tempered >= SOUND and clear
        enough = share >= stray and cause.score >= MINOR * largest and _counts(cause, PLAINLY if plain else BESIDES)
        enough = enough or (speaking == 2 and cause.tempered >= APART and _counts(cause, PLAINLY))
        if cause.known and enough and _best(cause):
            kept.append((cause, share, joint))
    small = sum(c.score for c in search.causes) - sum(c.score for c, *_ in kept)
    named = [_named(c, share, max(small, 0.0)) for c, share, _ in kept]
    return (*named[:1], *(n for n in named[1:] if n.confidence >= (BARELY if speaking == 2 else RATHER)))


def _bar(search: Search, cause: Cause) -> float:
    """Nats that what is free at any instant needs for each of its sizes: more beside a touch too faint to be one, of
    which it may be another; less where it has one axis only and says nearly all."""
    touch = max((c.score for c in search.causes if _faint(c)), default=0.0)
    if cause.score < APIECE * touch:
        return EVIDENT
    most = cause.score >= NEARLY * sum(c.score for c in search.causes)
    return LONE if cause.known and width(cause.ranked) <= SHAPES and most else EACH


def _weight(cause: Cause) -> float:
    """The score, of what is unknown and of what is free at any instant the less: beside another cause it is first only
    when it says much more. Of a size hardly plausible it is the less, too: every machine has many small ones."""
    if cause.ranked.free:
        return cause.score * FOLLOWS
    usual = min(_sized(cause) / ORDINARY, 1.0)
    return cause.score * (min(FITS / cause.misfit, 1.0) * usual if cause.known else STRANGE)


def _sized(cause: Cause) -> float:
    """The size, of the least plausible one."""
    return cause.size / cause.ranked.option.proposal.about.low


def _free(search: Search, cause: Cause) -> bool:
    """Whether the cause, or much beside one that goes with time itself, is a torque of which nothing is known, or what
    is free at any instant goes on all the time."""
    beside = [c for c in search.causes if not c.known and _counts(c, NEGLIGIBLE) and c.score > AMID * cause.score]
    return not cause.known or _often(search, cause) or bool(cause.ranked.free and beside)


def _often(search: Search, cause: Cause) -> bool:
    """Whether what is free at any instant, unknown or too little for its sizes, says more than the cause and is there
    so often that it goes on all the time."""
    others = [c for c in search.causes if c is not cause and c.ranked.free and not (c.known and _counts(c, 0.0))]
    return sum(c.score for c in others) > cause.score and _during(others) > OFTEN


def _during(causes: Sequence[Cause]) -> float:
    """In which share of all blocks any of some causes is."""
    return float(np.mean(np.any([course != 0.0 for c in causes for course in c.ranked.option.term.course], axis=0)))


def _strange(search: Search, cause: Cause) -> bool:
    """Whether what comes first is no effect of the library: a torque of which nothing is known, one larger than can be,
    one whose form does not fit, or what many small ones make."""
    least = cause.size * (1.0 - min(1.0 / max(cause.significance, 1e-9), 1.0))
    large = least > LARGEST * cause.ranked.option.most
    return large or _free(search, cause) or _blurred(search, cause) or _crowded(search, cause)


def _crowded(search: Search, first: Cause) -> bool:
    """Whether the first cause is hardly larger than what is plausible, and much stands beside it, or more than it has
    for all its size: many small ones pass for one, the sooner the more sizes it has; a touch too faint to be one is
    more of them. What begins at an instant, and is not told as such, is a load that hangs a little otherwise. Where all
    of them leave nothing, much that is told of one form, and of a plausible size, is none of many."""
    beside = [c for c in search.causes if c is not first and not (_otherwise(c) or _faint(c) or _large(c))]
    crowd = sum(c.score for c in beside)
    told = sum(c.tempered * (FOLLOWS if c.ranked.free else 1.0) for c in beside)
    small = (_sized(first) < CROWDED and first.tempered < SOUND) or first.tempered < PLAIN
    touch = FOLLOWS * sum(c.score for c in search.causes if _faint(c))
    amid = small and crowd + touch > CROWD * first.score / width(first.ranked)
    hidden = told > _sized(first) * first.tempered or amid
    plain = first.tempered >= LOUD and _sized(first) >= PLAINLY and first.misfit <= FITS and _fits(search)
    return hidden and not (first.ranked.free or plain) and crowd + touch > HINT


def _large(cause: Cause) -> bool:
    """Whether it is none of many small ones, but a cause by itself."""
    if not cause.known or cause.ranked.free or not _counts(cause, BESIDES):
        return False
    return cause.misfit <= (FITS if _stands_out(cause) else CLEAN if cause.tempered >= PLAIN else 0.0)


def _faint(cause: Cause) -> bool:
    """Whether it is a touch too faint to be one: it says much where it is, and nothing of all other times."""
    small = _sized(cause) < PLAINLY and _little(cause)
    return cause.known and cause.ranked.free and (small or _touching(cause))


def _touching(cause: Cause) -> bool:
    """Whether what is free at any instant may as well be a touch: a force at the teeth tells as much."""
    return cause.ahead < CLEAR and cause.score < STRONG


def _little(cause: Cause) -> bool:
    """Whether too little speaks for what is free at any instant to count if it is no larger than a faint touch."""
    return cause.score < EVIDENT * len(cause.sizes)


def _otherwise(cause: Cause) -> bool:
    """Whether the cause begins at an instant, and too little speaks for that."""
    return cause.ranked.option.proposal.course is TimeCourse.AFTER and cause.tempered < ONCE


def _blurred(search: Search, cause: Cause) -> bool:
    """Whether little speaks for the cause, and that little scatters, or it scatters beyond all that a form may lack,
    and more is left than noise: something is there, of another shape."""
    usual = bool(search.original.clean)  # only the machine in order tells what is
    most = ALIEN if usual and not _fits(search) else np.inf
    faint = SHAPELESS * (ROUGHER if cause.ranked.option.proposal.about.form >= ROUGH else 1.0)
    return not cause.ranked.free and cause.misfit > (faint if cause.tempered < FAINT else most)


def _best(cause: Cause) -> bool:
    """Whether nothing else explains surely better what the cause explains beside the others."""
    return all(r.score <= cause.score + max(TIE, FORM * cause.score) for r in cause.rivals if not _contains(r, cause))


def _shares(search: Search, parts: Array, whitened: float) -> list[float]:
    """For each cause its share of the gap: of the `whitened` energy by its evidence, or of a joint's energy by what it
    contributes there (`parts` (N, R) [N m]), whichever is more."""
    _, faulty = fixed_residuals(search)
    whole = rms(faulty) ** 2
    excess = np.maximum(whole - search.floor.rms**2, 0.1 * search.floor.rms**2)
    told = [2.0 * TEMPER * cause.score / whitened for cause in search.causes]
    return [float(np.clip(max(np.max(p**2 / excess), t), 0.0, 1.0)) for p, t in zip(parts, told, strict=True)]


def _counts(cause: Cause, least: float, each: float = EACH) -> bool:
    """Whether a cause is large enough, certain enough, and of the right shape; `each`: nats that what is free at any
    instant needs for each of its sizes."""
    large = cause.size >= least * cause.ranked.option.proposal.about.low
    if cause.ranked.free and cause.known:
        told = cause.score >= (each if large and not _touching(cause) else EVIDENT) * len(cause.sizes)
        return (large or least <= NEGLIGIBLE) and told and cause.significance >= SIGNIFICANT
    least_told = TOLD / min(_sized(cause), 1.0) ** 2
    enough = (ONCE if cause.ranked.option.proposal.course else least_told) if cause.known else FREE
    sure = 0.0 if _plain(cause) else SIGNIFICANT if cause.tempered >= PLAIN else DOUBTED
    return large and cause.tempered >= enough and cause.significance >= sure


def _shapeless(cause: Cause) -> bool:
    """Whether something like the cause is there, but not of its shape, or too little for the sizes it has."""
    large = cause.size >= NEGLIGIBLE * cause.ranked.option.proposal.about.low
    if cause.ranked.free and cause.known:
        return large and cause.tempered >= ONCE
    return large and cause.score >= HINT and cause.tempered < ENOUGH and cause.significance >= SIGNIFICANT


def _plain(cause: Cause) -> bool:
    """Whether so much speaks for something like the cause that it is there, of whatever size."""
    return not cause.ranked.free and cause.known and cause.tempered >= SOUND


def _named(cause: Cause, share: float, small: float) -> Named:
    """The cause with its confidence. The less its form fits, and the more of the evidence is that of `small` causes
    beside those named [nats], the farther a rival must be behind."""
    rivals = [r for r in cause.rivals if not (_contains(r, cause) or too_large(r))]
    uneven = min(max((cause.misfit - 1.0) / BENT, small / cause.score), 1.0)
    plain = max(LEAD * (cause.misfit if cause.misfit > FITS else 1.0), MESS * small)
    dry = max(plain, DRY * cause.score, CLOSE * cause.score * uneven)
    lead = max(dry, FORM * cause.score)
    leads = [LEAD if r.free else plain if _within(r, cause) else dry if _dry(r, cause) else lead for r in rivals]
    behind = [_behind(r, cause, own) for r, own in zip(rivals, leads, strict=True)]
    odds = [LATER * float(np.exp(-3.0 * max(b, 0.0))) for b in behind]
    close = tuple(r for r, o in zip(rivals, odds, strict=True) if o >= ODDS)
    return Named(cause, _alone(cause, small) / (1.0 + sum(odds)), share, close)


def _alone(cause: Cause, small: float) -> float:
    """How likely a cause is right if it has no rival."""
    misfit = 0.0 if cause.ranked.free else min((cause.misfit - 1.0) / WARPED, 1.0)
    doubt = WEAK * float(np.exp(-cause.tempered / FADING)) + MISSHAPEN * misfit
    doubt += CLUTTERED * min(small / cause.score, 1.0)
    return float(1.0 / (1.0 + np.exp(doubt - RELIABLE)))


def _behind(rival: Ranked, cause: Cause, lead: float) -> float:
    """By how many leads a rival is worse than the cause; what return pressures say counts by itself."""
    apart = cause.returned - rival.returned
    return (cause.score - rival.score - apart) / lead + apart / RETURNED


def _within(rival: Ranked, cause: Cause) -> bool:
    """Whether a rival is the cause without its own size, both of exact form: first moments, of a mass."""
    less, more = (each.option.proposal for each in (rival, cause.ranked))
    masses = isinstance(less.group[0], FirstMomentChange) and isinstance(more.group[0], ExtraMass)
    return masses and less.where == more.where


def _dry(rival: Ranked, cause: Cause) -> bool:
    """Whether both are dry friction of one cylinder: what differs from machine to machine is alike in both."""
    kinds = [each.option.proposal.group[0] for each in (rival, cause.ranked)]
    return (
        all(isinstance(k, CoulombFriction | FrictionLevelChange) for k in kinds) and rival.key[1] == cause.ranked.key[1]
    )


def _contains(rival: Ranked, cause: Cause) -> bool:
    """Whether a rival is the cause with more freedom: what it explains as well speaks for the simpler one. A mass
    anywhere on a link has all first moments of it, and a size more; what is free at any instant follows a load that
    falls."""
    incident = cause.ranked.option.proposal.course not in (None, TimeCourse.CLOCK)
    if incident and rival.free and width(rival) > width(cause.ranked):
        return rival.score < (1.0 + FREER) * cause.score
    more, less = (each.option.proposal for each in (rival, cause.ranked))
    if isinstance(more.group[0], ExtraMass) and isinstance(less.group[0], FirstMomentChange):
        return more.where == less.where
    return set(rival.option.term.columns) > set(cause.ranked.option.term.columns)
