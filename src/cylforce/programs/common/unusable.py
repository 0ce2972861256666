"""Sentences on samples of a log that are not usable."""

from collections import Counter

from cylforce.display.words import REASONS
from cylforce.signals.estimate import Reason

CURES = {
    Reason.TWO_PRODUCERS: (
        "; or the logger stored each frame twice: give every node a number of its own, and record one interface "
        "without its echo and without a bridge to another"
    ),
}


def unusable_samples(unusable: Counter[Reason], rows: int, rate_hz: float) -> str:
    """Return how many seconds of a recording have no sample, and the reason of most of them with its cure.

    unusable: numbers of ticks without a sample, by their reason
    rows:     number of all ticks; at least one of them is unusable
    """
    reason, _ = unusable.most_common(1)[0]
    return (
        f"{unusable.total() / rate_hz:.1f} of {rows / rate_hz:.1f} s are not usable, mostly {reason.name}: "
        f"{REASONS[reason]}{CURES.get(reason, '')}"
    )
