"""A machine at work: loads of which nothing is known hang in the bucket, and while the teeth touch the ground nothing
can be told. Only stretches free of contact count (`recordings/lifts.py`), each with one load of its own."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.columns.rows import BLOCK
from cylforce.diagnosis.columns.statistics import Shared, blocked, polynomials, shared
from cylforce.diagnosis.inference.asking import CLOCK, Asking, with_noise
from cylforce.diagnosis.inference.discrepancy import LEVELS, Moments, Scatter, moments
from cylforce.diagnosis.inference.hypotheses import Inference
from cylforce.diagnosis.numbers import HAPPENS, HEAVY, STICKS
from cylforce.diagnosis.recordings.lifts import FreeOfContact, Whitened, stretches
from cylforce.effects.fault import INCIDENTAL, TimeCourse
from cylforce.effects.library import Proposal
from cylforce.signals.estimate import Array

CARRIED = ("load.mass", "load.X", "load.Z", "load.J")


@dataclass(frozen=True)
class Loads(Moments):
    """What hangs in the bucket: one load in all blocks of a stretch; `stretch` (B,): its number. `noise`
    (B, R, 1+SMOOTH, I): products of the sensors' noise in a load's columns and in what is left, whole and along each
    polynomial; `theirs` (R,): energy of that noise in what is left, per row."""

    stretch: NDArray[np.int_]
    noise: Array
    theirs: Array

    def weighed(self, noise: Scatter) -> tuple[Array, Array, float]:
        """The same as of single blocks, of every stretch, without the noise that a load's columns share with what is
        left."""
        across, precision, _ = super().weighed(noise)
        across[..., -1] -= np.einsum("rq,brqi->bi", noise.weight(self.theirs), self.noise, optimize=True)
        count, unit = int(self.stretch[-1]) + 1, np.eye(precision.shape[-1])
        each, within = np.zeros((count, *across.shape[1:])), np.zeros((count, *precision.shape[1:]))
        np.add.at(each, self.stretch, across)
        np.add.at(within, self.stretch, precision - unit)
        within += unit
        return each, within, 0.5 * float(np.sum(np.linalg.slogdet(within)[1]))

    def expected(self, left: Array, noise: Scatter) -> tuple[Array, Array]:
        """Sizes (B, I) in every block by what coefficients (K+1,) leave, and their covariance (B, I, I)."""
        sizes, covariance = super().expected(left, noise)
        return sizes[self.stretch], covariance[self.stretch]


class AtWork(NamedTuple):
    """Recordings of work of which only stretches free of contact count: the `question`, the `case` put to them; the
    `share` of the rows in which the teeth touch the ground or a load hangs."""

    question: Asking
    case: Inference
    share: float


class _Seen(NamedTuple):
    """The stretches of a recording, its rows in blocks that lie within one (N,), -1: none, the number of each block's
    stretch, and what hangs in the bucket (T, I)."""

    stretches: list[FreeOfContact]
    rows: NDArray[np.int_]
    numbers: list[int]
    carried: Array


def at_work(
    question: Asking, values: Array, put: Callable[[Asking], Inference], rng: np.random.Generator
) -> AtWork | None:
    """Recordings as those of work, None where no stretch is free of contact. `values` (K,): the columns that last of
    the machine in order; `put`: how a question is put to it."""
    found, apart = _found(question, values)
    if not any(each.stretches for each in found):
        return None
    noise = [_noise(question, n, each, rng) for n, each in enumerate(found)]
    faulty = tuple(each._replace(products=np.delete(each.products, _of_loads(each), axis=-1)) for each in noise)
    laid = replace(question, layout=tuple(each.rows for each in found), noisy=question.noisy._replace(faulty=faulty))
    case = put(laid)
    carried = np.concatenate([each.products[..., _of_loads(each)] for each in noise])
    case = replace(case, moments=_loads(laid, found, carried, case.sums.theirs), apart=apart)
    return AtWork(laid, case, _busy(question, found))


def hangs(question: Asking, p: Proposal) -> bool:
    """Whether an effect is a mass in or on the tool: a load of which nothing is known does the same."""
    last = len(question.viewer.model.machine.links) - 1
    return p.course is TimeCourse.AFTER or (p.weighs and p.where == last)


def _found(question: Asking, values: Array) -> tuple[list[_Seen], float]:
    """The stretches of every recording, and the log likelihood of the rows outside of them."""
    problem, settle = question.problem, question.viewer.slow.settle_steps
    unit, first = problem.unusual[: len(CARRIED)], problem.lasting
    found, apart = [], 0.0
    for each in question.whites(problem.faulty):
        rows = each.rows.astype(np.float64)
        loads = rows[..., first : first + len(CARRIED)]
        left = rows[..., -1] - rows[..., :first] @ values
        own = stretches(Whitened(left, loads, each.good), HEAVY * unit, STICKS * unit, settle)
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


def _laid(found: list[FreeOfContact], count: int) -> _Seen:
    rows, numbers, carried = [], [], np.zeros((count, len(CARRIED)))
    for n, each in enumerate(found):
        own = np.arange(each.first, each.last)
        carried[own] = each.carried
        for part in np.array_split(own, -(-len(own) // BLOCK)):
            rows.append(np.concatenate([part, np.full(BLOCK - len(part), -1)]))
            numbers.append(n)
    return _Seen(found, np.concatenate([np.zeros(0, dtype=np.int_), *rows]), numbers, carried)


def _busy(question: Asking, found: Sequence[_Seen]) -> float:
    """The share of the rows in which the teeth touch the ground or a load hangs."""
    settle = question.viewer.slow.settle_steps
    empty = sum(s.last - s.first + 2 * settle for each in found for s in each.stretches if not s.loaded)
    return 1.0 - empty / sum(len(each.carried) for each in found)


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
    plain = moments(question.whites(problem.faulty), question.own, question.scene.spread, within, unit)
    numbers, size = _numbered(found)
    across, inner = plain.across * size[:, None, :, None], plain.within * (size[:, :, None] * size[:, None])[:, None]
    shape = (*plain.waves.shape[:2], 1 + plain.waves.shape[2], len(CARRIED))  # none without references
    noise = noise * unit * size[:, None, None] if len(noise) else np.zeros(shape)
    return Loads(across, inner, plain.waves * size[:, None, None], plain.smooth, numbers, noise, theirs)


def _numbered(found: Sequence[_Seen]) -> tuple[NDArray[np.int_], Array]:
    """Of every block the number of its stretch, of all recordings (B,), and the usual sizes of its load (B, I), of
    what is unusual."""
    first, numbers, sizes = 0, [], []
    for each in found:
        numbers += [first + n for n in each.numbers]
        sizes += [HEAVY if each.stretches[n].loaded else STICKS for n in each.numbers]
        first += len(each.stretches)
    return np.array(numbers), np.repeat(np.array(sizes)[:, None], len(CARRIED), axis=1)
