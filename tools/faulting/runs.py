"""The service over samples with a fault, and how wrong what it says is."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.service.core import Core
from cylforce.service.plausibility.suspicion import Level, SensorSuspicion
from cylforce.service.service import WeighingService
from cylforce.signals.estimate import Array, Booking, Quantity, Status
from cylforce.signals.events import Event

CLEAR = 3.0  # standard errors by which a value is wrong
LONG_S = 1.0  # s for which a wrong value is to be shown at most
SAME_S = 3.0  # s by which a bucket may be booked earlier than in order; later it may be until the next one is


class Course(NamedTuple):
    """What the service said at every tick: time [s]; values, standard errors and whether they are OK (T, 3) of gross
    weight, force x and z; the suspicions as they changed, with their times [s]; the bookings; the service
    afterwards."""

    t_s: Array
    values: Array
    errors: Array
    ok: NDArray[np.bool_]
    suspicions: list[tuple[float, SensorSuspicion]]
    bookings: list[Booking]
    service: WeighingService

    def since(self, begin: float, end: float = np.inf) -> "Course":
        """What was said in a time [s]."""
        k = np.logical_and(self.t_s >= begin, self.t_s < end)
        said = [(t, s) for t, s in self.suspicions if begin <= t < end]
        booked = [b for b in self.bookings if begin <= 1e-6 * b.t_us < end]
        return self._cut(k)._replace(suspicions=said, bookings=booked)

    def first(self, size: int) -> "Course":
        """The first `size` ticks."""
        return self._cut(slice(size))

    def _cut(self, rows: "slice | NDArray[np.bool_]") -> "Course":
        return self._replace(t_s=self.t_s[rows], values=self.values[rows], errors=self.errors[rows], ok=self.ok[rows])


def followed(
    core: Core, events: Iterable[Event], service: WeighingService | None = None, *, whole: bool = True
) -> Course:
    """The service over events, from a copy of `service` on; unless `whole`, until a signal is rejected for good, after
    which nothing is shown any more."""
    service = WeighingService.start(core) if service is None else service.copied(core)
    times: list[float] = []
    rows: list[tuple[Quantity, ...]] = []
    bookings: dict[int, Booking] = {}
    suspicions: list[tuple[float, SensorSuspicion]] = []
    known, before = service.monitor.suspicion, service.estimate.booking
    for event in events:
        estimate = service.on_event(event)
        if estimate is None:
            continue
        times.append(1e-6 * estimate.t_us)
        rows.append((estimate.gross, estimate.force.x, estimate.force.z))
        booking, now = estimate.booking, service.monitor.suspicion
        if booking is not None and (before is None or booking.number != before.number):
            bookings[booking.number] = booking
        if (now.level, now.cause) != (known.level, known.cause):
            suspicions.append((times[-1], now))
            known = now
        if now.latched and not whole:
            break
    table = np.array([[(q.value, q.standard_error, q.status is Status.OK) for q in row] for row in rows])
    ok = table[..., 2] > 0.5
    return Course(np.array(times), table[..., 0], table[..., 1], ok, suspicions, list(bookings.values()), service)


def ended(course: Course, t_s: Array) -> Course:
    """A course with the ticks `t_s` (T,) [s] of the rest, at which nothing was shown."""
    size = len(t_s) - len(course.t_s)
    if size <= 0:
        return course
    nothing, no = np.full((size, 3), np.nan), np.zeros((size, 3), dtype=bool)
    values, errors = (np.concatenate([x, nothing]) for x in (course.values, course.errors))
    return course._replace(t_s=t_s, values=values, errors=errors, ok=np.concatenate([course.ok, no]))


class Wrong(NamedTuple):
    """What a fault did: `share` of the time in which a wrong weight or force was shown as OK, of either alone, that in
    which it was for `longer` than LONG_S, and the longest of it [s]; largest error of an OK weight [kg] and force [N];
    (error, standard error) [kg] of each booking, and how many are wrong; after how many seconds a signal was doubted
    and rejected (NaN: never), and which."""

    share: float
    weight_share: float
    force_share: float
    longer: float
    longest_s: float
    weight: float
    force: float
    bookings: list[tuple[float, float]]
    wrong_bookings: int
    doubted_s: float
    rejected_s: float
    suspicion: SensorSuspicion


def wrong(course: Course, order: Course) -> Wrong:
    """A course with a fault beside that of the same time in `order`. A value is wrong if it is shown as OK and differs
    by more than three standard errors of both; a booking by more than three of its own, or if there is none of that
    bucket in order. Raises ValueError if they are not of the same ticks."""
    if not np.array_equal(course.t_s, order.t_s):
        raise ValueError("the two courses are not of the same ticks")
    away = np.abs(course.values - order.values)
    told = CLEAR * np.hypot(course.errors, np.where(np.isfinite(order.errors), order.errors, 0.0))
    bad = np.logical_and(course.ok, away > told)
    seconds = float(np.median(np.diff(course.t_s)))
    off = errors(course.bookings, order.bookings)
    booked = [(e, b.standard_error) for e, b in zip(off, course.bookings, strict=True)]
    false = sum(abs(e) > CLEAR * s for e, s in booked)
    runs = lengths(np.asarray(bad.any(axis=1)))
    shown = np.where(np.logical_and(course.ok, np.isfinite(away)), away, 0.0)
    doubted, rejected = (_first(course, level) for level in (Level.SUSPECTED, Level.REJECTED))
    return Wrong(
        float(bad.any(axis=1).mean()),
        float(bad[:, 0].mean()),
        float(bad[:, 1:].any(axis=1).mean()),
        sum(n for n in runs if seconds * n > LONG_S) / len(bad),
        seconds * max(runs, default=0),
        float(shown[:, 0].max()),
        float(shown[:, 1:].max()),
        booked,
        false,
        doubted,
        rejected,
        course.service.monitor.suspicion,
    )


def errors(booked: list[Booking], order: list[Booking]) -> list[float]:
    """By how much [kg] each booking differs from that of the same bucket in `order`: the last one before it, or SAME_S
    after it, unless a booking before was of that bucket; else it is of none, and all of its mass is wrong."""
    found, seen = [], 0
    for each in booked:
        number = sum(b.t_us <= each.t_us + 1e6 * SAME_S for b in order)
        found.append(each.mass - (order[number - 1].mass if number > seen else 0.0))
        seen = number
    return found


def _first(course: Course, level: Level) -> float:
    found = [t - float(course.t_s[0]) for t, s in course.suspicions if s.level >= level]
    return found[0] if found else float("nan")


def lengths(marks: NDArray[np.bool_]) -> list[int]:
    """Lengths of the rows of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], marks.astype(np.int64), [0]])))
    return [int(n) for n in edges[1::2] - edges[::2]]
