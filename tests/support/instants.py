"""Instants of a machine as the service's parts take them, of arrays."""

from array import array

import numpy as np

from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.residual import Residual
from cylforce.service.residual import residual_of_arrays

ALL = array("d", [1.0, 1.0, 1.0])
NONE = array("d", [0.0, 0.0, 0.0])


def unexplained_of(columns, torque, variance, drifts=0):
    """What is left of an instant: columns (R, K), torque and variance (R,)."""
    left = Residual(np.asarray(torque), np.asarray(variance), np.zeros(len(columns)), columns)
    return residual_of_arrays(left, columns.shape[1], drifts)


def rows_of(usable):
    """Which rows (R,) are usable."""
    return numbers(usable)
