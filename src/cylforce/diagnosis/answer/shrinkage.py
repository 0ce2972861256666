"""How far the gap shrinks: what was found is written as blocks `[[effects]]`, and the identified machine with those
blocks is simulated again along the recorded motion, each stretch with sizes that were fitted without it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.answer import objections
from cylforce.diagnosis.answer.causes import Cause
from cylforce.diagnosis.answer.closure import blockwise, closure
from cylforce.diagnosis.answer.fitting import Sized
from cylforce.diagnosis.answer.patch import patch
from cylforce.diagnosis.answer.resimulation import Resimulation, read_blocks
from cylforce.diagnosis.answer.verdict import Judged, Search, Verdict
from cylforce.diagnosis.columns.problem import Seen
from cylforce.diagnosis.inference.residuals import (
    FOLDS,
    SPAN,
    added,
    chosen,
    clean,
    counting,
    refitted,
    residuals,
    rms,
)
from cylforce.diagnosis.inference.sizes import plausible
from cylforce.diagnosis.numbers import HALF, SAME, SLIGHT, WIDEST
from cylforce.effects.imposed import Imposed
from cylforce.signals.estimate import Array

AT_WORK = (
    "the machine works in these recordings: this was found in the stretches in which nothing touches the ground, with "
    "loads of which nothing is known, so that neither the share of the difference nor what it does is told"
)


class Gap(NamedTuple):
    """Per measured row (R,) [N m, rms]: `fixed` parameters, `refit` ones, with what was found simulated, held out,
    `after`, the clean recordings' `floor`; `closure`, the share of the gap's energy (all rows) that goes, with its
    interval `low`..`high`, NaN where that says nothing; `objection`: why the causes are not named, in a sentence, empty
    if nothing speaks against them: their closure is not known or surely below SLIGHT (of what happens at moments, whose
    sizes are of the very blocks, the value itself), or `objections` has a reason;
    `partial`: a closure below HALF, told or not; `removed` [N m, rms], and `shift`: refitted parameters against what
    they were, in standard errors of the prior; `nominal` and `left`: residuals (T, R) [N m] of the faulty recordings
    behind `fixed` and `after`, `clean`: of the clean ones, unseen by their fit."""

    fixed: Array
    refit: Array
    after: Array
    floor: Array
    closure: float
    low: float
    high: float
    objection: str
    partial: bool
    removed: float
    shift: Array
    nominal: list[Array]
    left: list[Array]
    clean: list[Array]

    @property
    def refuted(self) -> bool:
        """True if something speaks against naming the causes."""
        return bool(self.objection)


def tried(search: Search, judged: Judged, rng: np.random.Generator) -> tuple[Search, Judged, Gap, str]:
    """The causes and the verdict once what is named has been simulated, the gap, and a warning where that refutes it.
    At work nothing is: of what contact and loads do, which are most of that gap, no effect takes away anything."""
    if search.working:
        return _at_work(search, judged, rng)
    if len(judged.named) == 1 and len(search.causes) > 1:  # the size of what is named must not rest on what is not
        search, judged = _alone(search, judged)
    size = gap(search, written(judged), rng)
    if len(judged.named) > 1:  # the first may be right, and those beside it not
        alone = _alone(search, judged)
        other = gap(alone[0], written(alone[1]), rng)
        shown = [n for n in judged.named[1:] if _shows(search, n.cause, other)]
        if len(shown) < len(judged.named) - 1:
            judged = judged._replace(named=(judged.named[0], *shown))
            size = gap(search, written(judged), rng)
        if not other.refuted and (size.refuted or not shown):
            (search, judged), size = alone, other
    if not size.refuted:
        partly = judged.verdict is Verdict.EXPLAINED and size.partial
        return search, judged._replace(verdict=Verdict.PARTLY) if partly else judged, size, ""
    nothing = Judged(Verdict.UNKNOWN, (), judged.explained, (judged.named[0].cause.key,))
    return search, nothing, gap(search, (), rng), size.objection


def _at_work(search: Search, judged: Judged, rng: np.random.Generator) -> tuple[Search, Judged, Gap, str]:
    """Return what `tried` returns, of a machine at work: only its magnitude may speak against a cause.

    Without references nothing is named: they alone show what unknown loads and contact look like on this machine, and
    no known cases say how often a name would be right.
    """
    against = objections.of_magnitude(search, written(judged))
    if judged.named and not search.original.clean:
        judged = Judged(Verdict.NOT_OBSERVABLE, (), 0.0)
    elif against:
        judged = Judged(Verdict.NOT_OBSERVABLE, (), 0.0, (judged.named[0].cause.key,))
    return search, judged, gap(search, (), rng), against or (AT_WORK if judged.named else "")


def _alone(search: Search, judged: Judged) -> tuple[Search, Judged]:
    """The first cause without those beside it, of the size that it then has."""
    first, fit = judged.named[0], search.fit
    cause = first.cause
    if cause.form is not None:
        (cause, *_), fit = search.alone()
    named = first._replace(cause=cause, share=1.0)
    explained = judged.explained * first.share
    return search._replace(causes=(cause,), fit=fit), judged._replace(named=(named,), explained=explained)


def _shows(search: Search, cause: Cause, size: Gap) -> bool:
    """Whether more is left without a cause, at the joint where it adds most, than references leave of each other."""
    each = rms(added(search.original, cause.columns, cause.sizes, cause.course))
    floor = search.question.floor.rms  # of a joint that no reference moves its own
    most = int(np.argmax(each / floor))
    return bool(size.after[most] ** 2 > (1.0 + SAME) * floor[most] ** 2)


def gap(search: Search, causes: Sequence[Cause], rng: np.random.Generator) -> Gap:
    """The size of the gap before and after some causes are simulated."""
    simulation = Simulation(search, causes)
    before, after = (simulation.left(those) for those in ((), causes))
    refit, shift = refitted(search.question, before)
    both = (simulation.clean.seen, simulation.clean.unseen)
    seen, unseen = (each or [search.question.floor.rms[None]] for each in both)
    squares = [np.concatenate([blockwise(e) for e in each]) for each in (before, after, seen, unseen)]
    value, (low, high) = closure(squares[0], squares[1], (squares[2], squares[3]), rng)
    told = (value, low, high) if high - low <= WIDEST and not search.working else (float("nan"),) * 3
    fixed, refit_rms, after_rms, floor = (rms(each) for each in (before, refit, after, unseen))
    return Gap(
        *(fixed, refit_rms, after_rms, floor),
        *told,
        _objection(search, causes, (before, after), high if all(c.lasts for c in causes) else value),
        bool(causes) and value < HALF,
        float(np.sqrt(max(float(np.nanmean(squares[0]) - np.nanmean(squares[1])), 0.0))),
        shift,
        before,
        after,
        simulation.clean.unseen,
    )


def _objection(
    search: Search, causes: Sequence[Cause], left: tuple[Sequence[Array], Sequence[Array]], closed: float
) -> str:
    """Return why some causes are not named, in a sentence, empty if nothing speaks against them.

    left:   residuals (T, R) of the faulty recordings [N m], without the causes and with them
    closed: the most of the gap's energy that the simulation may remove, NaN if the gap is too small for a share
    """
    if not causes:
        return ""
    hardly = "" if closed >= SLIGHT else objections.HARDLY.format(objections.names_of(causes))  # NaN is no closure
    return objections.of_magnitude(search, causes) or hardly or objections.of_simulation(search, causes, *left)


def written(judged: Judged) -> tuple[Cause, ...]:
    """The causes that are simulated and written as blocks: those named."""
    return tuple(n.cause for n in judged.named)


class Simulation:
    """The machine that the clean recordings tell, with effects switched on, along the faulty ones' motion. Where the
    loads hang, and the sizes, are what the `causes` together tell; without one, where they leave least."""

    def __init__(self, search: Search, causes: Sequence[Cause]) -> None:
        self.search, self.causes = search, tuple(causes)
        self.clean = clean(search.question)
        which = tuple(c.form for c in self.causes if c.form is not None)
        self._fit = replace(search.fit, which=which)

    def left(self, causes: Sequence[Cause]) -> list[Array]:
        """Residuals (T, R) [N m] of the faulty recordings with some of the causes switched on, each stretch with sizes
        that were fitted without it; NaN in blocks that do not count. What happens for a moment has sizes that no other
        stretch knows."""
        return counting(self.search.question, self._whole(causes))

    def _whole(self, causes: Sequence[Cause]) -> list[Array]:
        search, problem = self.search, self.search.original
        if not causes:
            return residuals(problem, search.at_rest(self.causes, self._fit.whole, self.clean.values))
        if any(not c.lasts for c in causes):
            return self._left(causes, self._fit.whole)
        fold = (np.arange(len(problem.times)) // SPAN) % FOLDS
        left = self._left(causes, self._fit.told(fold != 0))
        for k in range(1, FOLDS):
            left = chosen(left, self._left(causes, self._fit.told(fold != k)), problem, fold == k)
        return left

    def _left(self, causes: Sequence[Cause], told: Sized) -> list[Array]:
        """What causes leave with the sizes that were fitted together."""
        search, problem = self.search, self.search.original
        now = [self._sized(c, told) for c in causes]
        values = search.at_rest(self.causes, told, self.clean.values)
        if not problem.clean:  # parameters that are known as well as they were identified give way to effects
            values[: problem.first] = told.own
        effects = read_blocks(problem.model.machine, patch(search, now), tuple(p.group for p in problem.proposals))
        try:
            seen = tuple(_resimulation(search, effects, each, values).seen(each) for each in problem.faulty)
        except ValueError:  # such as a load of which more falls out than there is: what cannot be explains nothing
            seen = problem.faulty
        return residuals(replace(problem, faulty=seen), values)

    def _sized(self, cause: Cause, told: Sized) -> Cause:
        """A cause of the size that a fit tells, by as much as it differs from that of the whole one; what happens at
        moments as it is."""
        if cause.form is None:
            return cause
        column, whole = self.search.question.forms[cause.form][1], self.search.fit.whole
        now, before = (plausible(column, each.sizes[cause.form]) for each in (told, whole))
        return cause._replace(sizes=plausible(column, cause.sizes.ravel() + now - before).reshape(cause.sizes.shape))


def _resimulation(search: Search, effects: tuple[Imposed, ...], seen: Seen, values: Array) -> Resimulation:
    """The machine that made a recording, by the values (K,) of the columns that last."""
    place, load = search.original.of_load(seen), seen.recorded.load
    carried = np.array([load, *(values[place : place + 3] if place is not None else np.zeros(3))])
    own = search.viewer.tares + search.viewer.model.load @ carried
    return Resimulation(search.viewer, effects, own, carried)
