"""Test for another tool than the chosen one.

An empty machine with another tool seems to carry a load that never leaves it, or a negative load. A weight from which
the load rises may be that of an empty tool off zero. It is suspected at the first rise if no empty tool was detected
since the start, because the bucket may also have held a load. A second rise is that of a growing load, and ends the
suspicion. A tool that returns to the weight from which its load rose is off zero: loads differ, the tool does not. The
suspicion also ends when an empty tool is detected. While the tool is off zero, no empty bucket is detected and nothing
is booked."""

from dataclasses import dataclass

from cylforce.estimation.residual import EMPTY_BELOW, GOOD_ENOUGH
from cylforce.service.loading.lift import Weight
from cylforce.service.snapshot import Estimator
from cylforce.service.weighing import LoadEstimator


@dataclass(slots=True)
class ToolCheck(Estimator):
    """State of the check.

    mass:       last settled weight [kg]; None: none yet
    off:        weight of the empty tool, its deviation from zero [kg]; None: zero, or not known
    base:       lowest weight from which the load has risen since the tool was last empty [kg]; None: none
    seen_empty: whether the tool has been empty since the start
    confirmed:  whether the tool has returned to `base`, or had a weight that no load has
    """

    mass: float | None = None
    off: float | None = None
    base: float | None = None
    seen_empty: bool = False
    confirmed: bool = False

    def update(self, load: LoadEstimator, weight: Weight) -> None:
        """Update the check with the weight of a lift, once it has settled in motion."""
        lift, settled, rated = load.lift, load.constants.settled, load.constants.rated
        if lift.refused or lift.moving < settled or load.noise > GOOD_ENOUGH * rated:
            return
        limit = EMPTY_BELOW * rated
        certain = abs(weight.mass) > max(limit, 3.0 * weight.standard_error)
        plausible = load.is_plausible(weight)
        impossible = not plausible and (weight.mass < 0.0 or not certain)
        self.take(weight.mass, limit, empty=plausible and not certain, impossible=impossible)

    def take(self, mass: float, limit: float, *, empty: bool, impossible: bool) -> None:
        """Update the check with one settled weight.

        mass:       the weight [kg]
        limit:      difference from which on two weights differ [kg]
        empty:      whether it is the weight of an empty tool
        impossible: whether no load can have it: it is negative, or has moments without a mass
        """
        before = self.mass
        if empty:
            self.mass, self.off, self.base, self.seen_empty, self.confirmed = mass, None, None, True, False
        elif impossible:
            self.mass = self.off = self.base = mass
            self.confirmed = True
        elif before is None:
            self.mass = mass
        elif mass < before - limit:
            self.mass = mass
            self.confirmed = self.confirmed or (self.base is not None and abs(mass - self.base) <= limit)
        elif mass > before + limit:
            self._rise(before, limit)
            self.mass = mass

    def _rise(self, before: float, limit: float) -> None:
        """Update the suspicion after a rise of the load from the weight `before` [kg]."""
        if self.confirmed:
            self.off = self.base
        elif before <= limit:
            return
        elif self.base is None:
            self.off, self.base = None if self.seen_empty else before, before
        else:
            self.off, self.base = None, min(self.base, before)
