"""Shifts of booked buckets, written to the records."""

from cylforce.records.recorder import Recorder
from cylforce.records.writing import BookedBucket, Change, Start
from cylforce.service.loading.cycle import LastBucket
from cylforce.service.loading.truck import add_bucket
from cylforce.service.memory import Memory
from cylforce.signals.estimate import Booking

START = Start(1_700_000_000_000_000, "0.1.0", "Excavator")
CYCLE = LastBucket(18.5, 6.2, 84_000.0)


def booked(kept, mass, t_us=0):
    """What the service hands over for one more bucket."""
    number = kept.booking.number + 1 if kept.booking else 1
    booking = Booking(number, START.t_us + t_us, mass + 12.0, 4.0, 12.0, 2.0, mass, 5.0)
    after = Memory(kept.scale, add_bucket(kept.truck, booking, kept.scale.tare), booking, kept.tool)
    return Change(booking.t_us, after, BookedBucket(booking, CYCLE, 1.5, "OK"), "")


def shift(path, count, kept=None):
    """A start of the service with `count` buckets of 100, 101, ... kg."""
    recorder = Recorder(path, START)
    kept = recorder.kept if kept is None else kept
    for k in range(count):
        change = booked(kept, 100.0 + k, k)
        recorder.put(change)
        kept = change.kept
    recorder.close()
    return kept
