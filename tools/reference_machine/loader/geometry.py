"""Where a loader's arm is: angles <-> lengths, teeth, clearance, postures. For planning."""

from functools import cached_property
from math import radians, sin

import numpy as np
from numpy.typing import NDArray

from reference_machine.linkage import inverse

from .sheet import JOINTS
from .specimen import Specimen
from .zbar import Lift, Zbar, tip

Array = NDArray[np.float64]
HEEL = 0.35  # m: the bucket's bottom lies so far below its pin when it is curled
MARGIN = 0.04  # of the stroke that stays unused at either end


class Geometry:
    """Angles (arm, bucket) and lengths (lift, tilt) of a specimen."""

    def __init__(self, specimen: Specimen) -> None:
        self.specimen = specimen
        self.lift, self.zbar = Lift(specimen), Zbar(specimen)
        low, high = specimen.sheet.links[JOINTS[0]].range_deg
        self._arm = radians(low), radians(high)
        self._attitude = tuple(map(radians, specimen.sheet.attitude_deg))

    @cached_property
    def working(self) -> Array:
        """Lengths (2, 2) that are used."""
        found = [c.lengths for c in self.specimen.cylinders.values()]
        return np.array([(a + MARGIN * (b - a), b - MARGIN * (b - a)) for a, b in found])

    def lengths(self, arm: float, attitude: float) -> Array:
        """Lengths (2,) with the arm at an angle and the bucket's line at `attitude` [rad], within what is used."""
        found = np.array([self.lift.span(arm)[0], abs(self.zbar.closed(arm, attitude - arm).line)])
        return np.asarray(np.clip(found, *self.working.T))

    def angles(self, lengths: Array) -> tuple[float, float]:
        """Angles (arm, bucket). Raises ValueError where the bucket would turn beyond its attitudes."""
        arm = inverse(self.lift, float(lengths[0]), *self._arm)
        low, high = self._attitude
        return arm, self.zbar.bucket_angle(arm, float(lengths[1]), low - arm, high - arm)

    def clearance(self, path: Array) -> float:
        """Least height of teeth and bucket pin above the ground along a path (T, 2); -1 where it cannot be."""
        least = np.inf
        for row in path:
            try:
                arm, bucket = self.angles(row)
            except ValueError:
                return -1.0
            pin = self.specimen.lengths["arm"] * sin(arm) - HEEL
            least = min(least, pin, tip(self.specimen, arm, bucket)[1])
        return float(least) + self.specimen.sheet.pin_height
