"""How far the gap shrinks: what was found is written as blocks `[[effects]]`, and the identified machine with those
blocks is simulated again along the recorded motion, each stretch with sizes that were fitted without it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cylforce.core.gap.bars import bars
from cylforce.core.gap.closure import SPAN, blockwise, closure
from cylforce.core.gap.diagnosis import Cause, Search
from cylforce.core.gap.evidence import Evidence, own_blocks
from cylforce.core.gap.patch import patch
from cylforce.core.gap.problem import Problem, Seen
from cylforce.core.gap.residuals import chosen, fitted_clean, fixed, held_out_clean, residuals, rms
from cylforce.core.gap.resimulation import Resimulation, known, read_blocks
from cylforce.core.gap.verdict import Judged
from cylforce.core.simulated_effects import Imposed
from cylforce.words.estimate import Array


class Gap(NamedTuple):
    """Per measured row (R,) [N m, rms]: `fixed` parameters, `refit` ones, with what was found simulated, held out,
    `after`, the clean recordings' `floor`; `closure`, the share of the gap's energy (all rows) that goes, with its
    interval `low`..`high`, `removed` [N m, rms], and `shift`: refitted parameters against the tares, in standard
    errors of the prior; `bar` (3, C): fixed, after and floor as pressures of the measured cylinders [bar, rms];
    `left`: residuals (T, R) [N m] of the faulty recordings behind `after`."""

    fixed: Array
    refit: Array
    after: Array
    floor: Array
    closure: float
    low: float
    high: float
    removed: float
    shift: Array
    bar: Array
    left: list[Array]


def gap(search: Search, judged: Judged, rng: np.random.Generator) -> Gap:
    """The size of the gap before and after."""
    problem, (_, before) = search.original, fixed(search)
    refit, shift = _refit(search)
    after = resimulated(search, written(search, judged))
    squares = [np.concatenate([blockwise(e) for e in each]) for each in (before, after)]
    clean = held_out_clean(search)
    floors = [each or [search.floor.rms[None]] for each in (fitted_clean(search), clean)]
    seen, unseen = (np.concatenate([blockwise(e) for e in each]) for each in floors)
    value, interval = closure(squares[0], squares[1], (seen, unseen), rng)
    removed = np.sqrt(max(float(np.nanmean(squares[0]) - np.nanmean(squares[1])), 0.0))
    quiet = (
        (problem.clean, clean)
        if clean
        else (problem.faulty, [np.broadcast_to(search.floor.rms, e.shape) for e in before])
    )
    bar = np.array([rms(bars(problem, *pair)) for pair in ((problem.faulty, before), (problem.faulty, after), quiet)])
    sizes = (rms(before), rms(refit), rms(after), rms(floors[1]))
    return Gap(*sizes, value, *interval, float(removed), shift, bar, after)


class Course(NamedTuple):
    """A faulty recording's name, times `t` (T,) [s] from where its first stretch begins, what is left (T, R) [N m]
    `before` and `after`."""

    name: str
    t: Array
    before: Array
    after: Array


def courses(search: Search, gap: Gap) -> list[Course]:
    """What is left of each faulty recording with the parameters as they were, and with what was found simulated."""
    _, before = fixed(search)
    begins = {seen.recorded.name: seen.recorded.begins for seen in reversed(search.original.faulty)}
    return [
        Course(seen.recorded.name, seen.rows.t - begins[seen.recorded.name], a, b)
        for seen, a, b in zip(search.original.faulty, before, gap.left, strict=True)
    ]


def _refit(search: Search) -> tuple[list[Array], Array]:
    """Residuals (T, R) [N m] of the faulty recordings with the parameters refitted to them, and how far these moved
    (P,) [standard errors of the prior]."""
    problem, blocks = search.original, search.original.blocks(search.floor)
    alone = replace(blocks, shared=tuple(range(_base(problem))))
    values = Evidence(alone, weight=np.repeat([0.0, 1.0], [len(blocks.clean), len(blocks.faulty)])).fitted
    n = len(problem.model.parameters)
    return residuals(problem, alone, (), values), values[:n] / problem.spread[:n]


def _base(problem: Problem) -> int:
    """Number of columns of the model's parameters and of loads."""
    return problem.places[0][0]


def written(search: Search, judged: Judged) -> tuple[Cause, ...]:
    """The causes that are written as blocks: those named, and the known ones beside them, which are too small or too
    uncertain to be named, but whose sizes were found together with theirs. None where nothing is named."""
    named = [n.cause for n in judged.named]
    keys = {cause.ranked.key for cause in named}
    beside = [cause for cause in search.causes if cause.ranked.key not in keys] if named else []
    return tuple(cause for cause in (*named, *beside) if cause.known)


def resimulated(search: Search, causes: Sequence[Cause]) -> list[Array]:
    """Residuals (T, R) [N m] of the faulty recordings with the causes switched on in the machine that the clean
    recordings tell. What happens for a moment has sizes that no other stretch knows."""
    if not causes:
        return fixed(search)[1]
    count, clean = len(search.blocks.faulty), len(search.blocks.clean)
    fold = (np.arange(count) // SPAN) % 2
    found: list[Array] = []
    for k in (0, 1):
        weight = np.concatenate([np.ones(clean), np.where(fold == k, 0.0, 1.0)])
        part = _left(search, causes, Evidence(search.blocks, search.evidence.held, weight).fitted)
        found = part if not found else chosen(found, part, search.original, fold == k)
    moments = np.isin(np.arange(count), own_blocks([cause.ranked.option.term for cause in causes]))
    if np.any(moments):
        whole = _left(search, causes, search.evidence.fitted)
        found = chosen(found, whole, search.original, moments)
    return found


def _left(search: Search, causes: Sequence[Cause], fitted: Array) -> list[Array]:
    """What the causes leave with sizes that go with the `fitted` values (N+H,) of all columns and causes."""
    problem, blocks = search.original, search.blocks
    values = problem.fixed(blocks, fitted) if len(blocks.clean) else fitted[: len(blocks.shared)]
    again = patch(search, [c._replace(sizes=_sizes(search, c, fitted)) for c in causes])
    effects = read_blocks(problem.model.machine, again, known(problem))
    try:
        seen = tuple(_resimulation(search, effects, each, values).seen(each) for each in problem.faulty)
    except ValueError:  # such as a load of which more falls out than there is: what cannot be explains nothing
        seen = problem.faulty
    return residuals(replace(problem, faulty=seen), blocks, (), values)


def _resimulation(search: Search, effects: tuple[Imposed, ...], seen: Seen, values: Array) -> Resimulation:
    """The machine that made a recording, by the `values` (N,) of all shared columns."""
    place, load = search.original.of_load(seen), seen.recorded.load
    carried = np.array([load, *(values[place : place + 3] if place is not None else np.zeros(3))])
    own = search.viewer.tares + search.viewer.model.load @ carried
    return Resimulation(search.viewer, effects, own, carried)


def _sizes(search: Search, cause: Cause, fitted: Array) -> Array:
    """Sizes (M,) of a cause that go with fitted values: some of it may have been taken out of the recordings before."""
    k = len(search.blocks.shared)
    for other in search.causes:
        m = len(other.sizes)
        if other.ranked.key == cause.ranked.key:
            return np.asarray(cause.sizes + fitted[k : k + m] - search.evidence.fitted[k : k + m])
        k += m
    raise KeyError(cause.ranked.key)
