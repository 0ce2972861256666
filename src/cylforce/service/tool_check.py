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

    mass:         last settled weight [kg]; None: none yet
    empty_weight: suspected weight of the empty tool, which would be zero for the chosen tool [kg]; None: no suspicion
    lowest_start: lowest weight from which the load has risen since the tool was last empty [kg]; None: none
    seen_empty:   whether the tool has been empty since the start
    confirmed:    whether the tool has returned to `lowest_start`, or had a weight that no load has
    """

    mass: float | None = None
    empty_weight: float | None = None
    lowest_start: float | None = None
    seen_empty: bool = False
    confirmed: bool = False

    def update(self, load: LoadEstimator, weight: Weight) -> None:
        """Update the test for another tool with the weight of a lift, once that has settled in motion and is accurate.

        The weight is that of an empty tool if it is plausible and differs from zero by at most EMPTY_BELOW rated
        payloads or three standard errors. It is impossible if it is not plausible, and negative or no more than that.

        load:   estimator of the load, whose present lift says how long and how accurately the weight is known
        weight: mass [kg] of the lift with its standard error
        """
        lift, settled, rated = load.lift, load.constants.settled_samples, load.constants.rated
        if lift.refused or lift.moving < settled or load.noise > GOOD_ENOUGH * rated:
            return
        limit = EMPTY_BELOW * rated
        certain = abs(weight.mass) > max(limit, 3.0 * weight.standard_error)
        plausible = load.is_plausible(weight)
        impossible = not plausible and (weight.mass < 0.0 or not certain)
        self.take(weight.mass, limit, empty=plausible and not certain, impossible=impossible)

    def take(self, mass: float, limit: float, *, empty: bool, impossible: bool) -> None:
        """Update the test for another tool with one settled weight.

        An empty tool ends the suspicion. A weight that no load can have confirms it. A weight from which the load rises
        may be that of another, empty tool; a fall back to that weight confirms that. Any other weight that
        differs from the last one by no more than the limit changes nothing.

        mass:       the weight [kg]
        limit:      difference from which on two weights differ [kg]
        empty:      whether it is the weight of an empty tool
        impossible: whether no load can have it: it is negative, or has moments without a mass
        """
        before = self.mass
        if empty:
            self.mass, self.empty_weight, self.lowest_start = mass, None, None
            self.seen_empty, self.confirmed = True, False
        elif impossible:
            self.mass = self.empty_weight = self.lowest_start = mass
            self.confirmed = True
        elif before is None:
            self.mass = mass
        elif mass < before - limit:
            self.mass = mass
            self.confirmed = self.confirmed or (
                self.lowest_start is not None and abs(mass - self.lowest_start) <= limit
            )
        elif mass > before + limit:
            self._rise(before, limit)
            self.mass = mass

    def _rise(self, before: float, limit: float) -> None:
        """Update the suspicion of another tool after a rise of the load.

        The weight before a rise is that of an empty tool, or of a partial load that grows. If it was not that of the
        chosen tool, it is suspected to be that of another empty tool, unless an empty tool has been detected since the
        start: the bucket then held a load. A second rise, before the tool was empty, is that of a growing load, so that
        the suspicion ends. Once the tool has returned to the same weight (`confirmed`), the suspicion is certain: loads
        differ, an empty tool does not.

        before: weight from which the load rose [kg]
        limit:  weight up to which the chosen tool counts as empty [kg]
        """
        if self.confirmed:
            self.empty_weight = self.lowest_start
        elif before <= limit:
            return
        elif self.lowest_start is None:
            self.lowest_start = before
            self.empty_weight = None if self.seen_empty else before
        else:
            self.lowest_start = min(self.lowest_start, before)
            self.empty_weight = None
