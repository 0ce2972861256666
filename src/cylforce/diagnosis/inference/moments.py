"""What happens at moments: in which blocks, and when a known load becomes another one."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.inference.asking import LOAD, Asking, Step
from cylforce.diagnosis.inference.discrepancy import Moments, evidence
from cylforce.diagnosis.inference.hypotheses import Hypothesis, Inference
from cylforce.diagnosis.inference.posterior import CONTACT, UNKNOWN, Asked, Happened
from cylforce.diagnosis.numbers import SELDOM, USUAL_SIZES
from cylforce.effects.fault import INCIDENTAL, TimeCourse
from cylforce.effects.library import Proposal
from cylforce.effects.unknown import NAME
from cylforce.signals.estimate import Array

Blocks = NDArray[np.bool_]
SETTLING = 4  # rounds in which the blocks in which something happens are found


def happening(
    question: Asking,
    case: Inference,
    left: Array,
    only: tuple[str, str] | None,
    beside: Hypothesis | None = None,
) -> list[tuple[Happened, Blocks]]:
    """All that may have happened at moments, alone or `beside` the effects of a hypothesis, and in which blocks (B,);
    `left` (K+1,): coefficients of what is left without it; `only`: name and place ("": any) of the one effect that is
    asked."""
    found, few = [], USUAL_SIZES if question.problem.clean else (1.0,)  # only references show what is everyday
    for p, own in _incidents(question, only):
        each = question.moments(own)
        told, usual = settled(case, each, left, beside, few)
        where = usual > 0.0
        log, busy = told.log + each.prior(where, few), float(np.mean(where))
        if question.step:  # a block that does not count is like those beside it
            k = question.step.first
            where[k] = np.any(where[max(k - 1, 0) : k + 2])
        before, key = beside.rest if beside else None, UNKNOWN if p.name == NAME else (p.name, p.at)
        found.append((Happened(key, log, busy, told.rest, before, usual), where))
    return found


def likelier(
    question: Asking, case: Inference, told: Asked, alone: Sequence[tuple[Happened, Blocks]]
) -> tuple[Happened, Blocks] | None:
    """What most probably happens at moments, `alone` or beside what most probably lasts, if that is likelier than
    nothing, and seldom; and in which blocks (B,)."""
    most, found = max(told.hypotheses, key=lambda h: h.log), list(alone)
    if most.which:
        names = {h.key[0] for h, _ in alone}
        left = case.under(most.which, case.state(most.noise))[2]
        beside = happening(question, case, left, None, most)
        found += [(each, where) for each, where in beside if each.key[0] in names]
    first = max(found, key=lambda both: both[0].log, default=None)
    return first if first and first[0].log > most.log and first[0].busy <= SELDOM else None


def _incidents(question: Asking, only: tuple[str, str] | None) -> list[tuple[Proposal, tuple[int, ...]]]:
    """What may happen at moments, and the numbers of its columns."""
    each = zip(question.problem.proposals, question.problem.places, strict=True)
    windows = [(p, own) for p, own in each if p.course is TimeCourse.WINDOWS]
    return [(p, own) for p, own in windows if not only or (p.name == only[0] and only[1] in ("", p.at))]


def sizes_of(case: Inference, h: Hypothesis, unit: Array) -> tuple[Array, Array]:
    """Sizes (B, I) of what happens at moments beside a hypothesis, in `unit` (I,), and their standard errors."""
    if case.moments is None:
        raise ValueError("nothing happens at moments")
    sizes, covariance = case.moments.expected(case.under(h.which, case.state(h.noise))[2], h.noise)
    return sizes * unit, np.sqrt(np.einsum("bii->bi", covariance)) * unit


def settled(
    case: Inference,
    moments: Moments,
    left: Array,
    beside: Hypothesis | None = None,
    sizes: Sequence[float] = USUAL_SIZES,
) -> tuple[Hypothesis, Array]:
    """What happens at moments, alone or `beside` the effects of a hypothesis, and how large it usually is, of `sizes`,
    in every block (B,), 0 where it is less probable than nothing; `left` (K+1,): coefficients of what is left without
    it."""
    which, doubt, noise = (beside.which, beside.doubt, beside.noise) if beside else ((), None, case.usual)
    usual = moments.likeliest(left, noise, sizes)
    for _ in range(SETTLING):
        held = replace(case, moments=moments.only(usual))
        noise = held.hypothesis(which, noise, doubt).noise
        now = moments.likeliest(held.under(which, held.state(noise))[2], noise, sizes)
        if np.array_equal(now, usual):
            break
        usual = now
    held = replace(case, moments=moments.only(usual))
    return held.likeliest(which, noise, doubt), usual


def changed(question: Asking, case: Inference, left: Array) -> Step | None:
    """When a known load most probably became another one: the first and last block of that; None without a load.
    `left` (K+1,): coefficients of what is left without a change."""
    problem = question.problem
    loaded = [(span, seen) for span, seen in zip(problem.spans, problem.faulty, strict=True) if seen.recorded.load]
    if not loaded:
        return None
    moments = question.moments([problem.lasting + INCIDENTAL.index(name) for name in LOAD])
    across, precision, _ = moments.weighed(case.usual)
    pull, told = across @ left, precision - np.eye(precision.shape[-1])
    best, found = -np.inf, None
    begins: dict[str, int] = {}
    ends: dict[str, int] = {}
    for (first, last), seen in loaded:
        begins.setdefault(seen.recorded.name, first)
        ends[seen.recorded.name] = last
    for (first, last), seen in loaded:
        name = seen.recorded.name
        for k in range(first, last - 1):
            gain = _gain(pull, told, (begins[name], k, ends[name]))
            if gain > best:
                best, found = gain, Step(k, ends[name])
    return found


def _gain(pull: Array, told: Array, blocks: tuple[int, int, int]) -> float:
    """Evidence [nats] that a load changes in a block of a recording, with where it hung beforehand unknown: score
    (B, I) and information (B, I, I) of each block, in units of the prior; first, changed, end."""
    first, k, end = blocks
    parts = [(slice(first, end), 1), (slice(k, k + 1), 0), (slice(k + 1, end), 0)]
    score = np.concatenate([pull[part][:, axis:].sum(axis=0) for part, axis in parts])
    each = [[_both(told, a, b) for b in parts] for a in parts]
    own, before = np.block(each) + np.eye(len(score)), len(LOAD) - 1
    return float(evidence(score, own) - evidence(score[:before], own[:before, :before]))


def _both(told: Array, a: tuple[slice, int], b: tuple[slice, int]) -> Array:
    """Information of what two parts of a recording have in common: blocks, and the first of the columns."""
    blocks = slice(max(a[0].start, b[0].start), min(a[0].stop, b[0].stop))
    return np.asarray(told[blocks][:, a[1] :, b[1] :].sum(axis=0))


def digging(told: Asked) -> bool:
    """Whether contact in most blocks is the likeliest of all: the machine works, whatever it lifts."""
    most = max(told.happened, key=lambda h: h.log, default=None)
    if most is None or most.key[0] != CONTACT or most.busy <= SELDOM or told.slight(most):
        return False
    return most.log > max(h.log for h in told.hypotheses)
