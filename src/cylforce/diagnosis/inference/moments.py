"""What happens at moments: in which blocks, and when a known load becomes another one."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.inference.asking import LOAD, Asking, Step
from cylforce.diagnosis.inference.discrepancy import Moments, evidence
from cylforce.diagnosis.inference.hypotheses import Hypothesis, Inference
from cylforce.diagnosis.inference.posterior import UNKNOWN, Asked, Happened, Key
from cylforce.diagnosis.numbers import SELDOM
from cylforce.effects.fault import INCIDENTAL, TimeCourse
from cylforce.effects.loads.tip_force import TipForce
from cylforce.effects.unknown import NAME
from cylforce.signals.estimate import Array

Blocks = NDArray[np.bool_]
SETTLING = 4  # rounds in which the blocks in which something happens are found
CONTACT = TipForce().about.name


def happening(
    question: Asking, case: Inference, left: Array, only: tuple[str, str] | None
) -> list[tuple[Happened, Blocks]]:
    """All that may have happened at moments, and in which blocks (B,); `left` (K+1,): coefficients of what is left
    without it; `only`: name and place ("": any) of the one effect that is asked."""
    found = []
    for key, each in _incidents(question, only):
        told, where = settled(case, each, left)
        if question.step:  # a block that does not count is like those beside it
            k = question.step.first
            where[k] = np.any(where[max(k - 1, 0) : k + 2])
        happened = Happened(key, told.log + each.prior(where), float(np.mean(where)), told.rest)
        found.append((happened, where))
    return found


def _incidents(question: Asking, only: tuple[str, str] | None) -> list[tuple[Key, Moments]]:
    """What may happen at moments, with its key."""
    found = []
    for p, own in zip(question.problem.proposals, question.problem.places, strict=True):
        if p.course is TimeCourse.WINDOWS and (not only or (p.name == only[0] and only[1] in ("", p.at))):
            found.append((UNKNOWN if p.name == NAME else (p.name, p.at), question.moments(own)))
    return found


def settled(case: Inference, moments: Moments, left: Array) -> tuple[Hypothesis, Blocks]:
    """What happens at moments alone, and in which blocks (B,), in those where it is more probable than not;
    `left` (K+1,): coefficients of what is left without it."""
    where = moments.happening(left, case.usual)
    held = replace(case, moments=moments.only(where))
    found = held.hypothesis((), case.usual)
    for _ in range(1, SETTLING):
        again = moments.happening(held.under((), held.state(found.noise))[2], found.noise)
        if np.array_equal(again, where):
            break
        where = again
        held = replace(case, moments=moments.only(where))
        found = held.hypothesis((), found.noise)
    return held.likeliest((), found.noise), where


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
