"""What was found as blocks `[[effects]]`, in which the simulated machine takes it."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from cylforce.core.gap.diagnosis import Cause
from cylforce.core.gap.problem import EACH, GROWTH_S, Problem
from cylforce.core.gap.rows import BLOCK, RATE_HZ, shapes
from cylforce.machine.candidate import SHAPES, Course, Incident
from cylforce.words.estimate import Array

LENGTH_S = BLOCK / RATE_HZ
PARTS = 6  # of a block, in which what happens within it is taken as constant
WITHIN = shapes((np.arange(PARTS) + 0.5) / PARTS)  # (SHAPES, PARTS)


def patch(problem: Problem, causes: Sequence[Cause]) -> list[dict[str, Any]]:
    """One block per cause, or one for each recording or window in which it has sizes of its own; see
    `core/simulated_effects.py` for what the simulated machine makes of it."""
    return [block for cause in causes for block in _blocks(problem, cause)]


def _blocks(problem: Problem, cause: Cause) -> Iterator[dict[str, Any]]:
    effect, at = cause.ranked.option.proposal.group[0], cause.ranked.option.proposal.at
    plain: dict[str, Any] = {"name": effect.about.name, "at": at}
    shape = {name: getattr(effect, name) for name in getattr(effect, "__dataclass_fields__", {})}
    if shape:
        plain["shape"] = shape
    if isinstance(effect, Incident):
        yield from (plain | part for part in _moments(problem, effect, cause))
    elif effect.about.of_its_own:
        for own, (first, behind) in zip(_sizes(cause), problem.spans, strict=True):
            yield plain | {"value": own.tolist()} | _time(problem, first, behind - 1)
    else:
        yield plain | {"value": cause.sizes.tolist()}


def _moments(problem: Problem, effect: Incident, cause: Cause) -> Iterator[dict[str, Any]]:
    """Values and times of an incident; what begins at an instant begins in the middle of the block that has it."""
    sizes = _sizes(cause)
    courses = cause.ranked.option.term.course[:: sizes.shape[1]]
    if effect.course is Course.WINDOWS:
        for own, course in zip(sizes, courses, strict=True):
            start = _time(problem, *[int(np.argmax(course))] * 2)["from_s"]
            for k, part in enumerate(WITHIN.T @ own.reshape(SHAPES, -1)):
                if effect.about.sign * part[0] < 0.0:  # a polynomial swings about nothing
                    continue
                begin, end = start + np.array([k, k + 1]) * LENGTH_S / PARTS
                yield {"value": part.tolist(), "from_s": max(float(begin), 0.0), "until_s": float(end)}
        return
    if effect.course is Course.CLOCK and cause.ranked.option.when == EACH:
        yield from _clocks(problem, *sizes[:, 0].tolist())
        return
    held = np.flatnonzero(courses[0])
    time = _time(problem, int(held[0]), int(held[-1]))
    if len(courses) > 1 and np.count_nonzero(courses[1]) == 1:
        time["from_s"] -= LENGTH_S / 2.0
    if effect.course is Course.CLOCK:
        growth = float(sizes[1, 0]) / GROWTH_S if len(sizes) > 1 and np.all(courses[1] > 0.0) else 0.0
        yield {"value": [float(sizes[0, 0]), growth]} | ({} if held[0] == 0 else {"from_s": time["from_s"]})
    else:
        yield {"value": sizes[0].tolist()} | time


def _clocks(problem: Problem, late: float, growth: float) -> Iterator[dict[str, Any]]:
    """A clock that begins anew with each recording."""
    for (first, behind), begin in zip(problem.spans, problem.begins, strict=True):
        each = growth / GROWTH_S
        yield {"value": [late - each * begin, each]} | _time(problem, first, behind - 1)


def _time(problem: Problem, first: int, last: int) -> dict[str, float]:
    """From the beginning of one block to the end of another [s]."""
    return {
        "from_s": max(float(problem.times[first]) - LENGTH_S / 2.0, 0.0),
        "until_s": float(problem.times[last]) + LENGTH_S / 2.0,
    }


def _sizes(cause: Cause) -> Array:
    """Sizes (W, M) in every recording, window or stretch."""
    return cause.sizes.reshape(-1, len(dict.fromkeys(cause.ranked.option.term.columns)))
