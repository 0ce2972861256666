"""What tares and drift leave of the torques of one instant, as the kernel keeps it."""

from array import array
from typing import NamedTuple

import numpy as np

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.estimation.residual import Residual


class Unexplained(NamedTuple):
    """One instant of R measured joints: its `rows`, of which the first are columns (R, K), then torques (R,); what is
    left of them, `kept`: torque (R,) [N m], its variance without friction at rest, that of friction at rest
    [N^2 m^2], the columns (R, D) of the drift (`weighed.explain`); `wider` (R,): what the variance is wider by, for
    those who ask for it [N^2 m^2]."""

    rows: Numbers
    kept: Numbers
    wider: Numbers

    @property
    def torque(self) -> Numbers:
        """The torque (R,) [N m]."""
        return self.kept[: len(self.wider)]

    @property
    def variance(self) -> Numbers:
        """Its variance (R,) [N^2 m^2]."""
        size = len(self.wider)
        return self.kept[size : 2 * size]

    @property
    def rest(self) -> Numbers:
        """The variance of friction at rest (R,) [N^2 m^2]."""
        size = len(self.wider)
        return self.kept[2 * size : 3 * size]


def unexplained(left: Residual, columns: int, drifts: int) -> Unexplained:
    """The same of arrays, the columns filled up with zeros to so many; friction and zeros do not drift."""
    rows, own = np.zeros((len(left.torque), columns)), left.columns.shape[1]
    rows[:, :own] = left.columns
    kept = np.concatenate([left.torque, left.variance, left.rest, np.zeros(len(rows) * drifts)])
    return Unexplained(array("d", rows.tobytes()), array("d", kept.tobytes()), ZERO * len(rows))
