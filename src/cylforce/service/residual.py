"""Residual torque of one instant: measured torques less those of tares and drift."""

from array import array
from dataclasses import dataclass
from functools import cache

import numpy as np

from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.layout import ResidualLayout
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solver import KernelSolver
from cylforce.estimation.kernel.solving import ZERO
from cylforce.estimation.residual import Residual
from cylforce.signals.estimate import Array

_places = cache(ResidualLayout)  # the same at every step


@dataclass(slots=True)
class InstantResidual:
    """Residual torque of the R measured joints at one instant, with its variance.

    rows:    columns (R, K), then torques (R,), then others, as the kernel keeps the rows of a step
    numbers: four parts (`weighed.explain`): residual torque (R,) [N m]; its variance (R,) without friction at rest
             [N^2 m^2]; variance (R,) of friction at rest [N^2 m^2]; columns (R, D) of the drift
    wider:   (R,) added to the variance while the base rocks [N^2 m^2]
    """

    rows: Numbers
    numbers: Numbers
    wider: Numbers

    @property
    def torque(self) -> Numbers:
        """Residual torque (R,) [N m]."""
        return self.numbers[_places(len(self.wider)).torque]

    @property
    def variance(self) -> Numbers:
        """Variance (R,) of the residual torque without friction at rest [N^2 m^2]."""
        return self.numbers[_places(len(self.wider)).variance]

    @property
    def rest(self) -> Numbers:
        """Variance (R,) of friction at rest [N^2 m^2]."""
        return self.numbers[_places(len(self.wider)).rest]


def residual_of(kernel: Kernel, solver: KernelSolver, rows: Numbers, drift: Array, size: int) -> InstantResidual:
    """Return scale (torque - W Phi - W_D drift) of the rows of an instant.

    rows:  columns and torques of the instant, as the kernel keeps them
    drift: (D,) values of the adapted friction and zeros
    size:  R, number of measured torques
    """
    found = ZERO * ((3 + len(drift)) * size)
    kernel.explain(solver, rows, drift, found)
    return InstantResidual(rows, found, ZERO * size)


def residual_of_arrays(residual: Residual, columns: int, drifts: int) -> InstantResidual:
    """Return the residual of an instant of a recording, without drift of friction and zeros.

    residual: of the recording
    columns:  K, number to which the columns of the tares are filled up with zeros
    drifts:   D, number of drifts
    """
    rows, own = np.zeros((len(residual.torque), columns)), residual.columns.shape[1]
    rows[:, :own] = residual.columns
    parts = [residual.torque, residual.variance, residual.rest, np.zeros(len(rows) * drifts)]
    return InstantResidual(array("d", rows.tobytes()), array("d", np.concatenate(parts).tobytes()), ZERO * len(rows))
