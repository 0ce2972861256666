"""Recordings put as a question to the probability model: their whitened columns, with those that single effects need
besides, as statistics."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.columns.correction import Applied, left_without
from cylforce.diagnosis.columns.problem import GROWTH_S, Identified, Problem, Seen, looked_at
from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.columns.rows import BLOCK, Viewer
from cylforce.diagnosis.columns.statistics import (
    SMOOTH,
    Shared,
    White,
    crossing,
    energy,
    laid,
    shared,
    statistics,
    white,
)
from cylforce.diagnosis.columns.whitening import Floor, floor_of
from cylforce.diagnosis.inference.discrepancy import Moments, Sums, moments, sums
from cylforce.diagnosis.inference.in_order import InOrder
from cylforce.diagnosis.inference.sizes import Column, Terms
from cylforce.diagnosis.numbers import AGES, EXPECTED, FROM_START_TO_START, GAP, USUALLY
from cylforce.diagnosis.recordings.shaking import white_noise
from cylforce.effects.fault import INCIDENTAL, TimeCourse
from cylforce.effects.library import Proposal
from cylforce.signals.estimate import Array

CLOCK = INCIDENTAL.index("clock")
LOAD = ("load.mass", "load.X", "load.Z")
NEVER = 1e-6  # of a size: as part of the machine
NOISY_S = 300.0  # of a recording, from which the noise that columns and residual share is told: more would take long


class Step(NamedTuple):
    """When a load becomes another one: in block `first` (of all faulty ones), which does not count, until before block
    `last`."""

    first: int
    last: int


@dataclass(frozen=True)
class Asking:
    """A problem under a noise floor; `step`: when a load may have changed; `layout`: of every faulty recording the rows
    that count, in whole blocks (see `laid`), by default all; `aside`: the faulty blocks (B,) that do not count, for
    something everyday happens in them."""

    viewer: Viewer
    problem: Problem
    floor: Floor
    noisy: "Noisy"
    step: Step | None = None
    layout: tuple[NDArray[np.int_], ...] | None = None
    aside: NDArray[np.bool_] | None = None

    @cached_property
    def own(self) -> list[int]:
        """The columns that are asked, of those of `whites`: all that last, the clock, its growth, the load's change."""
        last = len(self.problem.spread)
        more = range(last + 1, last + 1 + len(LOAD)) if self.step else ()
        return [*range(self.problem.lasting), self.problem.lasting + CLOCK, last, *more]

    def whites(self, group: Sequence[Seen], only: Sequence[int] | None = None) -> list[White]:
        """Whitened columns of recordings, with those that effects need besides, what is left last; `only` some of the
        problem's, the others zero."""
        if only is None and group is self.problem.faulty:
            return self._field
        return self._whites(group, slice(None) if only is None else only)

    @cached_property
    def _field(self) -> list[White]:
        return self._whites(self.problem.faulty, slice(None))

    def _whites(self, group: Sequence[Seen], only: Sequence[int] | slice) -> list[White]:
        found, block = [], 0
        for seen in group:
            found.append(self._with_more(white(self.problem.columns(seen), self.floor, only), seen, block))
            block += -(-len(seen.rows.t) // BLOCK)
        if self.layout and group is self.problem.faulty:
            return [laid(w, rows) for w, rows in zip(found, self.layout, strict=True)]
        return found

    def renewed(self, problem: Problem, applied: Sequence[Applied], before: Sums) -> Sums:
        """What `before`, the statistics of the faulty recordings, becomes in a problem with some effects taken out of
        these, in which the columns of all others are as they were."""
        places, proposals = self.problem.places, self.problem.proposals
        own = (places[proposals.index(a.proposal)] for a in applied)
        same = sorted(set(range(self.problem.first, self.problem.lasting)).difference(*own))
        other, unit = replace(self, problem=problem), np.append(self.scene.spread, 1.0)
        only = np.delete(np.arange(len(problem.spread) + 1), same).tolist()
        whites = other.whites(problem.faulty, only)
        if any(not np.array_equal(a.good, b.good) for a, b in zip(self._field, whites, strict=True)):
            return other.sums(problem.faulty, self.noisy.faulty)
        for old, new in zip(self._field, whites, strict=True):
            new.rows[..., same] = old.rows[..., same]
        changed = np.delete(np.arange(len(unit)), same).tolist()
        parts = [crossing(each, self.own, changed) for each in whites]
        whole, smooth = (np.sum(each, axis=0) for each in zip(*parts, strict=True))
        return before.with_products(unit, changed, whole, smooth)

    def _with_more(self, each: White, seen: Seen, block: int) -> White:
        """`block`: number of the recording's first."""
        clock = each.rows[..., self.problem.lasting + CLOCK]
        more = [np.asarray((clock * (seen.rows.t / GROWTH_S)[:, None])[..., None], dtype=np.float64)]
        number = block + np.arange(len(seen.rows.t)) // BLOCK
        counts = np.ones(len(number), dtype=np.bool_)
        if self.step:
            on, counts = (number > self.step.first) & (number < self.step.last), number != self.step.first
            more.append(np.asarray(each.rows[..., self._incidental(LOAD)] * on[:, None, None], dtype=np.float64))
        if self.aside is not None:
            counts = counts & ~self.aside[number]
        rows = np.concatenate([each.rows[..., :-1], *more, each.rows[..., -1:]], axis=-1)
        return White(np.asarray(rows * counts[:, None, None], dtype=np.float32), each.good & counts[:, None])

    def _incidental(self, names: Sequence[str]) -> list[int]:
        return [self.problem.lasting + INCIDENTAL.index(name) for name in names]

    @cached_property
    def scene(self) -> Terms:
        """What all recordings have in common."""
        problem, size = self.problem, self.problem.lasting
        clock = next((p.about for p in problem.proposals if p.course is TimeCourse.CLOCK), None)
        spread = [float(problem.spread[size + CLOCK])] * 2
        always = [clock.low if clock else NEVER * spread[0]] * 2
        if self.step:
            usual = problem.spread[self._incidental(LOAD)].tolist()
            always, spread = always + [NEVER * s for s in usual], spread + usual
        forms = tuple(form for _, form in self.forms)
        whole = [np.concatenate([problem.always[:size], always]), np.concatenate([problem.spread[:size], spread])]
        return Terms(whole[0], whole[1], forms, problem.first)

    @cached_property
    def forms(self) -> list[tuple[Proposal, Column]]:
        """All that may be the cause and lasts, with the numbers of its columns among the `own`."""
        each = zip(self.problem.proposals, self.problem.places, strict=True)
        return [(p, self._form(p, own)) for p, places in each if (own := self._columns(p, places))]

    def _columns(self, p: Proposal, places: tuple[int, ...]) -> tuple[int, ...]:
        size = self.problem.lasting
        if p.course is TimeCourse.CLOCK:
            return (size, size + 1)
        if p.course is TimeCourse.AFTER:
            names = [INCIDENTAL[k - size] for k in places]
            return tuple(size + 2 + LOAD.index(name) for name in names) if self.step else ()
        return () if p.course else places

    def _form(self, p: Proposal, own: tuple[int, ...]) -> Column:
        about = p.about
        high = max(self.problem.largest(p), about.low)
        expected = self.problem.from_sheet and p.name in EXPECTED
        return Column(p.name, p.at, own, about.low, high, about.sign, about.axes, p.bends, about.form, expected)

    def sums(self, group: Sequence[Seen], shared: Sequence[Shared], kept: NDArray[np.bool_] | None = None) -> Sums:
        """Statistics of recordings; `shared`: noise of each one's columns that is also in what is left; `kept` (B,):
        the blocks that count, by default all."""
        whites = self.whites(group) if kept is None else _kept(self.whites(group), kept)
        each = zip(whites, shared, strict=True)
        parts = [statistics(w, self.own, _padded(noise, len(self.own) + 1)) for w, noise in each]
        return sums(self.scene.spread, parts)

    def moments(self, within: Sequence[int]) -> Moments:
        """What may happen in single blocks of the faulty recordings: numbers of the problem's columns."""
        whites, unit = self.whites(self.problem.faulty), self.problem.spread[list(within)]
        return moments(whites, self.own, self.scene.spread, within, unit)

    @property
    def believed(self) -> "Asking":
        """The same without the noise that columns and what is left share, if taking it off leaves GAP times as much of
        the references as plain least squares (rms): then the sensors' noise is not what they declare, not white, or
        not what limits the floor, as on a slow machine with better sensors than its file says."""
        if not self.problem.clean:
            return self
        clean, faulty = (tuple(each._replace(products=0.0 * each.products) for each in g) for g in self.noisy[:2])
        nothing = Noisy(clean, faulty)
        plain, own = replace(self, noisy=nothing), self.references
        plain.__dict__["references"] = tuple(replace(s, crossed=0.0 * s.crossed) for s in own)
        corrected, least = (asking.machine({}).left for asking in (self, plain))
        return plain if np.any(corrected > GAP * np.maximum(least, 1.0)) else self

    def machine(self, everyday: dict[str, float]) -> InOrder:
        """The machine as its references show it; a step, and what is set aside, is the field's alone."""
        plain = replace(self, step=None, aside=None)
        return InOrder(plain.scene, plain.references, self._ages | everyday, len(self.floor.rms), self._identified)

    @property
    def _identified(self) -> Array | None:
        """Covariance (P, P) of the parameters by the identification, in units of their prior spread."""
        if self.problem.identified is None:
            return None
        covariance = self.problem.identified.covariance
        spread = self.problem.spread[: len(covariance)]
        return np.asarray(covariance / np.outer(spread, spread))

    @cached_property
    def _ages(self) -> dict[str, float]:
        """How far clocks are apart from one recording to another, of the least plausible lag."""
        ages = AGES / self.viewer.model.filters.rate_hz
        clocks = [p.about for p in self.problem.proposals if p.name in FROM_START_TO_START]
        return {about.name: max(USUALLY, ages / about.low) for about in clocks}

    def noise_without(self, applied: Sequence[Applied]) -> Array:
        """Energy of the sensors' noise in what is left (R, 1+SMOOTH), per row and per block along each polynomial, in
        units of the floor's white noise, with some effects taken out of the readings; zeros where it is not known."""
        found = []
        for seen, twin in zip(self.problem.faulty, self.noisy.twins, strict=False):
            plain = seen.recorded._replace(values=seen.recorded.values[: len(twin.values)])
            lost = np.isnan(seen.rows.left)
            once, twice = (left_without(recorded, self.viewer, applied, lost) for recorded in (plain, twin))
            found.append(shared((twice - once)[..., None], self.floor, []))
        return energy(found) if found else np.zeros((len(self.floor.rms), 1 + SMOOTH))

    @cached_property
    def references(self) -> tuple[Sums, ...]:
        """Statistics of each reference."""
        pairs = zip(self.problem.clean, self.noisy.clean, strict=True)
        return tuple(self.sums([seen], [noise]) for seen, noise in pairs)


def _kept(whites: Sequence[White], kept: NDArray[np.bool_]) -> list[White]:
    """Rows of some blocks (B,) of all recordings."""
    found, first = [], 0
    for each in whites:
        count = -(-len(each.rows) // BLOCK)
        on = np.repeat(kept[first : first + count], BLOCK)[: len(each.rows)]
        found.append(White(each.rows[on], each.good[on]))
        first += count
    return found


def _padded(noise: Shared, size: int) -> Shared:
    """The noise of all but the last columns added, of `size` in all: these share none."""
    found = np.zeros((*noise.products.shape[:-1], size))
    found[..., : noise.products.shape[-1] - 1], found[..., -1] = noise.products[..., :-1], noise.products[..., -1]
    return Shared(found, noise.rows)


class Noisy(NamedTuple):
    """Of every recording, clean and faulty, the noise that its columns share with what is left; the beginnings of the
    faulty ones with the sensors' noise once more, `twins`, where it is known."""

    clean: tuple[Shared, ...]
    faulty: tuple[Shared, ...]
    twins: tuple[Recorded, ...] = ()


def noisy(viewer: Viewer, problem: Problem, floor: Floor, rng: np.random.Generator) -> Noisy:
    """From the sensors' noise once more on five minutes of every recording. Where only the faulty recordings determine
    the floor none: the floor is then what all columns leave, and has no noise in common with them."""
    if not problem.floor_known:
        nothing = Shared.nothing(len(floor.rms), problem.lasting + 2)
        return Noisy((), (nothing,) * len(problem.faulty))
    steps = round(NOISY_S * viewer.model.filters.rate_hz)
    clean, faulty = (with_noise(viewer, problem, group, rng, steps) for group in (problem.clean, problem.faulty))
    twin = replace(problem, clean=clean, faulty=faulty, base=problem.riding)
    own = [*range(problem.lasting), problem.lasting + CLOCK]
    found = []
    for group, others in ((problem.clean, twin.clean), (problem.faulty, twin.faulty)):
        pairs = ((problem.columns(seen), twin.columns(other)) for seen, other in zip(group, others, strict=True))
        found.append(tuple(shared(b - a[: len(b)], floor, own) for a, b in pairs))
    return Noisy(found[0], found[1], tuple(seen.recorded for seen in twin.faulty))


def identified_floor(viewer: Viewer, problem: Problem, identified: Identified, rng: np.random.Generator) -> Floor:
    """Return the noise floor of a machine that was identified and has no references.

    The level is the residual torque that the identification left. The colour is that of the sensors' noise, added once
    more to the faulty recordings and filtered as they are: a fit to the faulty residual would whiten the fault away.
    """
    steps = round(NOISY_S * viewer.model.filters.rate_hz)
    plain = replace(problem, proposals=())
    twins = with_noise(viewer, plain, problem.faulty, rng, steps)
    pairs = zip(problem.faulty, twins, strict=True)
    noise = floor_of([twin.rows.left - seen.rows.left[: len(twin.rows.left)] for seen, twin in pairs])
    level = identified.unexplained
    return Floor(level, noise.memory, noise.white * level / noise.rms)


def with_noise(
    viewer: Viewer, problem: Problem, group: Sequence[Seen], rng: np.random.Generator, steps: int | None = None
) -> tuple[Seen, ...]:
    """The first `steps` samples of recordings, by default all, with the sensors' noise once more: as the clean
    recordings show it, without them as the faulty ones do; as declared, where a coarse reading shows none."""
    declared = np.array([s.standard_error for s in viewer.model.machine.signals])
    shown = white_noise([seen.recorded for seen in problem.clean or problem.faulty])
    errors = np.where(np.nan_to_num(shown) > 0.0, shown, declared)
    values = [seen.recorded.values[:steps] for seen in group]
    made = [v + errors * rng.standard_normal(v.shape) for v in values]
    pairs = zip(group, made, strict=True)
    return looked_at(viewer, [seen.recorded._replace(values=v) for seen, v in pairs], problem.proposals)
