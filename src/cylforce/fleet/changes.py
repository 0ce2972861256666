"""Find which machine changed, when, and what: every change at every recording against none, by Bayes' rule.

On recording k a machine's quantities are x = c + d_k, constant values and day-to-day differences. After a change x = c
+ d_k + w_k B s, with B the directions of a `ChangeCause`, s its sizes, and w_k the course: 0 before and 1 after a step,
rising in proportion to time after a bend, 1 on a single day. Everything is normal, so that all but course and cause is
integrated out (see `History`).
"""

from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.constants import CREDIBLE, HEALTHY, INCIDENT
from cylforce.fleet.causes import FRICTIONS, UNKNOWN, ChangeCause
from cylforce.fleet.history import History
from cylforce.signals.estimate import Array

MOST_CHANGES = 3  # changes of one machine; chosen: beyond that it is another machine
LONGEST = 400  # recordings of a machine that are evaluated together, its latest ones; chosen: it bounds the memory


class Shape(StrEnum):
    """The course of a change."""

    STEP = "step"
    SLOPE = "slope"
    DAY = "single day"


class CauseShare(NamedTuple):
    """A cause and its probability among all possible causes.

    name, at: name and place of the cause
    probability: its share
    """

    name: str
    at: str
    probability: float


class MachineChange(NamedTuple):
    """A change of a machine.

    shape: its course
    name, at, unit: name, place and unit of the likeliest cause
    first: number of the first recording that shows it
    probability: probability that there is a change
    when: probability that it came with just this recording
    growing: probability that it grows; it is reported as a slope only if that is as probable as the change itself
    size, error: size of the cause and its standard error; of a slope at the last recording; 0 for a single day without
        a named cause
    causes: smallest set of causes with a probability of 90 %
    """

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
    causes: tuple[CauseShare, ...]

    @property
    def may_grow(self) -> bool:
        """Return whether it is reported as a step, but may as well be a slope."""
        return self.shape is Shape.STEP and self.growing > 1.0 - CREDIBLE


class _Courses(NamedTuple):
    """H courses of a change over n recordings.

    course: (H, n) course over the recordings
    shape: (H,) shape of each
    first: (H,) number of the recording with which it begins
    prior: (H,) prior probability
    """

    course: Array
    shape: tuple[Shape, ...]
    first: Array
    prior: Array


class _Posterior(NamedTuple):
    """Logarithms of evidence times prior.

    logs: for each cause (H, G), of its courses and prior spreads
    none: of no change
    """

    logs: tuple[Array, ...]
    none: float

    @property
    def total(self) -> float:
        """Return the logarithm of the sum of all."""
        return float(np.logaddexp(self.none, _log_sum(np.concatenate([of_cause.ravel() for of_cause in self.logs]))))


def changes(history: History, causes: Sequence[ChangeCause], sure: float = CREDIBLE) -> list[MachineChange]:
    """Return all changes of a machine with at least the probability `sure`, the most probable first.

    Single days that differ are among them, but do not count for the limit MOST_CHANGES. Where there are several
    changes, each is estimated once more beside the others: the first one may have taken over what another one explains.

    causes: possible causes
    """
    days: list[MachineChange] = []
    lasting: list[_Placed] = []
    while len(lasting) < MOST_CHANGES and len(days) < len(history.t) - 1:
        placed = _likeliest(_with_known(history, lasting), _other_causes(causes, lasting), sure)
        if placed is None:
            break
        if placed.change.shape is Shape.DAY:
            days.append(placed.change)
            history = history.without(placed.change.first)
        else:
            lasting.append(placed)
    if len(lasting) > 1:
        for k in range(len(lasting)):
            others = [*lasting[:k], *lasting[k + 1 :]]
            again = _likeliest(_with_known(history, others), _other_causes(causes, others), sure)
            lasting[k] = lasting[k] if again is None or again.change.shape is Shape.DAY else again
    return [*(placed.change for placed in lasting), *days]


class _Placed(NamedTuple):
    """A change with its course.

    change: the change
    course: (n,) its course over the recordings
    cause: its likeliest cause
    """

    change: MachineChange
    course: Array
    cause: ChangeCause


def _with_known(history: History, known: Sequence[_Placed]) -> History:
    """Return the history with known changes of unknown size."""
    courses = tuple((placed.course, placed.cause.directions, placed.cause.spreads[-1]) for placed in known)
    return replace(history, courses=courses)


def _other_causes(causes: Sequence[ChangeCause], known: Sequence[_Placed]) -> list[ChangeCause]:
    """Return the causes that are not the cause of a known change under another name."""
    return [c for c in causes if not any(_same(c, placed.change) for placed in known)]


def _same(c: ChangeCause, change: MachineChange) -> bool:
    """Return whether a cause is that of a change under another name."""
    return c.at == change.at and {c.name, change.name} <= FRICTIONS


def _possible_courses(history: History) -> _Courses:
    """Return every step, bend and single day.

    A lasting change has the prior probability that the diagnosis uses, a single day that of a transient.
    """
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
    return _Courses(course=course, shape=shape, first=first, prior=np.where(alive[first], prior, 1e-300))


def _posterior(history: History, causes: Sequence[ChangeCause], courses: _Courses) -> _Posterior:
    """Return the posterior of every cause along every course, and of no change."""
    information, pull = history.evidence_of(courses.course)
    shares = dict.fromkeys(((c.name, c.at) for c in causes), 0)
    for c in causes:
        shares[c.name, c.at] += 1
    # an unknown difference of the last recording is a single day until the next recording shows it, too
    once = (courses.first == len(history.t) - 1) & np.array([shape is not Shape.DAY for shape in courses.shape])
    logs = []
    for c, factors in zip(causes, _evidence(information, pull, causes), strict=True):
        prior = np.log(courses.prior) - np.log(len(shares) * shares[c.name, c.at] * len(c.spreads))
        logs.append(factors + np.where(once & (c.name == UNKNOWN), -np.inf, prior)[:, None])
    return _Posterior(logs=tuple(logs), none=float(np.log(HEALTHY)))


def _evidence(information: Array, pull: Array, causes: Sequence[ChangeCause]) -> list[Array]:
    """Return the logarithm of the Bayes factor (H, G) of each cause; causes of equal shapes are computed at once."""
    factors: dict[int, Array] = {}
    alike: dict[tuple[int, ...], list[int]] = {}
    for k, c in enumerate(causes):
        alike.setdefault(c.spreads.shape, []).append(k)
    for group in alike.values():
        directions = np.stack([causes[k].directions for k in group])
        spreads = np.stack([causes[k].spreads for k in group])
        factors.update(zip(group, _bayes_factors(information, pull, directions, spreads), strict=True))
    return [factors[k] for k in range(len(causes))]


def _bayes_factors(information: Array, pull: Array, directions: Array, spreads: Array) -> Array:
    """Return the logarithms of the Bayes factors (C, H, G) of C causes.

    r' (Q + T^-1)^-1 r / 2 - log det(1 + T Q) / 2, with Q and r the information and the pull about the sizes, T their
    prior variances.

    directions: (C, K, M)
    spreads: (C, G, M)
    """
    q = np.swapaxes(directions, 1, 2)[:, None] @ information @ directions[:, None]
    force, count = (pull @ directions)[:, :, None] * spreads[:, None], spreads.shape[-1]
    square = np.sum(force**2, axis=-1)
    both = np.empty((*force.shape[:3], count + 1, count + 1))
    both[..., :-1, :-1] = q[:, :, None] * (spreads[..., None] * spreads[..., None, :])[:, None] + np.eye(count)
    both[..., :-1, -1] = both[..., -1, :-1] = force
    both[..., -1, -1] = square + 1.0
    # the last pivot is 1 + r'r less the explained part: one factorisation gives the gain and the determinant
    pivots = np.einsum("...mm->...m", np.linalg.cholesky(both))
    gain = square + 1.0 - pivots[..., -1] ** 2
    return np.asarray(0.5 * gain - np.sum(np.log(pivots[..., :-1]), axis=-1))


def _likeliest(history: History, causes: Sequence[ChangeCause], sure: float) -> _Placed | None:
    """Return the most probable change; None when its probability is below `sure`, or its size is below the cause's
    least.
    """
    courses = _possible_courses(history)
    posterior = _posterior(history, causes, courses)
    day = np.array([shape is Shape.DAY for shape in courses.shape])
    by_course = np.array([np.logaddexp.reduce(of_cause, axis=1) for of_cause in posterior.logs])
    lasting, single = (_log_sum(by_course[:, which].ravel()) for which in (~day, day))
    probability = float(np.exp(np.logaddexp(lasting, single) - posterior.total))
    if probability < sure:
        return None
    logs = np.where(day if single > lasting else ~day, by_course, -np.inf)
    shares = _shares(causes, np.exp(np.array([_log_sum(row) for row in logs]) - _log_sum(logs.ravel())))
    likeliest = [k for k, c in enumerate(causes) if (c.name, c.at) == (shares[0].name, shares[0].at)]
    best = max(likeliest, key=lambda k: float(np.max(logs[k])))
    slope = np.array([shape is Shape.SLOPE for shape in courses.shape])
    growing = float(np.exp(_log_sum(logs[best][slope]) - _log_sum(logs[best])))
    h = int(np.argmax(np.where(slope & (growing < CREDIBLE), -np.inf, logs[best])))
    at_first = logs[best][courses.first == courses.first[h]]
    cause = causes[best]
    size, error = _size(history, cause, courses.course[[h]], posterior.logs[best][h])
    if abs(size) < cause.least:
        return None
    change = MachineChange(
        shape=courses.shape[h],
        name=cause.name,
        at=cause.at,
        unit=cause.unit,
        first=int(courses.first[h]),
        probability=probability,
        when=float(np.exp(_log_sum(at_first) - _log_sum(logs[best]))),
        growing=growing,
        size=size,
        error=error,
        causes=_credible_set(shares),
    )
    return _Placed(change=change, course=courses.course[h], cause=cause)


def _size(history: History, c: ChangeCause, course: Array, logs: Array) -> tuple[float, float]:
    """Return the size of a cause along one course (1, n), and its standard error."""
    (information,), (pull,) = history.evidence_of(course)
    spread = c.spreads[int(np.argmax(logs))]
    q = c.directions.T @ information @ c.directions + np.diag(spread**-2.0)
    covariance = np.linalg.inv(q)
    return float((covariance @ (c.directions.T @ pull))[0]), float(np.sqrt(covariance[0, 0]))


def _shares(causes: Sequence[ChangeCause], probability: Array) -> list[CauseShare]:
    """Return the probabilities by name and place, the largest first."""
    total: dict[tuple[str, str], float] = {}
    for c, p in zip(causes, probability.tolist(), strict=True):
        total[c.name, c.at] = total.get((c.name, c.at), 0.0) + p
    ranked = sorted(total.items(), key=lambda item: -item[1])
    return [CauseShare(name=name, at=at, probability=p) for (name, at), p in ranked]


def _credible_set(shares: Sequence[CauseShare]) -> tuple[CauseShare, ...]:
    """Return the smallest set of causes with the probability CREDIBLE; `shares`: the largest first."""
    credible, mass = list[CauseShare](), 0.0
    for share in shares:
        credible.append(share)
        mass += share.probability
        if mass >= CREDIBLE:
            break
    return tuple(credible)


def _log_sum(logs: Array) -> float:
    """Return the logarithm of the sum of exponentials; -inf of none."""
    return float(np.logaddexp.reduce(logs)) if len(logs) else -np.inf
