"""Which machine changed, when, and what: every change at every recording against none, by Bayes' rule.

On recording k a machine's quantities are x = c + d_k, what it always has and what differs from day to day; after a
change x = c + d_k + w_k B s: B the directions of a `Culprit`, s its sizes, w_k the course: 0 before and 1 after a step,
rising in proportion to time after a bend, 1 on a single day. Everything is normal, so that all but the course and the
culprit is integrated out (see `History`)."""

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.constants import CREDIBLE, HEALTHY, INCIDENT
from cylforce.fleet.causes import FRICTIONS, UNKNOWN, Culprit
from cylforce.fleet.history import History
from cylforce.signals.estimate import Array

MOST_CHANGES = 3  # of one machine; chosen: beyond that it is another machine
LONGEST = 400  # recordings of a machine that are looked at together, its latest ones; chosen: it bounds the memory


class Shape(StrEnum):
    """The course of a change."""

    STEP = "step"
    SLOPE = "slope"
    DAY = "single day"


class Blame(NamedTuple):
    """A culprit and its probability among all that may have changed."""

    name: str
    at: str
    probability: float


class Altered(NamedTuple):
    """A change: its course, `name` and place `at` of the likeliest culprit; the number of the `first` recording that
    shows it; `probability` that there is a change, `when`: that it came with just this recording, `growing`: that it
    grows, which is told as a slope only if it holds as surely as the change itself; `size` and its standard `error` (of
    a slope: at the last recording); the smallest set of culprits that holds the cause with 90 %. A single day has size
    0 if nothing named explains it."""

    shape: Shape
    name: str
    at: str
    unit: str
    first: int
    probability: float
    when: float
    growing: float
    size: float
    error: float
    causes: tuple[Blame, ...]

    @property
    def may_grow(self) -> bool:
        """Whether it is told as a step, but may as well be a slope."""
        return self.shape is Shape.STEP and self.growing > 1.0 - CREDIBLE


class _Asked(NamedTuple):
    """Courses (H, n), the shape of each, the number of the recording that it begins with, its prior."""

    course: Array
    shape: tuple[Shape, ...]
    first: Array
    prior: Array


class _Answer(NamedTuple):
    """For each culprit the log of the evidence (H, G) of its courses and spreads, prior included."""

    logs: tuple[Array, ...]
    none: float

    @property
    def total(self) -> float:
        """Of all together."""
        return float(np.logaddexp(self.none, _log_sum(np.concatenate([each.ravel() for each in self.logs]))))


def changes(history: History, found: Sequence[Culprit], sure: float = CREDIBLE) -> list[Altered]:
    """All changes of a machine that are there with the probability `sure`, the most probable first; single days that
    differ are among them, but are not counted for the others. Each of several is looked for once more beside the
    others: the first that is found may have taken over what another one explains."""
    days: list[Altered] = []
    told: list[_Placed] = []
    while len(told) < MOST_CHANGES and len(days) < len(history.t) - 1:
        each = _likeliest(_beside(history, told), _others(found, told), sure)
        if each is None:
            break
        if each.altered.shape is Shape.DAY:
            days.append(each.altered)
            history = history.without(each.altered.first)
        else:
            told.append(each)
    if len(told) > 1:
        for k in range(len(told)):
            others = [*told[:k], *told[k + 1 :]]
            again = _likeliest(_beside(history, others), _others(found, others), sure)
            told[k] = told[k] if again is None or again.altered.shape is Shape.DAY else again
    return [*(each.altered for each in told), *days]


class _Placed(NamedTuple):
    """A change, its course (n,) and its culprit."""

    altered: Altered
    course: Array
    culprit: Culprit


def _beside(history: History, told: Sequence[_Placed]) -> History:
    """The history of which these changes are known, but not their sizes."""
    courses = tuple((each.course, each.culprit.directions, each.culprit.spreads[-1]) for each in told)
    return replace(history, courses=courses)


def _others(found: Sequence[Culprit], told: Sequence[_Placed]) -> list[Culprit]:
    """The culprits that do not tell the same once more."""
    return [c for c in found if not any(_same(c, each.altered) for each in told)]


def _same(c: Culprit, altered: Altered) -> bool:
    """Whether a culprit would tell the same of a machine once more."""
    return c.at == altered.at and {c.name, altered.name} <= FRICTIONS


def _asked(history: History) -> _Asked:
    """Every step, bend and single day. A change is as probable as the diagnosis takes it to be, a single day that
    differs as what happens at moments."""
    t, n = history.t, len(history.t)
    alive = np.array([np.any(information) for information in history.information])
    steps = np.array([np.arange(n) >= k for k in range(1, n)], dtype=np.float64).reshape(-1, n)
    bends = np.maximum(t - t[: n - 1, None], 0.0) / np.maximum(t[-1] - t[: n - 1, None], 1e-9)
    slopes = bends[: max(n - 2, 0)]  # the last bend is a step
    days = np.eye(n)
    course = np.concatenate([steps, slopes, days])
    shape = (*[Shape.STEP] * len(steps), *[Shape.SLOPE] * len(slopes), *[Shape.DAY] * n)
    first = np.concatenate([np.arange(1, n), np.arange(1, len(slopes) + 1), np.arange(n)])
    kinds = len(steps) + len(slopes)
    lasting = (1.0 - HEALTHY - INCIDENT) / kinds
    prior = np.concatenate([np.full(kinds, lasting), np.full(n, INCIDENT / n)])
    return _Asked(course, shape, first, np.where(alive[first], prior, 1e-300))


def _answered(history: History, found: Sequence[Culprit], asked: _Asked) -> _Answer:
    information, pull = history.told(asked.course)
    shares = dict.fromkeys(((c.name, c.at) for c in found), 0)
    for c in found:
        shares[c.name, c.at] += 1
    # what one recording shows of no known form is a single day until the next one shows it, too
    once = (asked.first == len(history.t) - 1) & np.array([shape is not Shape.DAY for shape in asked.shape])
    logs = []
    for c, own in zip(found, _evidence(information, pull, found), strict=True):
        prior = np.log(asked.prior) - np.log(len(shares) * shares[c.name, c.at] * len(c.spreads))
        logs.append(own + np.where(once & (c.name == UNKNOWN), -np.inf, prior)[:, None])
    return _Answer(tuple(logs), float(np.log(HEALTHY)))


def _evidence(information: Array, pull: Array, found: Sequence[Culprit]) -> list[Array]:
    """log of the Bayes factor (H, G) of each culprit; those with equally many directions and spreads at once."""
    told: dict[int, Array] = {}
    alike: dict[tuple[int, ...], list[int]] = {}
    for k, c in enumerate(found):
        alike.setdefault(c.spreads.shape, []).append(k)
    for group in alike.values():
        directions, spreads = (
            np.stack([found[k].directions for k in group]),
            np.stack([found[k].spreads for k in group]),
        )
        told.update(zip(group, _bayes_factors(information, pull, directions, spreads), strict=True))
    return [told[k] for k in range(len(found))]


def _bayes_factors(information: Array, pull: Array, directions: Array, spreads: Array) -> Array:
    """Their logs (C, H, G) for C culprits with `directions` (C, K, M) and `spreads` (C, G, M):
    r' (Q + T^-1)^-1 r / 2 - log det(1 + T Q) / 2, Q and r the information and the pull about the sizes, T their
    variances."""
    q = np.swapaxes(directions, 1, 2)[:, None] @ information @ directions[:, None]
    force, count = (pull @ directions)[:, :, None] * spreads[:, None], spreads.shape[-1]
    square = np.sum(force**2, axis=-1)
    both = np.empty((*force.shape[:3], count + 1, count + 1))
    both[..., :-1, :-1] = q[:, :, None] * (spreads[..., None] * spreads[..., None, :])[:, None] + np.eye(count)
    both[..., :-1, -1] = both[..., -1, :-1] = force
    both[..., -1, -1] = square + 1.0
    # The last pivot is what the force leaves of its square: one factorisation gives the gain and the determinant.
    pivots = np.einsum("...mm->...m", np.linalg.cholesky(both))
    gain = square + 1.0 - pivots[..., -1] ** 2
    return np.asarray(0.5 * gain - np.sum(np.log(pivots[..., :-1]), axis=-1))


def _likeliest(history: History, found: Sequence[Culprit], sure: float) -> _Placed | None:
    """The change that is there most probably; None when that is not `sure`, or it is of no size."""
    asked = _asked(history)
    answer = _answered(history, found, asked)
    day = np.array([shape is Shape.DAY for shape in asked.shape])
    by_course = np.array([np.logaddexp.reduce(each, axis=1) for each in answer.logs])
    lasting, single = (_log_sum(by_course[:, which].ravel()) for which in (~day, day))
    probability = float(np.exp(np.logaddexp(lasting, single) - answer.total))
    if probability < sure:
        return None
    logs = np.where(day if single > lasting else ~day, by_course, -np.inf)
    own = _log_sum(logs.ravel())
    causes = _shares(found, np.exp(np.array([_log_sum(row) for row in logs]) - own))
    chosen = [k for k, c in enumerate(found) if (c.name, c.at) == causes[0][:2]]
    best = max(chosen, key=lambda k: float(np.max(logs[k])))
    slope = np.array([shape is Shape.SLOPE for shape in asked.shape])
    growing = float(np.exp(_log_sum(logs[best][slope]) - _log_sum(logs[best])))
    h = int(np.argmax(np.where(slope & (growing < CREDIBLE), -np.inf, logs[best])))
    at_first = logs[best][asked.first == asked.first[h]]
    when = float(np.exp(_log_sum(at_first) - _log_sum(logs[best])))
    size, error = _size(history, found[best], asked.course[[h]], answer.logs[best][h])
    if abs(size) < found[best].least:
        return None
    c, shape, first = found[best], asked.shape[h], int(asked.first[h])
    kept = _smallest(causes)
    altered = Altered(shape, c.name, c.at, c.unit, first, probability, when, growing, size, error, kept)
    return _Placed(altered, asked.course[h], c)


def _size(history: History, c: Culprit, course: Array, logs: Array) -> tuple[float, float]:
    """Size of a culprit along one course (1, n), and its standard error."""
    (information,), (pull,) = history.told(course)
    spread = c.spreads[int(np.argmax(logs))]
    q = c.directions.T @ information @ c.directions + np.diag(spread**-2.0)
    covariance = np.linalg.inv(q)
    return float((covariance @ (c.directions.T @ pull))[0]), float(np.sqrt(covariance[0, 0]))


def _shares(found: Sequence[Culprit], probability: Array) -> list[Blame]:
    """Probabilities by name and place, the largest first."""
    total: dict[tuple[str, str], float] = {}
    for c, p in zip(found, probability.tolist(), strict=True):
        total[c.name, c.at] = total.get((c.name, c.at), 0.0) + p
    return [Blame(*key, p) for key, p in sorted(total.items(), key=lambda item: -item[1])]


def _smallest(causes: Sequence[Blame]) -> tuple[Blame, ...]:
    kept, mass = list[Blame](), 0.0
    for blame in causes:
        kept.append(blame)
        mass += blame.probability
        if mass >= CREDIBLE:
            break
    return tuple(kept)


def _log_sum(logs: Array) -> float:
    return float(np.logaddexp.reduce(logs)) if len(logs) else -np.inf
