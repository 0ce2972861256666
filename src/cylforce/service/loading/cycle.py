"""What happened since the last booking: for how long, how much of it in contact with the ground, and the largest force
of the soil."""

from typing import NamedTuple

from cylforce.signals.estimate import Estimate, Reason, Status
from cylforce.signals.quick import new


class Cycle(NamedTuple):
    """A working cycle: when it began [us] (0: not yet), how long the tool was in contact [us], the largest soil force
    [N]; time of the last estimate [us]."""

    begun_us: int = 0
    contact_us: int = 0
    peak: float = 0.0
    seen_us: int = 0


class LastBucket(NamedTuple):
    """What is known of a booked bucket besides its weight: length of its cycle [s], time in contact [s], largest soil
    force [N]."""

    cycle: float
    contact: float
    peak: float


NO_CYCLE = Cycle()


def advanced(cycle: Cycle, estimate: Estimate) -> Cycle:
    """The cycle after one more estimate."""
    begun = cycle.begun_us or estimate.t_us
    force = estimate.soil.magnitude
    if force.status is Status.INVALID or force.reason is Reason.NO_CONTACT:
        return new(Cycle, (begun, cycle.contact_us, cycle.peak, estimate.t_us))
    contact = cycle.contact_us + (estimate.t_us - (cycle.seen_us or estimate.t_us))
    return new(Cycle, (begun, contact, max(cycle.peak, force.value), estimate.t_us))


def ended(cycle: Cycle) -> LastBucket:
    """The figures of a cycle that a booking has ended."""
    return LastBucket(1e-6 * (cycle.seen_us - cycle.begun_us), 1e-6 * cycle.contact_us, cycle.peak)
