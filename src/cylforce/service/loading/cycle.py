"""What happened since the last booking: for how long, how much of it in contact with the ground, and the largest force
of the soil."""

from dataclasses import dataclass

from cylforce.service.snapshot import Estimator
from cylforce.signals.estimate import Estimate, Reason, Status


@dataclass(frozen=True, slots=True)
class LastBucket:
    """Figures of a booked bucket besides its weight.

    cycle:   length of its cycle [s]
    contact: time in contact [s]
    peak:    largest soil force [N]
    """

    cycle: float
    contact: float
    peak: float


@dataclass(slots=True)
class Cycle(Estimator):
    """A working cycle.

    begun_us:   when it began [us]; 0: not yet
    contact_us: how long the tool was in contact [us]
    peak:       largest soil force [N]
    seen_us:    time of the last estimate [us]
    """

    begun_us: int = 0
    contact_us: int = 0
    peak: float = 0.0
    seen_us: int = 0

    def update(self, estimate: Estimate) -> None:
        """Take one more estimate."""
        t_us, force = estimate.t_us, estimate.soil.magnitude
        self.begun_us = self.begun_us or t_us
        if force.status is not Status.INVALID and force.reason is not Reason.NO_CONTACT:
            self.contact_us += t_us - (self.seen_us or t_us)
            self.peak = max(self.peak, force.value)
        self.seen_us = t_us

    @property
    def figures(self) -> LastBucket:
        """The figures of the cycle, when a booking has ended it."""
        return LastBucket(1e-6 * (self.seen_us - self.begun_us), 1e-6 * self.contact_us, self.peak)
