"""How far the gap shrinks: what was found is written as blocks `[[effects]]`, and the identified machine with those
blocks is simulated again along the recorded motion, each stretch with sizes that were fitted without it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.bars import bars
from cylforce.diagnosis.closure import SPAN, WIDEST, blockwise, closure
from cylforce.diagnosis.evidence import Evidence, own_blocks
from cylforce.diagnosis.numbers import HALF, SELDOM, SLIGHT
from cylforce.diagnosis.patch import patch
from cylforce.diagnosis.problem import Problem, Seen
from cylforce.diagnosis.residuals import chosen, fitted_clean, held_out_clean, residuals, rms
from cylforce.diagnosis.resimulation import Resimulation, known, read_blocks
from cylforce.diagnosis.verdict import Cause, Judged, Search, Verdict
from cylforce.effects.fault import TimeCourse
from cylforce.effects.imposed import Imposed
from cylforce.signals.estimate import Array

REFUTED = "simulated with {}, the machine hardly comes nearer to the recordings: not named"


class Gap(NamedTuple):
    """Per measured row (R,) [N m, rms]: `fixed` parameters, `refit` ones, with what was found simulated, held out,
    `after`, the clean recordings' `floor`; `closure`, the share of the gap's energy (all rows) that goes, with its
    interval `low`..`high`, NaN where that says nothing; `refuted`: causes whose closure is surely below SLIGHT,
    without where something may jump and the blocks of what is free at any instant, unless these are many; `partial`:
    below HALF, told or not; `removed` [N m, rms], and `shift`: refitted parameters against the tares, in standard
    errors of the prior; `bar` (3, C): fixed, after and floor as pressures of the measured cylinders [bar, rms];
    `nominal` and `left`: residuals (T, R) [N m] of the faulty recordings behind `fixed` and `after`."""

    fixed: Array
    refit: Array
    after: Array
    floor: Array
    closure: float
    low: float
    high: float
    refuted: bool
    partial: bool
    removed: float
    shift: Array
    bar: Array
    nominal: list[Array]
    left: list[Array]


def tried(search: Search, judged: Judged, rng: np.random.Generator) -> tuple[Judged, Gap, str]:
    """The verdict once what is named has been simulated, the gap, and a warning where that refutes it."""
    size = gap(search, judged, rng)
    if not size.refuted:
        partly = judged.verdict is Verdict.EXPLAINED and size.partial
        return judged._replace(verdict=Verdict.PARTLY) if partly else judged, size, ""
    names = " and ".join("{}@{}".format(*n.cause.key) for n in judged.named)
    nothing = Judged(Verdict.UNKNOWN, (), judged.explained)
    return nothing, gap(search, nothing, rng), REFUTED.format(names)


def gap(search: Search, judged: Judged, rng: np.random.Generator) -> Gap:
    """The size of the gap before and after."""
    problem, causes = search.original, written(search, judged)
    refit, shift = _refit(search)
    simulation = Simulation(search, causes)
    before, after = (simulation.left(those) for those in ((), causes))
    squares = [np.concatenate([blockwise(e) for e in each]) for each in (before, after)]
    clean = held_out_clean(search)
    floors = [each or [search.floor.rms[None]] for each in (fitted_clean(search), clean)]
    seen, unseen = (np.concatenate([blockwise(e) for e in each]) for each in floors)
    value, (low, high) = closure(squares[0], squares[1], (seen, unseen), rng)
    asked = np.where(simulation.asked[:, None], 1.0, np.nan)
    a, b = (np.concatenate([blockwise(e) for e in _looked_at(search, each)]) for each in (before, after))
    _, (_, most) = closure(a * asked, b * asked, (seen, unseen), rng)
    told = (value, low, high) if high - low <= WIDEST else (float("nan"),) * 3
    removed = np.sqrt(max(float(np.nanmean(squares[0]) - np.nanmean(squares[1])), 0.0))
    quiet = (
        (problem.clean, clean)
        if clean
        else (problem.faulty, [np.broadcast_to(search.floor.rms, e.shape) for e in before])
    )
    bar = np.array([rms(bars(problem, *pair)) for pair in ((problem.faulty, before), (problem.faulty, after), quiet)])
    sizes = (rms(before), rms(refit), rms(after), rms(floors[1]))
    return Gap(
        *sizes,
        *told,
        bool(causes) and most < SLIGHT,
        bool(causes) and value < HALF,
        float(removed),
        shift,
        bar,
        before,
        after,
    )


def _looked_at(search: Search, left: Sequence[Array]) -> list[Array]:
    """Residuals (T, R) without what the search set aside, where something may jump."""
    seen = [np.isfinite(each.rows.left) for each in search.problem.faulty]
    return [np.where(usable, e, np.nan) for usable, e in zip(seen, left, strict=True)]


class Leftover(NamedTuple):
    """A faulty recording's name, times `t` (T,) [s] from where its first stretch begins, what is left (T, R) [N m]
    `before` and `after`."""

    name: str
    t: Array
    before: Array
    after: Array


def courses(search: Search, gap: Gap) -> list[Leftover]:
    """What is left of each faulty recording with the parameters as they were, and with what was found simulated."""
    begins = {seen.recorded.name: seen.recorded.begins for seen in reversed(search.original.faulty)}
    return [
        Leftover(seen.recorded.name, seen.rows.t - begins[seen.recorded.name], a, b)
        for seen, a, b in zip(search.original.faulty, gap.nominal, gap.left, strict=True)
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
    """The causes that are written as blocks: those named, and the known ones beside them, which are not sure enough to
    be named, but whose sizes were found together with theirs; not what happens at an instant: it goes
    where nothing else explains a moment, and says nothing of its other samples. None where nothing is named."""
    named = [n.cause for n in judged.named]
    keys = {cause.key for cause in named}
    beside = [cause for cause in search.causes if cause.key not in keys] if named else []
    return (*named, *(cause for cause in beside if cause.known and _lasting(cause)))


def _lasting(cause: Cause) -> bool:
    return cause.proposal.course in (None, TimeCourse.CLOCK)


class Simulation:
    """The machine that the clean recordings tell, with effects switched on, along the faulty ones' motion. Where the
    loads hang, and the sizes, are what the `causes` together tell; what is none of them, but free at any instant, takes
    its blocks away."""

    def __init__(self, search: Search, causes: Sequence[Cause]) -> None:
        self.search, self.causes = search, tuple(causes)
        self._terms = [cause.term for cause in causes] or list(search.evidence.held)
        own, clean = {cause.key for cause in causes}, len(search.blocks.clean)
        self._weight = np.ones(clean + len(search.blocks.faulty))
        for other in (c for c in search.causes if own and c.free and c.key not in own):
            self._weight[clean:][np.any(other.term.course != 0.0, axis=0)] = 0.0
        self._fitted = self._told(self._weight)

    @property
    def asked(self) -> NDArray[np.bool_]:
        """Which faulty blocks (B,) tell whether the causes are right: those not taken away, if these are most."""
        kept = self._weight[len(self.search.blocks.clean) :] > 0.0
        return kept if np.mean(kept) >= 1.0 - SELDOM else np.ones_like(kept)

    def _told(self, weight: Array) -> Array:
        return Evidence(self.search.blocks, self._terms, weight).fitted

    def left(self, causes: Sequence[Cause]) -> list[Array]:
        """Residuals (T, R) [N m] of the faulty recordings with some of the causes switched on, each stretch with sizes
        that were fitted without it. What happens for a moment has sizes that no other stretch knows."""
        search, count = self.search, len(self.search.blocks.faulty)
        if not causes:
            return self._left((), self._fitted)
        fold = (np.arange(count) // SPAN) % 2
        found: list[Array] = []
        for k in (0, 1):
            weight = self._weight * np.concatenate([np.ones(len(search.blocks.clean)), np.where(fold == k, 0.0, 1.0)])
            part = self._left(causes, self._told(weight))
            found = part if not found else chosen(found, part, search.original, fold == k)
        moments = np.isin(np.arange(count), own_blocks([cause.term for cause in causes]))
        if np.any(moments):
            found = chosen(found, self._left(causes, self._fitted), search.original, moments)
        return found

    def _left(self, causes: Sequence[Cause], fitted: Array) -> list[Array]:
        """What the causes leave with sizes that go with the `fitted` values (N+H,) of all columns and causes."""
        search, problem, blocks = self.search, self.search.original, self.search.blocks
        if not causes:
            return residuals(problem, blocks, (), problem.fixed(blocks, fitted))
        values = problem.fixed(blocks, fitted) if len(blocks.clean) else fitted[: len(blocks.shared)]
        again = patch(search, [c._replace(sizes=self._sizes(c, fitted)) for c in causes])
        effects = read_blocks(problem.model.machine, again, known(problem))
        try:
            seen = tuple(_resimulation(search, effects, each, values).seen(each) for each in problem.faulty)
        except ValueError:  # such as a load of which more falls out than there is: what cannot be explains nothing
            seen = problem.faulty
        return residuals(replace(problem, faulty=seen), blocks, (), values)

    def _sizes(self, cause: Cause, fitted: Array) -> Array:
        """Sizes (M,) of a cause that go with fitted values: some of it may have been taken out of the recordings
        before."""
        search, shared = self.search, len(self.search.blocks.shared)
        more = _part(self.causes, cause, fitted[shared:])
        return np.asarray(cause.sizes + more - _part(search.causes, cause, search.evidence.fitted[shared:]))


def _part(causes: Sequence[Cause], wanted: Cause, fitted: Array) -> Array:
    """The sizes (M,) of one of the causes among those of all of them."""
    k = 0
    for cause in causes:
        if cause.key == wanted.key:
            return fitted[k : k + len(cause.sizes)]
        k += len(cause.sizes)
    raise KeyError(wanted.key)


def _resimulation(search: Search, effects: tuple[Imposed, ...], seen: Seen, values: Array) -> Resimulation:
    """The machine that made a recording, by the `values` (N,) of all shared columns."""
    place, load = search.original.of_load(seen), seen.recorded.load
    carried = np.array([load, *(values[place : place + 3] if place is not None else np.zeros(3))])
    own = search.viewer.tares + search.viewer.model.load @ carried
    return Resimulation(search.viewer, effects, own, carried)
