"""What was found as blocks `[[effects]]`, in which the simulated machine takes it."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from cylforce.diagnosis.problem import GROWTH_S, Problem, Seen
from cylforce.diagnosis.residuals import residuals
from cylforce.diagnosis.resimulation import known, read_blocks
from cylforce.diagnosis.rows import BLOCK, RATE_HZ, shapes
from cylforce.diagnosis.verdict import Cause, Search
from cylforce.effects.fault import SHAPES, Incident, Place, TimeCourse
from cylforce.effects.loads.carried import RAMP
from cylforce.signals.estimate import Array

LENGTH_S = BLOCK / RATE_HZ
PARTS = 8  # of a block, in which what happens within it is taken as constant
WITHIN = shapes((np.arange(PARTS) + 0.5) / PARTS)  # (SHAPES, PARTS)


def patch(search: Search, causes: Sequence[Cause]) -> list[dict[str, Any]]:
    """One block per cause, or one for each recording or window in which it has sizes of its own; see
    `effects/imposed.py` for what the simulated machine makes of it; clocks last, for they are those of readings
    that have all other errors."""
    blocks = [block for cause in sorted(causes, key=lambda c: c.clock) for block in _blocks(search, cause)]
    return [block for block in blocks if _possible(search.original, block)]


def _possible(problem: Problem, block: dict[str, Any]) -> bool:
    """Whether the simulated machine takes it: a size may come out larger than any plausible one, or of the sign that
    cannot be, where it is uncertain."""
    try:
        read_blocks(problem.model.machine, [block], known(problem))
    except ValueError:
        return False
    return True


def _blocks(search: Search, cause: Cause) -> Iterator[dict[str, Any]]:
    effect, at = cause.proposal.group[0], cause.proposal.at
    plain: dict[str, Any] = {"name": effect.about.name, "at": at}
    shape = {name: getattr(effect, name) for name in getattr(effect, "__dataclass_fields__", {})}
    if shape:
        plain["shape"] = shape
    if isinstance(effect, Incident):
        yield from (plain | part for part in _moments(search, effect, cause))
    else:
        yield plain | {"value": cause.sizes.tolist()}


def _moments(search: Search, effect: Incident, cause: Cause) -> Iterator[dict[str, Any]]:
    """Values and times of an incident."""
    problem, sizes = search.original, _sizes(cause)
    courses = cause.term.course[:: sizes.shape[1]]
    if effect.course is TimeCourse.WINDOWS:
        for own, course in zip(sizes, courses, strict=True):
            yield from _window(search, effect, own, int(np.argmax(course)))
        return
    sudden = len(courses) > 1 and np.count_nonzero(courses[1]) == 1
    begins = {"from_s": _instant(search, cause)} if sudden else {}
    if effect.course is TimeCourse.CLOCK:
        growth = 0.0 if sudden or len(sizes) < 2 else float(sizes[1, 0]) / GROWTH_S
        yield {"value": [float(sizes[0, 0]), growth]} | begins
    else:
        last, _ = _of_block(problem, int(np.flatnonzero(courses[0])[-1]))
        yield {"value": sizes[0].tolist()} | begins | {"until_s": _whole(problem, problem.faulty[last])["until_s"]}


def _window(search: Search, effect: Incident, sizes: Array, block: int) -> Iterator[dict[str, Any]]:
    """A block's course in parts; a force at the teeth rises and fades while the next one takes over."""
    if not np.any(sizes):  # nothing was fitted there
        return
    start = float(search.original.times[block]) - LENGTH_S / 2.0 - search.viewer.lag  # rows come after what they tell
    over = RAMP / 2.0 if effect.about.place is Place.TOOL else 0.0
    for k, part in enumerate(WITHIN.T @ sizes.reshape(SHAPES, -1)):
        if effect.about.sign * part[0] < 0.0:  # a polynomial swings about nothing
            continue
        begin, end = start + np.array([k, k + 1]) * LENGTH_S / PARTS
        yield {"value": part.tolist(), "from_s": max(float(begin) - over, 0.0), "until_s": float(end) + over}


def _instant(search: Search, cause: Cause) -> float:
    """When something began [s]: where, in the block that has sizes of its own or its neighbours, it fits best to say
    that nothing was there before, and afterwards as much as later."""
    problem = search.original
    mine = next(c for c in search.causes if c.key == cause.key)
    term, own = mine.term, _sizes(mine)[0]
    number, first = _of_block(problem, int(np.flatnonzero(term.course[0])[0]))
    seen = problem.faulty[number]
    near = slice(max(first - 2, 0) * BLOCK, (first + 1) * BLOCK)
    left = _denied(search, mine)[number][near]
    effect = problem.columns(seen)[near][..., list(term.columns[: len(own)])] @ own
    gain = np.where(np.isfinite(left), left**2 - (left - effect) ** 2, 0.0) @ search.floor.rms**-2.0
    behind = np.cumsum(gain[::-1])[::-1]  # what goes if it begins with each row
    return max(float(seen.rows.t[near][int(np.argmax(behind))]) - search.viewer.lag, 0.0)


def _denied(search: Search, cause: Cause) -> list[Array]:
    """What is left of the faulty recordings (T, R) [N m] without one of the causes."""
    terms = [c.term for c in search.causes]
    sizes = [c.sizes * (c is not cause) for c in search.causes]
    values = np.concatenate([search.evidence.fitted[: len(search.blocks.shared)], *sizes])
    return residuals(search.original, search.blocks, terms, values)


def _of_block(problem: Problem, block: int) -> tuple[int, int]:
    """The number of the stretch that has a block, and the block's number in it."""
    return next(
        (number, block - first) for number, (first, behind) in enumerate(problem.spans) if first <= block < behind
    )


def _whole(problem: Problem, seen: Seen) -> dict[str, float]:
    """All of a stretch, with what the filters need before its first row."""
    length = len(seen.recorded.values) / problem.model.filters.rate_hz
    return {"from_s": seen.recorded.begins, "until_s": seen.recorded.begins + length}


def _sizes(cause: Cause) -> Array:
    """Sizes (W, M) in every recording, window or stretch."""
    return cause.sizes.reshape(-1, len(dict.fromkeys(cause.term.columns)))
