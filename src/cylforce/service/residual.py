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
    numbers: four parts (`weighed.residual_torque`): residual torque (R,) [N m]; its variance (R,) without friction at
             rest [N^2 m^2]; variance (R,) of friction at rest [N^2 m^2]; columns (R, D) of the drift
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
    """Return the residual torque (R,) [N m] of an instant, scale (torque - W Phi - W_D drift), with its variance.

    W Phi is the torque of the empty machine (columns times tares), W_D are the columns of friction and pressure zeros,
    and `scale` is the factor identified with a known weight.

    solver: the kernel's constants of the tares
    rows:   columns W (R, K) and measured torques (R,) of the instant, as the kernel keeps them
    drift:  (D,) change of friction [N, N s/m] and pressure zeros [N] since the identification
    size:   R, number of measured torques
    """
    found = ZERO * ((3 + len(drift)) * size)
    kernel.residual_torque(solver, rows, drift, found)
    return InstantResidual(rows, found, ZERO * size)


def residual_of_arrays(residual: Residual, columns: int, drifts: int) -> InstantResidual:
    """Return the residual torque of an instant of a recording in the form of the service's steps, without drift.

    Its `rows` contain only the columns, no measured torques. The columns of the drift are zero.

    residual: residual torque of the instant with its variances and columns, as arrays
    columns:  K, number to which the columns of the identified parameters are filled up with zeros
    drifts:   D, number of drifts
    """
    rows, own = np.zeros((len(residual.torque), columns)), residual.columns.shape[1]
    rows[:, :own] = residual.columns
    parts = [residual.torque, residual.variance, residual.rest, np.zeros(len(rows) * drifts)]
    return InstantResidual(array("d", rows.tobytes()), array("d", np.concatenate(parts).tobytes()), ZERO * len(rows))
