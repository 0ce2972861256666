"""The residual torque of one instant: what tares and drift do not explain of the measured torques."""

from array import array
from dataclasses import dataclass

import numpy as np

from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.layout import ResidualLayout
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solver import KernelSolver
from cylforce.estimation.kernel.solving import ZERO
from cylforce.estimation.residual import Residual
from cylforce.signals.estimate import Array


@dataclass(slots=True)
class InstantResidual:
    """Residual torque of the R measured joints at one instant, with its variance.

    rows:    columns (R, K), then torques (R,), then others, as the kernel keeps the rows of a step
    numbers: residual torque (R,) [N m], its variance without friction at rest (R,), variance of friction at rest (R,)
             [N^2 m^2], columns (R, D) of the drift (`weighed.explain`)
    wider:   (R,) by which the variance is larger while the base rocks [N^2 m^2]
    """

    rows: Numbers
    numbers: Numbers
    wider: Numbers

    @property
    def torque(self) -> Numbers:
        """The residual torque (R,) [N m]."""
        return self.numbers[ResidualLayout(len(self.wider)).torque]

    @property
    def variance(self) -> Numbers:
        """Its variance (R,) without friction at rest [N^2 m^2]."""
        return self.numbers[ResidualLayout(len(self.wider)).variance]

    @property
    def rest(self) -> Numbers:
        """Variance (R,) of friction at rest [N^2 m^2]."""
        return self.numbers[ResidualLayout(len(self.wider)).rest]


def residual_of(kernel: Kernel, solver: KernelSolver, rows: Numbers, drift: Array, size: int) -> InstantResidual:
    """Return scale (torque - W Phi - W_D drift) of the rows of an instant.

    drift: (D,) values of the adapted friction and zeros
    size:  R, number of measured torques
    """
    found = ZERO * ((3 + len(drift)) * size)
    kernel.explain(solver, rows, drift, found)
    return InstantResidual(rows, found, ZERO * size)


def residual_of_arrays(residual: Residual, columns: int, drifts: int) -> InstantResidual:
    """Return the residual of an instant of a recording; friction and zeros do not drift.

    columns: K, to which the columns of the tares are filled up with zeros
    drifts:  D
    """
    rows, own = np.zeros((len(residual.torque), columns)), residual.columns.shape[1]
    rows[:, :own] = residual.columns
    parts = [residual.torque, residual.variance, residual.rest, np.zeros(len(rows) * drifts)]
    return InstantResidual(array("d", rows.tobytes()), array("d", np.concatenate(parts).tobytes()), ZERO * len(rows))
