"""Which term explains the faulty recordings best."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.evidence import Evidence, Told
from cylforce.diagnosis.problem import TEMPER, Option, Problem, bent
from cylforce.diagnosis.unknown import NAME
from cylforce.effects.fault import Distortion, Place, TimeCourse
from cylforce.effects.library import Proposal
from cylforce.effects.loads.first_moment_change import FirstMomentChange
from cylforce.signals.estimate import Array

BEYOND = 2.0  # times the largest plausible size
LARGEST, LARGER = 1.2, 0.05  # of that, which can be named; of a score that a form must be better by whose size is more
FOLLOWED = 0.005  # of a score: what the law that bends with the load follows of any other law of friction
ASIDE = 5.0  # times what is usual, what inertia may come with a first moment
WRONG = 0.02  # of the squares of sizes in several windows: how much of them may have a sign that cannot be
FREER = 0.05  # of a score that sizes free at any instant must be better by
ALIEN = 0.1  # the same, beside a torque at one joint of which nothing is known
PART = 0.3  # of the best score: what one with fewer sizes must explain where it is
EQUAL = 1.0  # nats between what the same recording would turn round
UNLIKELY = 0.3  # of a size's logarithm, by which it is below the least plausible one: half a nat
SURELY = 8.0  # standard errors
TIE = 3.0  # nats that are no difference
EXACT = 0.001  # of a score, by which no known form need be as good as a torque of which nothing is known


class Ranked(NamedTuple):
    """An option, what the data tell of it, its `score` [nats]: its evidence less what its freedom costs; how much of it
    is what the return pressures say, `returned`."""

    option: Option
    told: Told
    score: float
    returned: float = 0.0

    @property
    def key(self) -> tuple[str, str]:
        """Name and place."""
        return self.option.proposal.name, self.option.proposal.at

    @property
    def free(self) -> bool:
        """Whether its sizes are free at any instant."""
        return self.option.proposal.course is TimeCourse.WINDOWS

    @property
    def clock(self) -> bool:
        """Whether it is clocks that are apart: of all readings, after whatever else is wrong with them."""
        return self.option.proposal.course is TimeCourse.CLOCK


def leading(found: Ranked, values: Array) -> Array:
    """The sizes along the axes of the magnitude, (W, A): one row per window or recording; of what begins at an instant
    the block in which it begins does not count."""
    proposal, term = found.option.proposal, found.option.term
    width = len(dict.fromkeys(term.columns))
    sizes = values.reshape(-1, width)[:, : proposal.about.axes]
    if proposal.course not in (None, TimeCourse.WINDOWS):
        sizes = sizes[np.count_nonzero(term.course, axis=1)[::width] > 1]
    return sizes


def magnitude(found: Ranked, values: Array, errors: Array) -> float:
    """The size as one number: over its axes, and over the windows if it has several (rms), the better known ones
    counting more: where few joints move, much of a force has no effect, and could be anything."""
    squares, variances = (np.sum(leading(found, x) ** 2, axis=1) for x in (values, errors))
    return float(np.sqrt(np.average(squares, weights=1.0 / np.maximum(variances, 1e-300))))


def certain(found: Ranked, values: Array, covariance: Array) -> float:
    """The magnitude of what is free at any instant, from its `covariance` (M, M): along each direction less what its
    error alone would make of it, for the part of a force that no joint feels could be anything; at least what it surely
    is once, for small ones may be beside a large one."""
    width, axes = len(dict.fromkeys(found.option.term.columns)), found.option.proposal.about.axes
    squares, weights, once = [], [], 0.0
    for k in range(0, len(values), width):
        own = slice(k, k + axes)
        variance, direction = np.linalg.eigh(covariance[own, own])
        along = np.abs(direction.T @ values[own])
        once = max(once, float(np.max(along - SURELY * np.sqrt(np.maximum(variance, 0.0)))))
        squares.append(np.sum(np.maximum(along**2 - variance, 0.0)))
        weights.append(1.0 / max(float(np.sum(variance)), 1e-300))
    return max(float(np.sqrt(np.average(squares, weights=weights))), once)


def ranking(
    problem: Problem, evidence: Evidence, wanted: Sequence[Proposal] | None = None, *, besides: Sequence[Ranked] = ()
) -> list[Ranked]:
    """The best option of every name and place, best first; those in `besides` are not asked again."""
    best: dict[tuple[str, str], Ranked] = {}
    value: dict[tuple[str, str], float] = {}
    taken = {r.key for r in besides}
    for option in problem.options(evidence, wanted):
        if (option.proposal.name, option.proposal.at) in taken:
            continue
        told = evidence.of(option.term, TEMPER)
        returned = _returned(problem, option, told)
        follows = FOLLOWED * max(told.evidence, 0.0) if bent(option.proposal.group[0]) else 0.0
        found = Ranked(option, told, told.evidence - option.cost - follows + returned, returned)
        worth = found.score - LARGER * abs(found.score) * too_large(found)
        if worth > value.get(found.key, -1e300) and _possible(found):
            best[found.key], value[found.key] = found, worth
    order = {(p.name, p.at): k for k, p in reversed(list(enumerate(problem.proposals)))}
    ranked = sorted(best.values(), key=lambda r: -value[r.key])
    narrow = _narrower(ranked, problem, evidence)
    return [narrow, *(r for r in ranked if r is not narrow)] if narrow else _simplest(ranked, order)


def _narrower(ranked: list[Ranked], problem: Problem, evidence: Evidence) -> Ranked | None:
    """What comes before the best one, if the sizes of that are free at any instant: a known effect that has fewer of
    them and where it is, which is much of it, explains as much: the rest may be something else."""
    if not ranked or not ranked[0].free:
        return None
    first = ranked[0]
    for other in (r for r in ranked if r.score >= PART * first.score):
        incident = other.key[0] != NAME and other.option.proposal.course is not None
        if incident and width(other) < width(first) and _as_good(other, first, problem, evidence):
            return other
    return None


def width(found: Ranked) -> int:
    """How many sizes there are in one window."""
    return len(dict.fromkeys(found.option.term.columns))


def _as_good(other: Ranked, first: Ranked, problem: Problem, evidence: Evidence) -> bool:
    """Whether an option explains in its own windows as much as the `first` one explains there."""
    hit = np.flatnonzero(np.any(other.option.term.course, axis=0)).tolist()
    told = evidence.of(problem.each_of(tuple(dict.fromkeys(first.option.term.columns)), hit), TEMPER)
    return other.score >= (1.0 - FREER) * (told.evidence - other.option.cost)


def _returned(problem: Problem, option: Option, told: Told) -> float:
    """What the return pressures say of an error of a pressure sensor [nats]; alone they make no cause."""
    effect = option.proposal.group[0]
    if effect.about.place is not Place.PRESSURE or not isinstance(effect, Distortion):
        return 0.0
    return min(problem.returns.support(effect, option.proposal.where, float(told.value[0])), max(told.evidence, 0.0))


def _simplest(ranked: list[Ranked], order: dict[tuple[str, str], int]) -> list[Ranked]:
    """The ranking, but first among those as good as the best stands the one with the fewest sizes, of equals the one
    that has a plausible size, or else that the library lists first; none that is larger than can be. Sizes that are
    free at any instant follow what they are not, too."""
    if not ranked:
        return ranked
    best = ranked[0]
    tied = [r for r in ranked if r.score > best.score - _tie(r, best)]
    tied = [r for r in tied if not too_large(r)] or tied
    fewest = min((len(r.option.term.columns) for r in tied), default=0)
    tied = [r for r in tied if len(r.option.term.columns) == fewest]
    likely = max((r.score - _unlikely(r) for r in tied), default=0.0)
    equal = [r for r in tied if r.score - _unlikely(r) > likely - EQUAL]
    first = min(equal, key=lambda r: order[r.key], default=None)
    return ranked if first is None else [first, *(r for r in ranked if r is not first)]


def _tie(found: Ranked, best: Ranked) -> float:
    """By how many nats an option may be behind the best one and count as good; a torque of which nothing is known, free
    at any instant, by few if it has no fewer sizes there."""
    if not best.free:
        return max(TIE, EXACT * best.score) if best.key[0] == NAME else TIE
    if not (found.free and found.key[0] == NAME):
        return max(TIE, FREER * best.score)
    return ALIEN * best.score if width(found) < width(best) else TIE


def _unlikely(found: Ranked) -> float:
    """How implausible the size is because it is small [nats]."""
    small = np.log(max(found.option.proposal.about.low / max(_size(found), 1e-300), 1.0))
    return float(0.5 * (small / UNLIKELY) ** 2)


def too_large(found: Ranked) -> bool:
    """Whether the size is larger than can be named."""
    return _size(found) > LARGEST * found.option.most


def _possible(found: Ranked) -> bool:
    """Whether the sign is one that the effect can have, and the size not beyond all that is plausible."""
    about, each = found.option.proposal.about, leading(found, found.told.value)[:, 0]
    wrong = np.sum(np.square(each[about.sign * each < 0.0]))
    right = wrong <= WRONG * np.sum(each**2)
    return (
        bool(right and _size(found) <= BEYOND * found.option.most) and _alike(found) and itself(found, found.told.value)
    )


def _alike(found: Ranked) -> bool:
    """Whether the inertia that comes with a first moment is not far beyond what such has."""
    effect = found.option.proposal.group[0]
    if not isinstance(effect, FirstMomentChange):
        return True
    inertia = float(found.told.value[-1])
    return abs(inertia) <= ASIDE * effect.typical[-1]


def plausible(found: Ranked) -> bool:
    """Whether the size is at least the least plausible one."""
    return _size(found) >= found.option.proposal.about.low


def itself(found: Ranked, values: Array) -> bool:
    """Whether an option at sizes `values` (M,) is more than what it has besides its own size (a mass its moments): then
    that must be plausible."""
    about = found.option.proposal.about
    if found.free or len(dict.fromkeys(found.option.term.columns)) <= about.axes:
        return True
    return magnitude(found, values, np.sqrt(np.diag(found.told.covariance))) >= about.low


def _size(found: Ranked) -> float:
    return magnitude(found, found.told.value, np.sqrt(np.diag(found.told.covariance)))
