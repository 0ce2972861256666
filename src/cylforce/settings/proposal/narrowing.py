"""Angle ranges of a proposed machine, narrowed until its cylinders can cover them."""

from collections.abc import Callable, Iterator

from cylforce.settings.proposal.types import Range

STEPS = 9  # by which a range is narrowed at most: to 70 % of it; chosen
STEP = 1.0 / 30.0  # of the range; chosen


def narrowed(wanted: Range) -> Iterator[Range]:
    """Narrower ranges [deg] within `wanted`, the widest first; of equally wide ones those first whose middle is nearest
    to that of `wanted`."""
    low, high = wanted
    step = STEP * (high - low)
    for count in range(1, STEPS + 1):
        for below in sorted(range(count + 1), key=lambda part: abs(2 * part - count)):
            yield round(low + below * step, 1), round(high - (count - below) * step, 1)


def widest(wanted: Range, fit: Callable[[Range], None]) -> Range | None:
    """The first of `narrowed(wanted)` for which `fit` raises no ValueError; None where it raises one for each."""
    for found in narrowed(wanted):
        try:
            fit(found)
        except ValueError:
            continue
        return found
    return None
