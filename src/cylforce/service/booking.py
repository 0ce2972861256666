"""Bookings from weights: the weight of a lift that is booked, the carry-back, and the dumped mass.

A lift and its return have nearly the same errors of tares, friction and zeros. The sensitivities of both weights to
these errors are kept, so that the difference of both weights is more accurate than either."""

from dataclasses import dataclass, replace
from enum import Enum, auto
from math import sqrt
from typing import Self

import numpy as np

from cylforce.estimation.model import Tares
from cylforce.estimation.residual import EMPTY_BELOW, GOOD_ENOUGH
from cylforce.service.adaptation import DriftKnowledge
from cylforce.service.loading.lift import Lift
from cylforce.service.snapshot import Constants, Estimator
from cylforce.signals.estimate import Array, Booking
from cylforce.signals.units import DEGREE

DUMPING = 0.7  # share of a grab's load below which it is being dumped; chosen: spills are smaller, dumps larger
REPOSE = 35.0 * DEGREE  # by which a bucket tilts to empty: angle of repose of loose soil and gravel, 30 to 40 deg
EMPTY_DETECTED = -1  # in place of the samples in motion: an empty bucket was detected since, but not accurately enough
AGREES = 3.0  # standard errors within which two weights of one lift are the same; chosen
REFILL_S = 3.0  # s without a measurement in which a bucket may have been emptied and filled again; chosen
# s for which a lift must continue after a weight that is booked: the time that ends a lift (weighing.PATIENCE_S)
LATER_S = 0.3


@dataclass(frozen=True, slots=True)
class Weighed:
    """Weight at an instant of a lift.

    mass:    without correction of the drift [kg]
    noise:   variance by the noise of the rows, which averages out within the lift [kg^2]
    gain:    (P,) kilograms by which the mass reads too large, per unit by which each tare was identified too small
    drifted: (D,) kilograms by which the mass, not corrected, reads too large, per unit of each drift
    moving:  number of samples in motion on which the weight is based; of a candidate for booking also 0 (its load has
             changed since) or EMPTY_DETECTED
    tilt:    angle of the tool to the house at this weight, of a candidate at the first weight of its load [rad]; None
             where the tool empties without tilting
    slopes:  (H,) kilograms by which the mass reads too large, per unit of an undetected error of each signal: of
             cylinder forces [bar over the head area] and joint angles [rad]; None: not known
    hung:    angle of the tool to the house at the start of this load [rad]; None: not known, or no tilting
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
        """Return the mass [kg] corrected by the present estimate of the drift."""
        return self.mass - float(self.drifted @ drift.values)


def weighed(lift: Lift, parameters: int, tilt: float | None, slopes: Array | None) -> Weighed:
    """Return the present weight of a lift [kg] with its sensitivities to tares, drift and errors of signals.

    lift:       recursive estimate of the load
    parameters: P, number of tares
    tilt:       present angle of the tool to the house [rad]; None where the tool empties without tilting
    slopes:     (H,) change of the mass [kg] per unit of an undetected error of each signal (`Weighed`); None: not known
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
    """Errors of H signals that explain the torques best: of cylinder forces [bar over the head area] and angles [rad].

    sizes:   (H,) sizes of the errors
    certain: (H,) square root of an error's square less its variance: its part beyond noise; 0: no more than noise
    off:     probability that any signal has an error
    """

    sizes: Array
    certain: Array
    off: float = 1.0

    @property
    def expected(self) -> Array:
        """Root mean square (H,) of each error: its size with the probability `off`, else 0. It has the error's sign."""
        return np.asarray(sqrt(self.off) * self.sizes)

    @property
    def expected_certain(self) -> Array:
        """Root mean square (H,) of the certain part of each error."""
        return np.asarray(sqrt(self.off) * self.certain)


class MissedReason(Enum):
    """Reason why a load that was lifted will not be booked.

    INTERRUPTED:      the measurement was interrupted, and the bucket may have been emptied and filled meanwhile
    EMPTY_INACCURATE: before the next load the empty bucket was not weighed accurately enough, or a sensor was suspected
    DUMP_NOT_WEIGHED: the bucket turned as for a dump and back, and was not weighed while it was empty
    """

    INTERRUPTED = auto()
    EMPTY_INACCURATE = auto()
    DUMP_NOT_WEIGHED = auto()


@dataclass(frozen=True, slots=True)
class Missed:
    """Loads that were lifted and will not be booked.

    number: of these loads so far
    mass:   of the last one [kg]
    reason: why the last one is not booked; None: there is none
    """

    number: int
    mass: float
    reason: MissedReason | None


NONE_MISSED = Missed(number=0, mass=0.0, reason=None)


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
        """Sum of all parts [kg^2]."""
        return self.noise + self.tares + self.drift + self.scale + self.undetected


class BookingConstants(Constants):
    """Constants of the booking of one machine.

    tares:      identified parameters of the empty machine, with the error of the scale that decides about bookings
    rated:      rated payload [kg]
    parameters: P, number of tares
    every:      number of samples of a lift between two weights for bookings
    reported:   tares with the reported error of the scale
    """

    def __init__(self, tares: Tares, rated: float, rate_hz: float) -> None:
        """Compute the constants; `rated`: payload [kg], `rate_hz`: samples a second."""
        self.tares, self.rated, self.parameters = tares, rated, len(tares.values)
        self.every = round(LATER_S * rate_hz)
        self.reported = tares._replace(scale_error=tares.reported_scale_error)

    def variances(self, weight: Weighed, drift: DriftKnowledge, tares: Tares, sizes: Array | None = None) -> Variances:
        """Return the parts of the variance [kg^2] of the mass of a weight, corrected by the drift.

        weight: weight at an instant of a lift, with its sensitivities
        drift:  drift of friction and zeros, with its covariance
        tares:  identified parameters of the empty machine, with the relative error of the scale that counts
        sizes:  (H,) root mean square errors of the H signals (`ProbableErrors`), independent; None: not known
        """
        slopes = weight.slopes
        return Variances(
            noise=weight.noise,
            tares=float(weight.gain @ tares.covariance @ weight.gain),
            drift=float(weight.drifted @ drift.covariance @ weight.drifted),
            scale=(weight.corrected(drift) * tares.scale_error) ** 2,
            undetected=0.0 if slopes is None or sizes is None else float(((slopes * sizes) ** 2).sum()),
        )

    def error(self, weight: Weighed, drift: DriftKnowledge) -> float:
        """Return the standard error [kg] of the corrected mass by noise, tares, drift and scale, for booking decisions.

        It contains neither undetected errors of signals nor the error of the common scale of all pressures."""
        return sqrt(self.variances(weight, drift, self.tares).total)

    def reported_error(self, weight: Weighed, drift: DriftKnowledge, sizes: Array | None) -> float:
        """Return the reported standard error [kg] of the mass of a weight, corrected by the drift.

        It contains the errors of noise, identified parameters (tares), drift and scale, that of the common scale of all
        pressures, and undetected errors of signals.

        weight: at an instant of a lift, with its sensitivities
        drift:  of friction and zeros, with its covariance
        sizes:  (H,) root mean square errors of the H signals (`ProbableErrors.expected`); None: not known
        """
        return sqrt(self.variances(weight, drift, self.reported, sizes).total)


def difference(lifted: Weighed, empty: Weighed) -> Weighed:
    """Return the dumped weight: the mass [kg] of the load less that of the carry-back.

    Errors of the tares, of the drift and of the signals that both weights have in common cancel in its sensitivities.

    lifted: weight of the load
    empty:  weight of the carry-back
    """
    both = None if lifted.slopes is None or empty.slopes is None else lifted.slopes - empty.slopes
    return Weighed(
        mass=lifted.mass - empty.mass,
        noise=lifted.noise + empty.noise,
        gain=lifted.gain - empty.gain,
        drifted=lifted.drifted - empty.drifted,
        moving=0,
        slopes=both,
    )


@dataclass(slots=True)
class Bookings(Estimator):
    """State of the booking.

    constants:   of the machine
    newest:      newest weight of the present lift; None: none yet
    candidate:   weight of a loaded bucket that is booked at the next detection of an empty bucket; None: none
    dumped:      loaded weight that was booked last, while the bucket returns; else None
    booking:     the last booking; None: none yet
    missed:      loads that are not booked
    measured_us: time of the last measurement [us]; None: none yet
    remembered:  whether the candidate is from before an interruption, so that its load may have left the bucket
    withheld:    whether bookings wait, because the monitor has weak evidence of a sensor fault, or a suspicion that
                 the next motion in the air decides
    probable:    errors of the signals [bar over the head area, rad]; None: not known
    unconfirmed: whether the parameters may be another machine's
    """

    constants: BookingConstants
    newest: Weighed | None = None
    candidate: Weighed | None = None
    dumped: Weighed | None = None
    booking: Booking | None = None
    missed: Missed = NONE_MISSED
    measured_us: int | None = None
    remembered: bool = False
    withheld: bool = False
    probable: ProbableErrors | None = None
    unconfirmed: bool = False

    @classmethod
    def start(cls, constants: BookingConstants) -> Self:
        """Return the state before any weight."""
        return cls(constants)

    def note_measurement(self, t_us: int) -> None:
        """Update the time of the last measurement to `t_us` [us].

        After a pause of more than REFILL_S seconds, or a step back of the time, the load that waits for booking is
        discarded and reported as missed, because the bucket may have been emptied and filled again."""
        if self.measured_us is not None and not 0 <= t_us - self.measured_us <= 1e6 * REFILL_S:
            self.discard_candidate()
        self.measured_us = t_us

    def end_lift(self) -> None:
        """Discard the newest weight of a lift that has ended, and no longer refine the last booking.

        The candidate, the weight that waits for booking, stays."""
        self.newest = self.dumped = None

    def change_load(self) -> None:
        """Handle a change of the load in the air, as by a spill: the next weight is to be booked instead.

        For that the number of samples in motion of the candidate, the weight that waits for booking, becomes 0."""
        self.end_lift()
        if self.candidate is not None:
            self.candidate = replace(self.candidate, moving=0)

    def discard_candidate(self) -> None:
        """Discard the candidate, the weight that waits for booking, and report it as missed (INTERRUPTED).

        The bucket may have been emptied and filled again unobserved. The newest weight of the lift is discarded, too,
        and the last booking is no longer refined."""
        if self.candidate is not None:
            self._miss(self.candidate.mass, MissedReason.INTERRUPTED)
        self.newest = self.candidate = self.dumped = None
        self.remembered = False

    def _miss(self, mass: float, reason: MissedReason) -> None:
        """Count a load of this `mass` [kg] that will not be booked, with the reason."""
        self.missed = Missed(self.missed.number + 1, mass, reason)

    def update(self, weight: Weighed, t_us: int, drift: DriftKnowledge) -> None:
        """Update the bookings with the present weight of a lift that has continued.

        The weight before this one is now confirmed, because the lift has continued; it is not used if its noise is too
        large. If it is that of a load it becomes the candidate for booking, or confirms the one so far (`_better`). If
        it is that of an empty bucket the candidate is booked, or the last booking is refined, if the weights are
        accurate enough, the load has left the bucket and bookings are not withheld. A candidate whose weights are not
        accurate enough, or that is withheld, is marked as EMPTY_DETECTED.

        weight: present weight of the lift
        t_us:   time [us]
        drift:  of friction and zeros, by which the masses are corrected
        """
        settled, self.newest, rated = self.newest, weight, self.constants.rated
        if settled is None or settled.noise > (GOOD_ENOUGH * rated) ** 2:
            return
        if settled.corrected(drift) >= EMPTY_BELOW * rated:
            better = self._better(settled, drift)
            self._report_missed(settled, drift)
            self.candidate, self.dumped, self.remembered = better, None, False
            return
        lifted = self.candidate or self.dumped
        if lifted is None or self.withheld or not self._is_known(lifted, settled, drift):
            if self.candidate is not None:
                self.candidate = replace(self.candidate, moving=EMPTY_DETECTED)
        elif self._has_left(lifted, settled, drift):
            self._book(lifted, settled, t_us, drift)

    def _has_left(self, lifted: Weighed, empty: Weighed, drift: DriftKnowledge) -> bool:
        """Return whether the load has left the bucket: the dumped mass exceeds AGREES of its standard errors.

        A mass near EMPTY_BELOW may first read as a load and then as an empty bucket, although nothing has left it.

        lifted: weight of the load
        empty:  weight of the empty bucket with its carry-back
        drift:  by which both weights are corrected
        """
        by = lifted.corrected(drift) - empty.corrected(drift)
        return by > AGREES * self.constants.error(difference(lifted, empty), drift)

    def _is_known(self, lifted: Weighed, empty: Weighed, drift: DriftKnowledge) -> bool:
        """Return whether the weights are accurate enough for a booking: to GOOD_ENOUGH rated payloads.

        lifted: weight of the load
        empty:  weight of the empty bucket with its carry-back
        drift:  by which both weights are corrected

        The lifted weight must be as accurate, also if any one signal has the certain part of its error. So must be
        either the weight of the empty bucket or the difference of both, the dumped weight.

        The error of the scale counts as far as the data sheet of cylinders, pins and sensors bounds it. The part that
        only the masses bound is the same in every lift, so that no later lift is more accurate. It is in the booked
        standard error, but withholds no booking."""
        error, enough = self.constants.error, GOOD_ENOUGH * self.constants.rated
        if error(lifted, drift) > enough or self._certain_error(lifted.slopes) > enough:
            return False
        return min(error(empty, drift), error(difference(lifted, empty), drift)) <= enough

    def _certain_error(self, slopes: Array | None) -> float:
        """Return the largest error [kg] of a weight by the certain part of one signal's error; 0 if nothing is known.

        The certain part of a probable error is what exceeds its own noise (`ProbableErrors.expected_certain`, (H,), in
        the units of the signals). The errors of the H signals explain the same torques, so that one of them counts and
        not their sum.

        slopes: (H,) change of the mass [kg] per unit of each signal's error; None: not known
        """
        if slopes is None or self.probable is None:
            return 0.0
        return float(np.abs(slopes * self.probable.expected_certain).max(initial=0.0))

    def _report_missed(self, now: Weighed, drift: DriftKnowledge) -> None:
        """Report the candidate, the last weight that waits for booking, as missed if `now` is that of another load.

        It may be that of another load if an empty bucket was detected between them, but not accurately enough
        (`moving` is EMPTY_DETECTED); if the bucket has turned as for an unobserved dump and back, and the weight is
        smaller; or if the measurement was interrupted (`remembered`). It is the same load if both weights agree, or if
        after an interruption it is the remainder of a load that is being dumped.

        now:   weight of a loaded bucket
        drift: by which both weights are corrected
        """
        before = self.candidate
        if before is None:
            return
        by = now.corrected(drift) - before.corrected(drift)
        smaller = by < 0.0
        if self.remembered:
            reason = MissedReason.INTERRUPTED
        elif before.moving == EMPTY_DETECTED:
            reason = MissedReason.EMPTY_INACCURATE
        elif smaller and turned_and_back(before, now):
            reason = MissedReason.DUMP_NOT_WEIGHED
        else:
            return
        same = abs(by) <= AGREES * self.constants.error(difference(now, before), drift)
        if same or (self.remembered and smaller and is_remainder(before, now, drift)):
            return
        self._miss(before.corrected(drift), reason)

    def _better(self, now: Weighed, drift: DriftKnowledge) -> Weighed:
        """Return the weight to be booked: the candidate so far, or `now`.

        Any weight replaces a candidate after which an empty bucket was detected (`moving` is EMPTY_DETECTED).

        Of two weights of the same load it is that of more samples in motion; the tilt remains that of the first one. A
        smaller load that is being dumped does not replace the candidate. Any other load that differs by more than
        AGREES standard errors does: the bucket has gained or lost a part of its load, or it is another load.

        now:   weight of a loaded bucket
        drift: by which both weights are corrected
        """
        before = self.candidate
        if before is None or before.moving == EMPTY_DETECTED:
            return now
        by = now.corrected(drift) - before.corrected(drift)
        differs = abs(by) > AGREES * self.constants.error(difference(now, before), drift)
        if by < 0.0 and differs and is_remainder(before, now, drift):
            return before
        if differs:
            return now
        return replace(now, tilt=before.tilt) if now.moving >= before.moving else before

    def _book(self, lifted: Weighed, empty: Weighed, t_us: int, drift: DriftKnowledge) -> None:
        """Book the weight of a load, or refine its booking while the bucket returns.

        The estimates of the carry-back and of the drift of friction and zeros improve during the return.

        lifted: weight of the load
        empty:  weight of the empty bucket with its carry-back
        t_us:   time [us]; a refined booking keeps its own
        drift:  by which both weights are corrected
        """
        last = self.booking
        if last is None:
            number = 1
        elif self.candidate is not None:
            number = last.number + 1
        else:
            number, t_us = last.number, last.t_us
        mass, remains = lifted.corrected(drift), empty.corrected(drift)
        error, sizes = self.constants.reported_error, None if self.probable is None else self.probable.expected
        self.booking = Booking(
            number=number,
            t_us=t_us,
            mass=mass,
            standard_error=error(lifted, drift, sizes),
            carry_back=remains,
            carry_back_error=error(empty, drift, sizes),
            dumped=mass - remains,
            dumped_error=error(difference(lifted, empty), drift, sizes),
        )
        self.candidate, self.dumped, self.remembered = None, lifted, False


def is_remainder(before: Weighed, now: Weighed, drift: DriftKnowledge) -> bool:
    """Return whether a smaller load `now` is the remainder of the load `before`, which is being dumped.

    drift: of friction and zeros, by which both masses are corrected

    The tool has turned by more than REPOSE from the weight `before` to the start of the load `now`, and has not turned
    back. A wheel loader's bucket turns as far in the heap, while it curls; but its loads are weighed after that, with
    the bucket curled. A tool that empties without tilting is being dumped below DUMPING of the load before.

    The fields of a weight are angles of the tool to the house [rad]: `hung` at the start of the load, `tilt` at the
    weight."""
    if before.tilt is None or now.hung is None:
        return now.corrected(drift) < DUMPING * before.corrected(drift)
    return abs(now.hung - before.tilt) > REPOSE and not turned_and_back(before, now)


def turned_and_back(before: Weighed, now: Weighed) -> bool:
    """Return whether the tool had turned by more than REPOSE at the start of the load `now`, and has turned back.

    This load may be the next one after an unobserved dump, or the remainder of a partial dump. It is False for a tool
    that empties without tilting.

    The fields of a weight are angles of the tool to the house [rad]: `hung` at the start of the load, `tilt` at the
    weight."""
    if before.tilt is None or now.hung is None or now.tilt is None:
        return False
    return abs(now.hung - before.tilt) > REPOSE >= abs(now.tilt - before.tilt)
