"""A machine at work: loads of which nothing is known hang in the bucket, and while the teeth touch the ground nothing
can be told. Only stretches free of contact count (`recordings/lifts.py`), each with one load of its own, or with that
of the stretch before, if it is carried on."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.columns.rows import BLOCK
from cylforce.diagnosis.columns.statistics import Shared, blocked, polynomials, shared
from cylforce.diagnosis.inference.asking import CLOCK, Asking, with_noise
from cylforce.diagnosis.inference.discrepancy import LEVELS, NEVER, Moments, Scatter, evidence
from cylforce.diagnosis.inference.hypotheses import Hypothesis, Inference
from cylforce.diagnosis.inference.posterior import Happened
from cylforce.diagnosis.inference.sizes import Column, log_size
from cylforce.diagnosis.numbers import FALLS, HALF, HAPPENS, HEAVY, STICKS
from cylforce.diagnosis.recordings.lifts import FreeOfContact, Whitened, stretches
from cylforce.effects.fault import INCIDENTAL
from cylforce.effects.library import Proposal
from cylforce.signals.estimate import Array

CARRIED = ("load.mass", "load.X", "load.Z", "load.J")


@dataclass(frozen=True)
class Loads(Moments):
    """What hangs in the bucket: one load in all blocks of a stretch; `stretch` (B,): its number; `on` (S,): whether it
    is that of the stretch before. `noise` (B, R, 1+SMOOTH, I): products of the sensors' noise in a load's columns and
    in what is left, whole and along each polynomial; `theirs` (R,): energy of that noise in what is left, per row."""

    stretch: NDArray[np.int_]
    on: NDArray[np.bool_]
    noise: Array
    theirs: Array

    @cached_property
    def load(self) -> NDArray[np.int_]:
        """The number of every block's load (B,)."""
        return np.asarray((np.cumsum(~self.on) - 1)[self.stretch])

    def weighed(self, noise: Scatter) -> tuple[Array, Array, float]:
        """The same as of single blocks, of every load, without the noise that a load's columns share with what is
        left."""
        across, precision, _ = super().weighed(noise)
        across[..., -1] -= np.einsum("rq,brqi->bi", noise.weight(self.theirs), self.noise, optimize=True)
        count, unit = int(self.load[-1]) + 1, np.eye(precision.shape[-1])
        each, within = np.zeros((count, *across.shape[1:])), np.zeros((count, *precision.shape[1:]))
        np.add.at(each, self.load, across)
        np.add.at(within, self.load, precision - unit)
        within += unit
        return each, within, 0.5 * float(np.sum(np.linalg.slogdet(within)[1]))

    def expected(self, left: Array, noise: Scatter) -> tuple[Array, Array]:
        """Sizes (B, I) in every block by what coefficients (K+1,) leave, and their covariance (B, I, I)."""
        sizes, covariance = super().expected(left, noise)
        return sizes[self.load], covariance[self.load]

    def differing(self, left: Array, noise: Scatter) -> "Losses":
        """In which stretches a load that is carried on is most probably another one, by what coefficients (K+1,)
        leave, and in which of these a part of it fell out."""
        across, precision, _ = replace(self, on=np.zeros_like(self.on)).weighed(noise)
        pull, unit = across @ left, np.eye(precision.shape[-1])
        loads, covariance = np.linalg.solve(precision, pull[..., None])[..., 0], np.linalg.inv(precision)
        less, errors = np.zeros_like(loads), np.zeros_like(loads)
        less[1:] = loads[:-1] - loads[1:]
        errors[1:] = np.sqrt(np.einsum("sii->si", covariance[:-1] + covariance[1:]))
        apart, one = evidence(pull, precision), evidence(pull[:-1] + pull[1:], precision[:-1] + precision[1:] - unit)
        gain = np.append(-np.inf, apart[:-1] + apart[1:] - one)
        differs, same = self.on & (gain > NEVER), np.cumsum(~self.on)
        fell = differs & (less[:, 0] * HEAVY > STICKS)
        for n in np.flatnonzero(fell):  # what comes back was held up
            later = loads[n:][same[n:] == same[n], 0]
            fell[n] = loads[n - 1, 0] - np.max(later) > HALF * less[n, 0]
        return Losses(differs, fell, less, errors)


class Losses(NamedTuple):
    """Whether the load of each stretch (S,) differs from that of the one before though it is carried on, and whether a
    part of it fell out; how much less of it there is (S, I), of HEAVY unusual ones, and standard errors (S, I)."""

    differs: NDArray[np.bool_]
    fell: NDArray[np.bool_]
    less: Array
    errors: Array


class Lost(NamedTuple):
    """Loads of which a part fell out while nothing touched the teeth: how probable that is with the recordings; of each
    of W times the faulty blocks `after` it (W, B) until the load is gone, and what it changed, `sizes` (W, 3) [kg,
    kg m, kg m] with standard errors."""

    happened: Happened
    after: NDArray[np.bool_]
    sizes: Array
    errors: Array


class AtWork(NamedTuple):
    """Recordings of work of which only stretches free of contact count: the `question`, the `case` put to them; the
    `share` of the rows in which the teeth touch the ground or an unknown load hangs; the case if all loads that are
    carried on were the same, `same`; which are not, `losses`; in which of the faulty blocks (S, B) each stretch is;
    the share of the rows in which an unknown load hangs, `lifts`."""

    question: Asking
    case: Inference
    share: float
    same: Inference
    on: NDArray[np.bool_]
    losses: Losses
    blocks: NDArray[np.bool_]
    lifts: float

    def lost(self, idle: Hypothesis, gap: float, spill: Proposal) -> Lost | None:
        """What fell out of the loads, None if nothing did; `idle`: the machine in order, of which a load seldom falls
        out; `gap`: what is left, of the floor, if no load did so."""
        fell = self.losses.fell
        if not np.any(fell):
            return None
        unit = HEAVY * self.question.problem.unusual[: len(spill.incidents)]
        sizes, errors = (each[fell][:, : len(unit)] * unit for each in (-self.losses.less, self.losses.errors))
        errors = np.hypot(errors, spill.about.form * np.abs(sizes))
        density = _density(spill, sizes[:, 0], errors[:, 0]) + float(np.log(np.sqrt(2.0 * np.pi) * unit[0]))
        often, seldom = (_prior(fell[self.on], p) for p in (HAPPENS, FALLS))
        log, share = idle.log + density + often - seldom, float(np.sum(fell)) / self.blocks.shape[1]
        happened = Happened((spill.name, spill.at), log, share, idle.rest, gap)
        return Lost(happened, self._after(fell), sizes, errors)

    def _after(self, where: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The faulty blocks (W, B) in which a load is carried on from each of some stretches (S,)."""
        load, number = np.cumsum(~self.on), np.arange(len(self.on))
        own = [(load == load[n]) & (number >= n) for n in np.flatnonzero(where)]
        return np.stack([np.any(self.blocks[each], axis=0) for each in own])


def _prior(fell: NDArray[np.bool_], share: float) -> float:
    """Log of the probability that a part falls out of just these of the loads that are carried on."""
    return float(np.sum(np.log(np.where(fell, share, 1.0 - share))))


def _density(spill: Proposal, sizes: Array, errors: Array) -> float:
    """Log of the prior density of the size of losses (W,): their root mean square."""
    about, size = spill.about, float(np.sqrt(np.mean(sizes**2)))
    column = Column(spill.name, spill.at, (0,), about.low, about.high, about.sign, 1)
    return log_size(column, np.array([about.sign * size]), np.array([[np.mean(errors**2) / len(sizes)]]))


class _Seen(NamedTuple):
    """The stretches of a recording, its rows in blocks that lie within one (N,), -1: none, the number of each block's
    stretch, and what hangs in the bucket (T, I); `idle`: the machine does not work there, and nothing hangs."""

    stretches: list[FreeOfContact]
    rows: NDArray[np.int_]
    numbers: list[int]
    carried: Array
    idle: bool


def at_work(
    question: Asking,
    values: Array,
    put: Callable[[Asking], Inference],
    rng: np.random.Generator,
    idling: frozenset[str] = frozenset(),
) -> AtWork | None:
    """Recordings as those of work, None where no stretch is free of contact. `values` (K,): the columns that last of
    the machine in order; `put`: how a question is put to it; `idling`: names of recordings that count in full, for the
    machine does not work there."""
    found, apart = _found(question, values, idling)
    if not any(each.stretches for each in found if not each.idle):
        return None
    noise = [_noise(question, n, each, rng) for n, each in enumerate(found)]
    faulty = tuple(each._replace(products=np.delete(each.products, _of_loads(each), axis=-1)) for each in noise)
    laid = replace(question, layout=tuple(each.rows for each in found), noisy=question.noisy._replace(faulty=faulty))
    case = put(laid)
    carried = np.concatenate([each.products[..., _of_loads(each)] for each in noise])
    loads = _loads(laid, found, carried, case.sums.theirs)
    free = replace(case, moments=replace(loads, on=np.zeros_like(loads.on)), apart=apart)
    losses = loads.differing(free.under((), free.state(free.usual))[2], free.usual)
    same, case = (replace(free, moments=replace(loads, on=on)) for on in (loads.on, loads.on & ~losses.differs))
    shares = _busy(question, found)
    return AtWork(laid, case, shares[0], same, loads.on, losses, _blocks(found), shares[1])


def _found(question: Asking, values: Array, idling: frozenset[str]) -> tuple[list[_Seen], float]:
    """The stretches of every recording, and the log likelihood of the rows outside of them."""
    problem, settle = question.problem, question.viewer.slow.settle_steps
    unit, first = problem.unusual[: len(CARRIED)], problem.lasting
    found, apart = [], 0.0
    for each, seen in zip(question.whites(problem.faulty), problem.faulty, strict=True):
        if seen.recorded.name in idling:
            found.append(_laid([FreeOfContact(0, len(each.rows), False, np.zeros(len(CARRIED)))], len(each.rows), True))
            continue
        rows = each.rows.astype(np.float64)
        loads = rows[..., first : first + len(CARRIED)]
        left = rows[..., -1] - rows[..., :first] @ values
        tilt = np.sum(seen.rows.posture, axis=1)
        own = stretches(Whitened(left, loads, each.good, tilt), HEAVY * unit, STICKS * unit, settle)
        own = own if not seen.recorded.load else [s._replace(on=False) for s in own]  # told beside what is known
        found.append(_laid(own, len(rows)))
        apart += _apart(left, each.good, own)
    return found, apart


def _apart(left: Array, good: NDArray[np.bool_], found: Sequence[FreeOfContact]) -> float:
    """Log of the probability of the rows (T, R) outside of stretches: whatever is smooth, and noise, with levels of
    their own in every block and joint, log-uniform, no less than the floor's."""
    out = good.copy()
    for each in found:
        out[each.first : each.last] = False
    rows, usable = blocked(np.where(out, left, 0.0)), blocked(out.astype(np.float64))
    basis = polynomials(usable)
    along = np.einsum("btrs,btr->brs", basis, rows, optimize=True)
    count = usable.sum(axis=1) - np.sum(np.any(basis != 0.0, axis=1), axis=2)
    white = np.sqrt(np.maximum(np.sum(rows**2, axis=1) - np.sum(along**2, axis=2), 0.0) / np.maximum(count, 1.0))
    levels = np.concatenate([np.abs(along), white[..., None]], axis=2)
    weight = np.concatenate([np.any(basis != 0.0, axis=1), count[..., None]], axis=2)
    each = -weight * (np.log(np.maximum(levels, 1.0)) + 0.5 * np.minimum(levels, 1.0) ** 2)
    chosen = float(np.log(np.log(LEVELS[-1] / LEVELS[0]))) * np.count_nonzero(weight)
    return float(np.sum(each)) - chosen + 2.0 * float(np.log(HAPPENS)) * len(found)


def _laid(found: list[FreeOfContact], count: int, idle: bool = False) -> _Seen:
    rows, numbers, carried = [], [], np.zeros((count, len(CARRIED)))
    for n, each in enumerate(found):
        own = np.arange(each.first, each.last)
        carried[own] = each.carried
        for part in np.array_split(own, -(-len(own) // BLOCK)):
            rows.append(np.concatenate([part, np.full(BLOCK - len(part), -1)]))
            numbers.append(n)
    return _Seen(found, np.concatenate([np.zeros(0, dtype=np.int_), *rows]), numbers, carried, idle)


def _busy(question: Asking, found: Sequence[_Seen]) -> tuple[float, float]:
    """Return the share of the working rows with contact or an unknown load, and the share with an unknown load.

    Recordings in which the machine does not work are left out.
    """
    settle, rows = question.viewer.slow.settle_steps, {True: 0, False: 0}
    for own, seen in zip(found, question.problem.faulty, strict=True):
        for s in own.stretches if not own.idle else ():
            rows[s.loaded and not seen.recorded.load] += s.last - s.first + 2 * settle
    whole = sum(len(each.carried) for each in found if not each.idle)
    return 1.0 - rows[False] / whole, rows[True] / whole


def _blocks(found: Sequence[_Seen]) -> NDArray[np.bool_]:
    """The faulty blocks (S, B), as the recordings have them, in which each stretch is."""
    ends = np.cumsum([0] + [-(-len(each.carried) // BLOCK) for each in found])
    own = [(first, s) for first, each in zip(ends, found, strict=False) for s in each.stretches]
    number = np.arange(ends[-1])
    each = [(number >= first + s.first // BLOCK) & (number <= first + (s.last - 1) // BLOCK) for first, s in own]
    return np.array(each, dtype=np.bool_)


def _noise(question: Asking, n: int, seen: _Seen, rng: np.random.Generator) -> Shared:
    """The noise that columns of a recording, at last those of a load, share with what is left beside its loads."""
    problem, first = question.problem, question.problem.lasting
    own = [*range(first), first + CLOCK, *range(first, first + len(CARRIED))]
    if not problem.clean:
        return Shared.nothing(len(question.floor.rms), len(own) + 1)
    (twin,) = with_noise(question.viewer, problem, problem.faulty[n : n + 1], rng)
    again = replace(problem, base=problem.riding)
    each = again.columns(twin) - problem.columns(problem.faulty[n])
    hanging = each[..., first : first + len(CARRIED)]
    each[..., -1] -= np.einsum("tri,ti->tr", hanging, seen.carried)
    return shared(each, question.floor, own, seen.rows)


def _of_loads(each: Shared) -> list[int]:
    last = each.products.shape[-1] - 1
    return [*range(last - len(CARRIED), last)]


def _loads(question: Asking, found: Sequence[_Seen], noise: Array, theirs: Array) -> Loads:
    problem = question.problem
    within = [problem.lasting + INCIDENTAL.index(name) for name in CARRIED]
    unit = problem.spread[within]
    plain = question.moments(within)
    numbers, size = _numbered(found)
    on = np.array([s.on for each in found for s in each.stretches])
    across, inner = plain.across * size[:, None, :, None], plain.within * (size[:, :, None] * size[:, None])[:, None]
    shape = (*plain.waves.shape[:2], 1 + plain.waves.shape[2], len(CARRIED))  # none without references
    noise = noise * unit * size[:, None, None] if len(noise) else np.zeros(shape)
    return Loads(across, inner, plain.waves * size[:, None, None], plain.smooth, numbers, on, noise, theirs)


def _numbered(found: Sequence[_Seen]) -> tuple[NDArray[np.int_], Array]:
    """Of every block the number of its stretch, of all recordings (B,), and the usual sizes of its load (B, I), of
    what is unusual."""
    first, numbers, sizes = 0, [], []
    for each in found:
        numbers += [first + n for n in each.numbers]
        usual = [HEAVY if s.loaded else STICKS for s in each.stretches] if not each.idle else [0.0]
        sizes += [usual[n] for n in each.numbers]
        first += len(each.stretches)
    return np.array(numbers), np.repeat(np.array(sizes)[:, None], len(CARRIED), axis=1)
