"""Is this the tool that was chosen? An empty machine with another tool seems to carry a load that never leaves it, or
one lighter than nothing.

A weight from which the load rises may be that of an empty tool off zero. It is suspected at the first rise when the
tool has not been seen empty since the start: the bucket may also have held a load. A second rise is that of a load
that grows, so that the suspicion ends. A tool that returns to the weight from which its load rose is off zero: loads
differ, the tool does not. The check clears itself when the tool is seen empty. While it is off zero, nothing is booked,
for the bucket is never seen empty."""

from dataclasses import dataclass

from cylforce.estimation.residual import GOOD_ENOUGH, SMALLEST
from cylforce.service.loading.lift import Weight
from cylforce.service.snapshot import Estimator
from cylforce.service.weighing import LoadEstimator


@dataclass(slots=True)
class ToolCheck(Estimator):
    """State of the check.

    mass:       last settled weight [kg]; None: none yet
    off:        by how much the empty tool is off zero [kg]; None: it is not, or not known
    base:       lowest weight from which the load has risen since the tool was seen empty [kg]; None: none
    seen_empty: whether the tool has been seen empty since the start
    confirmed:  whether the tool has returned to `base`, or had a weight that no load has
    """

    mass: float | None = None
    off: float | None = None
    base: float | None = None
    seen_empty: bool = False
    confirmed: bool = False

    def update(self, load: LoadEstimator, weight: Weight) -> None:
        """Check the weight of a lift that goes on in motion."""
        lift, settled, rated = load.lift, load.constants.settled, load.constants.rated
        if lift.refused or lift.moving < settled or load.noise > GOOD_ENOUGH * rated:
            return
        limit = SMALLEST * rated
        certain = abs(weight.mass) > max(limit, 3.0 * weight.standard_error)
        plausible = load.is_plausible(weight)
        impossible = not plausible and (weight.mass < 0.0 or not certain)
        self.take(weight.mass, limit, empty=plausible and not certain, impossible=impossible)

    def take(self, mass: float, limit: float, *, empty: bool, impossible: bool) -> None:
        """Take one more settled weight.

        mass:       the weight [kg]
        limit:      difference from which on two weights differ [kg]
        empty:      whether it is that of an empty tool
        impossible: whether no load can have it: lighter than nothing, or moments without a mass
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
        """Conclude from a load that has risen from the weight `before` [kg]."""
        if self.confirmed:
            self.off = self.base
        elif before <= limit:
            return
        elif self.base is None:
            self.off, self.base = None if self.seen_empty else before, before
        else:
            self.off, self.base = None, min(self.base, before)
