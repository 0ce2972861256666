"""From weights to bookings: which weight of a lift is booked, what remained in the bucket, and what left it.

Errors of tares, friction and zeros are the same while a load is lifted and while the bucket returns, as far as they do
not change from one to the other: the sensitivities of both weights to them are kept, so that the difference of both is
better known than either."""

from math import sqrt
from typing import NamedTuple

import numpy as np

from cylforce.estimation.model import Tares
from cylforce.estimation.residual import GOOD_ENOUGH, SMALLEST
from cylforce.service.adaptation import Drift
from cylforce.signals.estimate import Array, Booking
from cylforce.signals.units import DEGREE

DUMPING = 0.7  # of a grab's load: what is less than that is on its way out; chosen: spills are smaller, dumps larger
REPOSE = 35.0 * DEGREE  # by which a bucket tilts to empty: angle of repose of loose soil and gravel, 30 to 40 deg
GONE = -1  # in place of the samples in motion: the bucket has been seen empty since, but not certainly enough
AGREES = 3.0  # standard errors within which two weights of one lift are the same; chosen


class Weighed(NamedTuple):
    """A weight at some instant of a lift: `mass` [kg] as it would be without drift; `noise` [kg^2]: variance of what
    averages out within the lift; `gain` (P,) and `drifted` (D,): change of the mass per unit of each tare and of each
    drift; `moving`: number of samples in motion on which it is based; `tilt` [rad]: angle of the tool to the house when
    this load was first weighed, None where the tool does not empty by tilting; `slopes` (H,): change of the mass per
    unit of an error of each signal that is not noticed, None: not known; `hung` [rad]: the tool's angle when this load
    began to hang."""

    mass: float
    noise: float
    gain: Array
    drifted: Array
    moving: int
    tilt: float | None = None
    slopes: Array | None = None
    hung: float | None = None


class Probable(NamedTuple):
    """Of H signals the errors that explain the torques best (`sizes`), and how much of them is `certain`: the root of
    the square less its variance, which is the mean square of an error without noise (0: less than its noise). `off`:
    probability that any signal is off."""

    sizes: Array
    certain: Array
    off: float = 1.0

    @property
    def expected(self) -> Array:
        """Root of the mean square (H,) of each error: as large as it seems if a signal is off, else nothing."""
        return np.asarray(sqrt(self.off) * self.sizes)

    @property
    def expected_certain(self) -> Array:
        """The same of what is certain."""
        return np.asarray(sqrt(self.off) * self.certain)


class Beside(NamedTuple):
    """What a weight remembers besides: `tilt` and `slopes` as above."""

    tilt: float | None = None
    slopes: Array | None = None


class Missed(NamedTuple):
    """A load that was lifted and will not be booked: how many there were, its mass [kg], and whether the measurement
    was interrupted; else the empty bucket was not seen clearly enough before the next load."""

    number: int
    mass: float
    interrupted: bool


NONE_MISSED = Missed(0, 0.0, interrupted=False)


class Books(NamedTuple):
    """State of the booking: the newest weight of the present lift, which becomes the `candidate` of a loaded bucket, or
    the `remainder` in an empty one, when the lift has gone on for a while; the loaded weight that was booked last,
    while the bucket returns (`dumped`); the last booking; the last load that is not booked; whether the candidate is
    `remembered` from before an interruption: no load has hung since, so that it may be gone; whether bookings are
    `withheld`, because it is not sure that the sensors agree; `probable` errors of the signals, None: not known;
    whether the parameters are `unconfirmed`: they may be another machine's."""

    newest: Weighed | None = None
    candidate: Weighed | None = None
    dumped: Weighed | None = None
    booking: Booking | None = None
    missed: Missed = NONE_MISSED
    remembered: bool = False
    withheld: bool = False
    probable: Probable | None = None
    unconfirmed: bool = False


def corrected(weight: Weighed, drift: Drift) -> float:
    """Mass [kg] with the drift as it is known now."""
    return weight.mass - float(weight.drifted @ drift.values)


class Variances(NamedTuple):
    """What a weight's standard error [kg] consists of, in squares [kg^2]: noise, tares, drift, scale, and errors of
    signals that are not noticed."""

    noise: float
    tares: float
    drift: float
    scale: float
    unnoticed: float


def variances(weight: Weighed, tares: Tares, drift: Drift, sizes: Array | None = None) -> Variances:
    """Of the corrected mass; signals are off by `sizes` (H,), each by itself."""
    known = float(weight.gain @ tares.covariance @ weight.gain)
    drifting = float(weight.drifted @ drift.covariance @ weight.drifted)
    off = 0.0 if weight.slopes is None or sizes is None else float(((weight.slopes * sizes) ** 2).sum())
    return Variances(weight.noise, known, drifting, (corrected(weight, drift) * tares.scale_error) ** 2, off)


def error(weight: Weighed, tares: Tares, drift: Drift, sizes: Array | None = None) -> float:
    """Standard error [kg] of the corrected mass: noise, tares, drift, scale, signals off by `sizes` (H,)."""
    return sqrt(sum(variances(weight, tares, drift, sizes)))


def difference_error(lifted: Weighed, left: Weighed, tares: Tares, drift: Drift, sizes: Array | None = None) -> float:
    """Standard error [kg] of what left the bucket, without the errors that both weights have in common."""
    return error(_difference(lifted, left), tares, drift, sizes)


def _difference(lifted: Weighed, left: Weighed) -> Weighed:
    """What left the bucket."""
    both = None if lifted.slopes is None or left.slopes is None else lifted.slopes - left.slopes
    return Weighed(
        lifted.mass - left.mass,
        lifted.noise + left.noise,
        lifted.gain - left.gain,
        lifted.drifted - left.drifted,
        moving=0,
        slopes=both,
    )


def noted(books: Books, weight: Weighed, rated: float, t_us: int, tares: Tares, drift: Drift) -> Books:
    """The state when a lift has gone on to the present `weight`: the newest weight before it is now known to be one of
    a load that hung. It is the candidate for booking, or it shows that the bucket is empty."""
    settled, books, enough = books.newest, books._replace(newest=weight), GOOD_ENOUGH * rated
    if settled is None or settled.noise > enough**2:
        return books
    if corrected(settled, drift) >= SMALLEST * rated:
        better = _better(books.candidate, settled, tares, drift)
        return _passed(books, settled, tares, drift)._replace(candidate=better, dumped=None, remembered=False)
    lifted = books.candidate or books.dumped
    if lifted is None or books.withheld or not _known(books, lifted, settled, enough, tares, drift):
        return books._replace(candidate=books.candidate and books.candidate._replace(moving=GONE))
    if not _has_left(lifted, settled, tares, drift):
        return books
    return _returned(books, lifted, settled, t_us, tares, drift)


def _has_left(lifted: Weighed, left: Weighed, tares: Tares, drift: Drift) -> bool:
    """Return whether the bucket has lost more than the error of what it lost.

    One mass near SMALLEST may read as a load and a moment later as an empty bucket: nothing has left it."""
    by = corrected(lifted, drift) - corrected(left, drift)
    return by > AGREES * difference_error(lifted, left, tares, drift)


def _known(books: Books, lifted: Weighed, left: Weighed, enough: float, tares: Tares, drift: Drift) -> bool:
    """Whether the lifted weight is known well enough, also if any one signal is off by what is certain of that, and
    what is `left` in the bucket or what left it is, too. The scale counts as far as the data sheet of cylinders, pins
    and sensors bounds it. What only the masses bound is the same in every lift, and no later lift could do better: it
    is in the booked standard error, and withholds nothing."""
    if error(lifted, tares, drift) > enough or _certain(lifted.slopes, books.probable) > enough:
        return False
    return min(error(left, tares, drift), difference_error(lifted, left, tares, drift)) <= enough


def _certain(slopes: Array | None, probable: Probable | None) -> float:
    """Error [kg] that is certain if one signal is off, the one with the largest: they explain the same torques, so that
    it is one of them and not all."""
    if slopes is None or probable is None:
        return 0.0
    return float(np.abs(slopes * probable.expected_certain).max(initial=0.0))


def parted(books: Books) -> Books:
    """The state when a lift has ended."""
    return books._replace(newest=None, dumped=None)


def spilled(books: Books) -> Books:
    """The state when the load has changed while it hung: any later weight of it is better."""
    before = books.candidate
    return books._replace(newest=None, candidate=before and before._replace(moving=0), dumped=None)


def unseen(books: Books) -> Books:
    """The state after a time in which the bucket may have been emptied and filled again: it is not known when, and
    whether, the load that hung left it."""
    missed = books.missed if books.candidate is None else _missed(books, books.candidate.mass, interrupted=True)
    return books._replace(newest=None, candidate=None, dumped=None, missed=missed, remembered=False)


def _missed(books: Books, mass: float, *, interrupted: bool) -> Missed:
    return Missed(books.missed.number + 1, mass, interrupted)


def _passed(books: Books, now: Weighed, tares: Tares, drift: Drift) -> Books:
    """The state with a load reported as not booked that another one follows: the bucket has been seen empty between
    them, but not clearly; or has turned as for a dump that was not seen; or the measurement was interrupted."""
    before = books.candidate
    if before is None:
        return books
    by = corrected(now, drift) - corrected(before, drift)
    smaller = by < 0.0
    turned_unseen = smaller and before.moving != GONE and _turned_and_back(before, now)
    if not (books.remembered or before.moving == GONE or turned_unseen):
        return books
    same = abs(by) <= AGREES * difference_error(now, before, tares, drift)
    if same or (books.remembered and smaller and _leaves(before, now, drift)):
        return books
    return books._replace(missed=_missed(books, corrected(before, drift), interrupted=books.remembered))


def _better(before: Weighed | None, now: Weighed, tares: Tares, drift: Drift) -> Weighed:
    """The weight to be booked: that of most motion, unless the bucket has gained or lost a part of its load since. A
    load that is being dumped is on its way out; one that has become smaller in the bucket as it hung before is a new
    one: a part was tipped off."""
    if before is None or before.moving == GONE:
        return now
    by = corrected(now, drift) - corrected(before, drift)
    differs = abs(by) > AGREES * difference_error(now, before, tares, drift)
    if by < 0.0 and differs and _leaves(before, now, drift):
        return before
    if differs:
        return now
    return now._replace(tilt=before.tilt) if now.moving >= before.moving else before


def _leaves(before: Weighed, now: Weighed, drift: Drift) -> bool:
    """Return whether a smaller load is the rest of the one before, which is being dumped.

    The tool turned by more than REPOSE from where that one was weighed until this one hung, and is still turned. A
    wheel loader's bucket turns as far in the heap, while it curls; what is weighed there is weighed late, that one with
    the bucket curled."""
    if before.tilt is None or now.hung is None:
        return corrected(now, drift) < DUMPING * corrected(before, drift)
    return abs(now.hung - before.tilt) > REPOSE and not _turned_and_back(before, now)


def _turned_and_back(before: Weighed, now: Weighed) -> bool:
    """Return whether the tool had turned by more than REPOSE when this load began to hang, and has turned back.

    The load may be the next one, the dump of the one before not having been seen, or what a partial dump spared."""
    if before.tilt is None or now.hung is None or now.tilt is None:
        return False
    return abs(now.hung - before.tilt) > REPOSE >= abs(now.tilt - before.tilt)


def _returned(books: Books, lifted: Weighed, left: Weighed, t_us: int, tares: Tares, drift: Drift) -> Books:
    """The state with the candidate booked. While the bucket returns, the booking becomes more precise: what remained in
    it and how friction and zeros have drifted is known better and better."""
    last = books.booking
    if last is None:
        number = 1
    elif books.candidate is not None:
        number = last.number + 1
    else:
        number, t_us = last.number, last.t_us
    mass, remains = corrected(lifted, drift), corrected(left, drift)
    tares = tares._replace(scale_error=tares.reported_scale_error)
    sizes = None if books.probable is None else books.probable.expected
    booking = Booking(
        number,
        t_us,
        mass,
        error(lifted, tares, drift, sizes),
        remains,
        error(left, tares, drift, sizes),
        mass - remains,
        difference_error(lifted, left, tares, drift, sizes),
    )
    return books._replace(candidate=None, dumped=lifted, booking=booking, remembered=False)
