"""What was found as blocks `[[effects]]`, in which the simulated machine takes it."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from cylforce.diagnosis.answer.causes import Cause
from cylforce.diagnosis.answer.resimulation import read_blocks
from cylforce.diagnosis.answer.verdict import Search
from cylforce.diagnosis.columns.problem import GROWTH_S, Problem
from cylforce.diagnosis.columns.rows import BLOCK, shapes
from cylforce.diagnosis.inference.residuals import clean
from cylforce.effects.fault import SHAPES, Place, TimeCourse
from cylforce.effects.loads.carried import RAMP
from cylforce.signals.estimate import Array

PARTS = 8  # of a block, in which what happens within it is taken as constant
WITHIN = shapes((np.arange(PARTS) + 0.5) / PARTS)  # (SHAPES, PARTS)


def patch(search: Search, causes: Sequence[Cause]) -> list[dict[str, Any]]:
    """One block per cause, or one for each window in which it has sizes of its own; see `effects/imposed.py` for what
    the simulated machine makes of it; clocks last, for they are those of readings that have all other errors."""
    blocks = [block for cause in sorted(causes, key=lambda c: c.proposal.clock) for block in _blocks(search, cause)]
    return [block for block in blocks if _possible(search.original, block)]


def _possible(problem: Problem, block: dict[str, Any]) -> bool:
    """Whether the simulated machine takes it: a size may come out larger than any plausible one, or of the sign that
    cannot be, where it is uncertain."""
    try:
        read_blocks(problem.model.machine, [block], tuple(p.group for p in problem.proposals))
    except ValueError:
        return False
    return True


def _blocks(search: Search, cause: Cause) -> Iterator[dict[str, Any]]:
    plain: dict[str, Any] = {"name": cause.proposal.name, "at": cause.proposal.at}
    plain |= {"shape": cause.proposal.shape} if cause.proposal.shape else {}
    course, sizes = cause.proposal.course, cause.sizes
    if course is TimeCourse.WINDOWS:
        for own, block in zip(sizes, np.argmax(cause.course, axis=1).tolist(), strict=True):
            yield from (plain | part for part in _window(search, cause, own, block))
    elif course is TimeCourse.CLOCK:
        yield plain | {"value": [float(sizes[0, 0]), float(sizes[1, 0]) / GROWTH_S]}
    elif course is TimeCourse.AFTER and search.working:
        half = BLOCK / search.viewer.rows_hz / 2.0
        for own, there in zip(sizes, cause.course > 0.0, strict=True):
            t = search.original.times[there] - search.viewer.lag
            span = {"from_s": max(float(t[0]) - half, 0.0), "until_s": float(t[-1]) + half}
            yield plain | {"value": own.tolist()} | span
    elif course is TimeCourse.AFTER:
        yield plain | {"value": sizes[0].tolist()} | _times(search, cause)
    else:
        yield plain | {"value": sizes.ravel().tolist()}


def _window(search: Search, cause: Cause, sizes: Array, block: int) -> Iterator[dict[str, Any]]:
    """A block's course in parts; a force at the teeth rises and fades while the next one takes over."""
    length = BLOCK / search.viewer.rows_hz
    start = float(search.original.times[block]) - length / 2.0 - search.viewer.lag  # rows come after what they tell
    about = cause.proposal.about
    over = RAMP / 2.0 if about.place is Place.TOOL else 0.0
    for k, part in enumerate(WITHIN.T @ sizes.reshape(SHAPES, -1)):
        if about.sign * part[0] < 0.0:  # a polynomial swings about nothing
            continue
        begin, end = start + np.array([k, k + 1]) * length / PARTS
        yield {"value": part.tolist(), "from_s": max(float(begin) - over, 0.0), "until_s": float(end) + over}


def _times(search: Search, cause: Cause) -> dict[str, float]:
    """From when on [s] a load is another one: where, in the block in which that happens or its neighbours, it fits best
    that nothing was there before, and afterwards as much as later; until its recording ends."""
    after = np.flatnonzero(cause.course[0] > 0.0)
    problem = search.fit.question.problem
    number, (first, _) = next((n, s) for n, s in enumerate(problem.spans) if s[0] <= after[0] < s[1])
    seen, near = problem.faulty[number], slice(max(after[0] - first - 2, 0) * BLOCK, (after[0] - first + 1) * BLOCK)
    values = search.at_rest(search.causes, search.fit.whole, clean(search.question).values)
    others = [c for c in search.causes if c.key != cause.key]
    left = search.without(others, search.fit.whole, values)[number][near]
    own = problem.columns(seen)[near][..., list(cause.columns)] @ cause.sizes[0]
    gain = np.where(np.isfinite(left), left**2 - (left - own) ** 2, 0.0) @ search.question.floor.rms**-2.0
    begins = int(np.argmax(np.cumsum(gain[::-1])[::-1]))  # what goes if it begins with each row
    last = next(s for s, (_, end) in zip(problem.faulty, problem.spans, strict=True) if after[-1] < end).recorded
    ends = last.begins + len(last.values) / problem.model.filters.rate_hz
    return {"from_s": max(float(seen.rows.t[near][begins]) - search.viewer.lag, 0.0), "until_s": ends}
