"""Working cycle since the last booking: its length, its time in contact, and its largest soil force."""

from dataclasses import dataclass

from cylforce.service.snapshot import Estimator
from cylforce.signals.estimate import Estimate, Reason, Status


@dataclass(frozen=True, slots=True)
class LastBucket:
    """Figures of a booked bucket besides its weight.

    cycle:   length of its working cycle [s]
    contact: time in contact [s]
    peak:    largest soil force [N]
    """

    cycle: float
    contact: float
    peak: float


@dataclass(slots=True)
class Cycle(Estimator):
    """Working cycle.

    begun_us:    time at which it began [us]; 0: it has not
    contact_us:  time in contact [us]
    peak:        largest soil force [N]
    measured_us: time of the last estimate [us]
    """

    begun_us: int = 0
    contact_us: int = 0
    peak: float = 0.0
    measured_us: int = 0

    def update(self, estimate: Estimate) -> None:
        """Update the working cycle with one estimate: its time in contact, and its largest soil force [N].

        The tool is in contact while the soil force has a value without the reason NO_CONTACT."""
        t_us, force = estimate.t_us, estimate.soil.magnitude
        self.begun_us = self.begun_us or t_us
        if force.status is not Status.INVALID and force.reason is not Reason.NO_CONTACT:
            self.contact_us += t_us - (self.measured_us or t_us)
            self.peak = max(self.peak, force.value)
        self.measured_us = t_us

    @property
    def figures(self) -> LastBucket:
        """Figures of the cycle up to the last estimate."""
        return LastBucket(1e-6 * (self.measured_us - self.begun_us), 1e-6 * self.contact_us, self.peak)
