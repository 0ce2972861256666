"""From weights to bookings: which weight of a lift is booked, what remained in the bucket, and what left it.

Errors of tares, friction and zeros are the same while a load is lifted and while the bucket returns, as far as they do
not change from one to the other: the sensitivities of both weights to them are kept, so that the difference of both is
better known than either."""

from dataclasses import dataclass, replace
from math import sqrt
from typing import Self

import numpy as np

from cylforce.estimation.model import Tares
from cylforce.estimation.residual import GOOD_ENOUGH, SMALLEST
from cylforce.service.adaptation import DriftKnowledge
from cylforce.service.loading.lift import Lift
from cylforce.service.snapshot import Constants, Estimator
from cylforce.signals.estimate import Array, Booking
from cylforce.signals.units import DEGREE

DUMPING = 0.7  # of a grab's load: what is less than that is on its way out; chosen: spills are smaller, dumps larger
REPOSE = 35.0 * DEGREE  # by which a bucket tilts to empty: angle of repose of loose soil and gravel, 30 to 40 deg
GONE = -1  # in place of the samples in motion: the bucket has been seen empty since, but not certainly enough
AGREES = 3.0  # standard errors within which two weights of one lift are the same; chosen
REFILL_S = 3.0  # s without a measurement in which a bucket may have been emptied and filled again; chosen
# s for which a lift must go on before a weight of it is booked: as long as it takes to end one (weighing.PATIENCE_S)
LATER_S = 0.3


@dataclass(frozen=True, slots=True)
class Weighed:
    """A weight at some instant of a lift.

    mass:    as it would be without drift [kg]
    noise:   variance of what averages out within the lift [kg^2]
    gain:    (P,) change of the mass per unit of each tare
    drifted: (D,) change of the mass per unit of each drift
    moving:  number of samples in motion on which it is based
    tilt:    angle of the tool to the house when this load was first weighed [rad]; None where the tool empties
             without tilting
    slopes:  (H,) change of the mass per unit of an undetected error of each signal; None: not known
    hung:    angle of the tool when this load began to hang [rad]
    """

    mass: float
    noise: float
    gain: Array
    drifted: Array
    moving: int
    tilt: float | None = None
    slopes: Array | None = None
    hung: float | None = None

    def corrected(self, drift: DriftKnowledge) -> float:
        """Return the mass [kg] with the drift as it is known now."""
        return self.mass - float(self.drifted @ drift.values)


def weighed(lift: Lift, parameters: int, tilt: float | None, slopes: Array | None) -> Weighed:
    """Return the present weight of a lift.

    parameters: P
    tilt:       present angle of the tool to the house [rad]
    slopes:     as in `Weighed`
    """
    gain, noise = lift.covariance[0] @ lift.gram, float(lift.covariance[0, 0])
    mass, drifted = float(lift.values[0]), gain[parameters:]
    return Weighed(
        mass,
        noise=noise,
        gain=gain[:parameters],
        drifted=drifted,
        moving=lift.moving,
        tilt=tilt,
        slopes=slopes,
        hung=lift.tilt,
    )


@dataclass(frozen=True, slots=True)
class ProbableErrors:
    """Errors of H signals that explain the torques best.

    sizes:   (H,) of the errors
    certain: (H,) root of the square less its variance: the mean square of an error without noise; 0: less than
             noise
    off:     probability that any signal is off
    """

    sizes: Array
    certain: Array
    off: float = 1.0

    @property
    def expected(self) -> Array:
        """Root of the mean square (H,) of each error: as large as it seems if a signal is off, else nothing."""
        return np.asarray(sqrt(self.off) * self.sizes)

    @property
    def expected_certain(self) -> Array:
        """Root of the mean square (H,) of the certain part of each error."""
        return np.asarray(sqrt(self.off) * self.certain)


@dataclass(frozen=True, slots=True)
class Missed:
    """A load that was lifted and will not be booked.

    number:      how many there were
    mass:        of the last one [kg]
    interrupted: whether the measurement was interrupted; else the empty bucket was not seen clearly enough before the
                 next load
    """

    number: int
    mass: float
    interrupted: bool


NONE_MISSED = Missed(0, 0.0, interrupted=False)


@dataclass(frozen=True, slots=True)
class Variances:
    """Parts of the variance of a weight [kg^2].

    noise:      of the rows
    tares:      by errors of the tares
    drift:      by errors of the drift
    scale:      by the error of the scale
    undetected: by errors of signals that no detector finds
    """

    noise: float
    tares: float
    drift: float
    scale: float
    undetected: float

    @property
    def total(self) -> float:
        """Their sum."""
        return self.noise + self.tares + self.drift + self.scale + self.undetected


class BookingConstants(Constants):
    """What the booking of one machine needs.

    tares:      of the machine
    rated:      rated payload [kg]
    parameters: P, number of tares
    every:      samples of a lift between two weights that are noted
    """

    def __init__(self, tares: Tares, rated: float, rate_hz: float) -> None:
        self.tares, self.rated, self.parameters = tares, rated, len(tares.values)
        self.every = round(LATER_S * rate_hz)
        self.reported = tares._replace(scale_error=tares.reported_scale_error)

    def variances(self, weight: Weighed, drift: DriftKnowledge, tares: Tares, sizes: Array | None = None) -> Variances:
        """Return the parts of the variance of the corrected mass; signals are off by `sizes` (H,), each by itself."""
        slopes = weight.slopes
        return Variances(
            noise=weight.noise,
            tares=float(weight.gain @ tares.covariance @ weight.gain),
            drift=float(weight.drifted @ drift.covariance @ weight.drifted),
            scale=(weight.corrected(drift) * tares.scale_error) ** 2,
            undetected=0.0 if slopes is None or sizes is None else float(((slopes * sizes) ** 2).sum()),
        )

    def error(self, weight: Weighed, drift: DriftKnowledge) -> float:
        """Return the standard error [kg] of the corrected mass by noise, tares, drift and scale."""
        return sqrt(self.variances(weight, drift, self.tares).total)

    def reported_error(self, weight: Weighed, drift: DriftKnowledge, sizes: Array | None) -> float:
        """Return the standard error [kg] with what else is reported: the common scale of all pressures, and signals
        that are off by `sizes` (H,)."""
        return sqrt(self.variances(weight, drift, self.reported, sizes).total)


def difference(lifted: Weighed, left: Weighed) -> Weighed:
    """Return what left the bucket, without the errors that both weights have in common."""
    both = None if lifted.slopes is None or left.slopes is None else lifted.slopes - left.slopes
    return Weighed(
        mass=lifted.mass - left.mass,
        noise=lifted.noise + left.noise,
        gain=lifted.gain - left.gain,
        drifted=lifted.drifted - left.drifted,
        moving=0,
        slopes=both,
    )


@dataclass(slots=True)
class Bookings(Estimator):
    """State of the booking.

    constants:   of the machine
    newest:      newest weight of the present lift
    candidate:   weight of a loaded bucket that is booked when the bucket is seen empty
    dumped:      loaded weight that was booked last, while the bucket returns
    booking:     the last booking
    missed:      the last load that is not booked
    seen_us:     time of the last measurement [us]; None: none yet
    remembered:  whether the candidate is from before an interruption, so that it may be gone
    withheld:    whether bookings wait, because it is not certain that the sensors agree
    probable:    errors of the signals; None: not known
    unconfirmed: whether the parameters may be another machine's
    """

    constants: BookingConstants
    newest: Weighed | None = None
    candidate: Weighed | None = None
    dumped: Weighed | None = None
    booking: Booking | None = None
    missed: Missed = NONE_MISSED
    seen_us: int | None = None
    remembered: bool = False
    withheld: bool = False
    probable: ProbableErrors | None = None
    unconfirmed: bool = False

    @classmethod
    def start(cls, constants: BookingConstants) -> Self:
        """Return the state before any weight."""
        return cls(constants)

    def seen(self, t_us: int) -> None:
        """Note the time [us] of a measurement. After a long pause the bucket may be another one's."""
        if self.seen_us is not None and not 0 <= t_us - self.seen_us <= 1e6 * REFILL_S:
            self.lose_sight()
        self.seen_us = t_us

    def end_lift(self) -> None:
        """A lift has ended."""
        self.newest = self.dumped = None

    def change_load(self) -> None:
        """The load has changed while it hung: any later weight of it is better."""
        self.end_lift()
        if self.candidate is not None:
            self.candidate = replace(self.candidate, moving=0)

    def lose_sight(self) -> None:
        """The bucket may have been emptied and filled again: it is not known when, and whether, the load left it."""
        if self.candidate is not None:
            self._miss(self.candidate.mass, interrupted=True)
        self.newest = self.candidate = self.dumped = None
        self.remembered = False

    def _miss(self, mass: float, *, interrupted: bool) -> None:
        self.missed = Missed(self.missed.number + 1, mass, interrupted)

    def update(self, weight: Weighed, t_us: int, drift: DriftKnowledge) -> None:
        """Take the present weight of a lift that has gone on.

        The newest weight before it is now known to be one of a load that hung. It is the candidate for booking, or it
        shows that the bucket is empty."""
        settled, self.newest, rated = self.newest, weight, self.constants.rated
        if settled is None or settled.noise > (GOOD_ENOUGH * rated) ** 2:
            return
        if settled.corrected(drift) >= SMALLEST * rated:
            better = self._better(settled, drift)
            self._pass(settled, drift)
            self.candidate, self.dumped, self.remembered = better, None, False
            return
        lifted = self.candidate or self.dumped
        if lifted is None or self.withheld or not self._is_known(lifted, settled, drift):
            if self.candidate is not None:
                self.candidate = replace(self.candidate, moving=GONE)
        elif self._has_left(lifted, settled, drift):
            self._book(lifted, settled, t_us, drift)

    def _has_left(self, lifted: Weighed, left: Weighed, drift: DriftKnowledge) -> bool:
        """Return whether the bucket has lost more than the error of what it lost.

        One mass near SMALLEST may read as a load and a moment later as an empty bucket: nothing has left it."""
        by = lifted.corrected(drift) - left.corrected(drift)
        return by > AGREES * self.constants.error(difference(lifted, left), drift)

    def _is_known(self, lifted: Weighed, left: Weighed, drift: DriftKnowledge) -> bool:
        """Return whether the lifted weight is known well enough, also if any one signal is off by the certain part of
        its error, and what is `left` in the bucket, or what left it, is, too.

        The scale counts as far as the data sheet of cylinders, pins and sensors bounds it. What only the masses bound
        is the same in every lift, and no later lift could do better: it is in the booked standard error, and withholds
        nothing."""
        error, enough = self.constants.error, GOOD_ENOUGH * self.constants.rated
        if error(lifted, drift) > enough or self._certain_error(lifted.slopes) > enough:
            return False
        return min(error(left, drift), error(difference(lifted, left), drift)) <= enough

    def _certain_error(self, slopes: Array | None) -> float:
        """Return the error [kg] that is certain if one signal is off, the one with the largest effect. The signals
        explain the same torques, so that it is one of them and not all."""
        if slopes is None or self.probable is None:
            return 0.0
        return float(np.abs(slopes * self.probable.expected_certain).max(initial=0.0))

    def _pass(self, now: Weighed, drift: DriftKnowledge) -> None:
        """Report the candidate as not booked if `now` is another load: the bucket has been seen empty between them, but
        not clearly; or it has turned as for a dump that was not seen; or the measurement was interrupted."""
        before = self.candidate
        if before is None:
            return
        by = now.corrected(drift) - before.corrected(drift)
        smaller = by < 0.0
        turned_unseen = smaller and before.moving != GONE and turned_and_back(before, now)
        if not (self.remembered or before.moving == GONE or turned_unseen):
            return
        same = abs(by) <= AGREES * self.constants.error(difference(now, before), drift)
        if same or (self.remembered and smaller and leaves(before, now, drift)):
            return
        self._miss(before.corrected(drift), interrupted=self.remembered)

    def _better(self, now: Weighed, drift: DriftKnowledge) -> Weighed:
        """Return the weight to be booked: that of most motion, unless the bucket has gained or lost a part of its load
        since.

        A load that is being dumped is on its way out; one that has become smaller in the bucket as it hung before is a
        new one: a part was tipped off."""
        before = self.candidate
        if before is None or before.moving == GONE:
            return now
        by = now.corrected(drift) - before.corrected(drift)
        differs = abs(by) > AGREES * self.constants.error(difference(now, before), drift)
        if by < 0.0 and differs and leaves(before, now, drift):
            return before
        if differs:
            return now
        return replace(now, tilt=before.tilt) if now.moving >= before.moving else before

    def _book(self, lifted: Weighed, left: Weighed, t_us: int, drift: DriftKnowledge) -> None:
        """Book the candidate. While the bucket returns, the booking becomes more precise: what remained in it and how
        friction and zeros have drifted is known better and better."""
        last = self.booking
        if last is None:
            number = 1
        elif self.candidate is not None:
            number = last.number + 1
        else:
            number, t_us = last.number, last.t_us
        mass, remains = lifted.corrected(drift), left.corrected(drift)
        error, sizes = self.constants.reported_error, None if self.probable is None else self.probable.expected
        self.booking = Booking(
            number=number,
            t_us=t_us,
            mass=mass,
            standard_error=error(lifted, drift, sizes),
            carry_back=remains,
            carry_back_error=error(left, drift, sizes),
            dumped=mass - remains,
            dumped_error=error(difference(lifted, left), drift, sizes),
        )
        self.candidate, self.dumped, self.remembered = None, lifted, False


def leaves(before: Weighed, now: Weighed, drift: DriftKnowledge) -> bool:
    """Return whether a smaller load is the rest of the one before, which is being dumped.

    The tool turned by more than REPOSE from where that one was weighed until this one hung, and is still turned. A
    wheel loader's bucket turns as far in the heap, while it curls; what is weighed there is weighed late, that one with
    the bucket curled."""
    if before.tilt is None or now.hung is None:
        return now.corrected(drift) < DUMPING * before.corrected(drift)
    return abs(now.hung - before.tilt) > REPOSE and not turned_and_back(before, now)


def turned_and_back(before: Weighed, now: Weighed) -> bool:
    """Return whether the tool had turned by more than REPOSE when this load began to hang, and has turned back.

    The load may be the next one, the dump of the one before not having been seen, or what a partial dump spared."""
    if before.tilt is None or now.hung is None or now.tilt is None:
        return False
    return abs(now.hung - before.tilt) > REPOSE >= abs(now.tilt - before.tilt)
