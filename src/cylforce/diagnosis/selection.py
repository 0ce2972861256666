"""Which set of causes explains the faulty recordings: one by one, each exchanged as soon as another does better."""

from collections.abc import Sequence

import numpy as np

from cylforce.diagnosis.evidence import Blocks, Evidence
from cylforce.diagnosis.problem import TEMPER, Problem
from cylforce.diagnosis.rank import TIE, Ranked, ranking
from cylforce.diagnosis.unknown import NAME
from cylforce.effects.fault import TimeCourse
from cylforce.effects.friction.coulomb_friction import CoulombFriction
from cylforce.effects.loads.extra_mass import ExtraMass
from cylforce.effects.loads.first_moment_change import FirstMomentChange

MOST = 6  # effects
LEAD = 0.05  # of what is explained, which is no difference where only a data sheet is known


def selected(problem: Problem, blocks: Blocks, worth: float) -> list[Ranked]:
    """The causes. Where only a data sheet is known, what none tells well - first moments, dry friction - is asked all
    together, too: that is taken if it needs no more causes than what is found one by one, and explains as much."""
    held = settled(problem, blocks, [], worth)
    if not problem.from_sheet:
        return held
    unknown = [p for p in problem.proposals if isinstance(p.group[0], FirstMomentChange | CoulombFriction)]
    start = ranking(problem, Evidence(blocks), wanted=unknown)
    other = settled(problem, blocks, start, worth) if start else held
    base, *gone = (
        float(np.sum(each.squares(each.held, each.fitted)[1]))
        for each in (Evidence(blocks, [r.option.term for r in causes]) for causes in ([], held, other))
    )
    return other if _moments(other) <= _moments(held) and base - gone[1] > (1.0 - LEAD) * (base - gone[0]) else held


def _moments(causes: Sequence[Ranked]) -> int:
    """How many causes; an extra mass stands for the first moments of its link and of all before it."""
    proposals = [r.option.proposal for r in causes]
    return len(causes) + sum(p.where for p in proposals if isinstance(p.group[0], ExtraMass))


def settled(
    problem: Problem, blocks: Blocks, start: Sequence[Ranked], worth: float, kept: tuple[tuple[str, str], ...] = ()
) -> list[Ranked]:
    """A set of causes to which none can be added, of which none can be exchanged or left out, or one that comes back
    again and again; `kept` ones stay."""
    held, seen = list(start), set[frozenset[tuple[str, str]]]()
    for _ in range(2 * MOST):
        added = _added(problem, blocks, held, worth)
        held = [*held, added] if added and len(held) < MOST else held
        better = _exchanged(problem, blocks, held, worth, kept, len(held) - bool(added))
        better = together(problem, blocks, better)
        keys = frozenset(r.key for r in better)
        if keys in seen or (added is None and keys == {r.key for r in held}):
            return better
        held, seen = better, seen | {keys}
    return held


def _added(problem: Problem, blocks: Blocks, held: Sequence[Ranked], worth: float) -> Ranked | None:
    """The best cause beside those held, if it is worth it; an infinite `worth` asks for none."""
    if len(held) >= MOST or not np.isfinite(worth):
        return None
    ranked = ranking(problem, Evidence(blocks, [r.option.term for r in held]), besides=held)
    return ranked[0] if ranked and ranked[0].score >= worth else None


def _exchanged(
    problem: Problem, blocks: Blocks, held: list[Ranked], worth: float, kept: tuple[tuple[str, str], ...], count: int
) -> list[Ranked]:
    """Each of the first `count` causes against all others again, now that its companions are known."""
    for n in range(count if len(held) > 1 else 0):
        if held[n].key in kept:
            continue
        others = [r for k, r in enumerate(held) if k != n]
        ranked = ranking(problem, Evidence(blocks, [r.option.term for r in others]), besides=others)
        own = next((r for r in ranked if r.key == held[n].key), None)
        better = [r for r in ranked[:2] if own is None or r.score > own.score + TIE]
        if better and (own is None or ranked[0] is not own):
            held = [*held[:n], better[0], *held[n + 1 :]]
        elif own is not None:
            held = [*held[:n], own, *held[n + 1 :]]
    return [r for r in held if r.key in kept or r.score >= worth]


def together(problem: Problem, blocks: Blocks, held: list[Ranked]) -> list[Ranked]:
    """Torques of which nothing is known, and what begins at an instant, for one effect that is free at any and tells as
    much as all of them: one force at the teeth is a torque at every joint."""
    alien = {r.key for r in held if r.free and r.key[0] == NAME}
    sudden = {r.key for r in held if r.option.proposal.course is TimeCourse.AFTER}
    for p in (p for p in problem.proposals if alien and p.name != NAME and p.course is TimeCourse.WINDOWS):
        for keys in (alien, alien | sudden) if sudden else (alien,):
            gone, others = ([r for r in held if (r.key in {*keys, (p.name, p.at)}) is out] for out in (True, False))
            ranked = ranking(problem, Evidence(blocks, [r.option.term for r in others]), [p]) if len(gone) > 1 else []
            if ranked and ranked[0].score > _all_of(blocks, gone, others) - TIE:
                return [*others, ranked[0]]
    return held


def _all_of(blocks: Blocks, causes: Sequence[Ranked], others: Sequence[Ranked]) -> float:
    """The score [nats] of several causes together, beside the others."""
    score, beside = 0.0, [r.option.term for r in others]
    for r in causes:
        score += Evidence(blocks, beside).of(r.option.term, TEMPER).evidence - r.option.cost
        beside.append(r.option.term)
    return score
