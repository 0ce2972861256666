"""Detector of an impossible weight of the empty bucket: negative, or with moments that no mass in the bucket has.

The torques determine a mass m and its first moments m x, m z about the last pin. Carry-back lies within a distance R
of that pin:

    |(m x, m z)| <= R m

Moments without such a mass are no load. A slipped angle of the bucket rotates the bucket's own weight, and causes such
moments. The distance of the estimate from the nearest possible mass, in its own standard errors, is the root of
chi-squared.

A negative weight may also be a drift, so the adaptation of friction and zeros continues. Until a return has determined
the drift, its error is that of oil at 0 degC. Moments that are less accurate than a weight must be, as in the first
second after a dump, are no evidence."""

from dataclasses import dataclass
from math import hypot, pi, sqrt
from typing import Self

import numpy as np

from cylforce.estimation.residual import EMPTY_BELOW, GOOD_ENOUGH
from cylforce.service.adaptation import DriftFilter
from cylforce.service.booking import LATER_S
from cylforce.service.loading.lift import Lift
from cylforce.service.plausibility.detector import Detector, Features, MonitoredMachine
from cylforce.service.plausibility.detectors.constant_error import HARMLESS
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorFault, SensorSuspicion
from cylforce.service.snapshot import Constants
from cylforce.service.weighing import COLD, FARTHEST
from cylforce.signals.estimate import Array, Quantity, Status

NEVER = -1  # in place of a sample's number
BELOW = 3.0  # standard errors beyond the limit of the possible, from which on a fault is suspected; healthy: 2.2
DIRECTIONS = np.linspace(0.0, 2.0 * pi, 360, endpoint=False)  # in which the nearest mass may lie


def distance(moments: Array, covariance: Array, reach: float) -> float:
    """Return the distance of moments from the nearest possible mass, in standard errors; 0 for a possible one.

    moments:    (3,) a mass [kg] and its first moments x, z [kg m]
    covariance: (3, 3) of `moments`
    reach:      R [m]

    Raises numpy.linalg.LinAlgError if the covariance is singular."""
    mass, x, z = moments.tolist()
    if hypot(x, z) <= reach * mass:
        return 0.0
    edges = np.stack([np.ones_like(DIRECTIONS), reach * np.cos(DIRECTIONS), reach * np.sin(DIRECTIONS)])
    known = np.linalg.inv(covariance)
    along = np.maximum(moments @ known @ edges, 0.0)
    nearest = moments @ known @ moments - (along**2 / (edges * (known @ edges)).sum(axis=0)).max()
    return float(np.sqrt(max(nearest, 0.0)))


class EmptyConstants(Constants):
    """Constants of the empty bucket of one machine.

    tares: covariance (P, P) of the tares
    rated: rated payload [kg]
    reach: R, farthest plausible centre of a load from the last pin [m]
    later: number of samples of a lift for which an impossible weight must last
    all:   numbers of all signals
    """

    def __init__(self, monitored: MonitoredMachine) -> None:
        """Compute the limits of a possible weight: rated payload [kg], reach of a load [m], duration of a fault.

        monitored: constants of the machine
        """
        machine, self.tares = monitored.model.machine, monitored.tares.covariance
        self.rated, self.reach = machine.rated_payload, FARTHEST * machine.payload_reach
        self.later = LATER_S * monitored.model.filters.rate_hz
        self.all = tuple(range(len(machine.signals)))


@dataclass(slots=True)
class EmptyBucket(Detector):
    """Weight of the empty bucket.

    constants:   of the machine
    fault:       found at the last detection of an empty bucket
    wrong_since: sample of this lift since which the weight is impossible; NEVER: it is possible
    report:      present suspicion: all signals, while there is a fault
    """

    constants: EmptyConstants
    fault: SensorFault = SensorFault.NONE
    wrong_since: int = NEVER
    report: SensorSuspicion = NOTHING_SUSPECTED

    @classmethod
    def start(cls, machine: MonitoredMachine) -> Self:
        """Return the state before any weight."""
        return cls(machine.constants(EmptyConstants))

    @property
    def unsure(self) -> bool:
        """Return whether the weight is impossible at present."""
        return self.wrong_since != NEVER

    def on_sample(self, features: Features) -> None:
        """Update the fault with the gross weight and lift of a sample, and suspect all signals while there is one."""
        now = features.now
        self.take(now.gross, now.lift, now.drift)
        if self.fault is SensorFault.NONE:
            self.report = NOTHING_SUSPECTED
        elif self.fault is not self.report.cause:
            self.report = SensorSuspicion(Level.SUSPECTED, self.fault, self.constants.all)

    def take(self, gross: Quantity, lift: Lift, drift: DriftFilter) -> None:
        """Update the fault with the gross weight of a lift, if that is the weight of an empty bucket.

        Such a weight is OK and at most EMPTY_BELOW rated payloads; any other one leaves the fault as it is. As for a
        booking, an impossible weight must last for LATER_S within one lift, because the samples before the end of a
        lift are no weight. A possible weight ends the fault at once.

        gross: weight less the operator's zero [kg]
        lift:  present lift, from which mass and first moments follow
        drift: adapted friction and zeros
        """
        c, taken = self.constants, lift.taken
        if gross.status is not Status.OK or gross.value > EMPTY_BELOW * c.rated:
            self.wrong_since = NEVER
            return
        fault = self._fault(gross, lift, drift)
        if fault is SensorFault.NONE:
            self.fault, self.wrong_since = fault, NEVER
        elif not 0 <= self.wrong_since <= taken:
            self.wrong_since = taken
        elif taken - self.wrong_since >= c.later:
            self.fault = fault

    def _fault(self, gross: Quantity, lift: Lift, drift: DriftFilter) -> SensorFault:
        """Return the fault of an empty bucket's weight or moments: NEGATIVE_WEIGHT, IMPOSSIBLE_MOMENTS or NONE.

        gross: weight less the operator's zero [kg]
        lift:  present lift, from which mass [kg] and first moments [kg m] follow
        drift: adapted friction and zeros; before a return has determined them, the oil may be cold

        The gross weight is that after the operator's zero; the moments' mass is the larger of both, before zero and
        after. A fault of the moments stays while they are less accurate than a weight must be. Moments of an error of
        HARMLESS rated payloads, where a load lies, are no fault."""
        c = self.constants
        colder, more = (1.0, 0.0) if drift.returned else (COLD**2, lift.error_by_drift(drift.covariance))
        margin = BELOW * hypot(gross.standard_error, sqrt(colder - 1.0) * more)
        if gross.value < -max(margin, HARMLESS * c.rated):
            return SensorFault.NEGATIVE_WEIGHT
        moments, covariance = lift.moments(c.tares, drift, colder)
        if float(np.trace(covariance[1:, 1:])) > (GOOD_ENOUGH * c.rated * c.reach) ** 2:
            return self.fault if self.fault is SensorFault.IMPOSSIBLE_MOMENTS else SensorFault.NONE
        moments[0] = max(moments[0], gross.value, 0.0) + HARMLESS * c.rated / FARTHEST
        return SensorFault.IMPOSSIBLE_MOMENTS if distance(moments, covariance, c.reach) > BELOW else SensorFault.NONE
