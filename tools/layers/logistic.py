"""A ridge logistic regression, fitted by Newton's method."""

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.posterior import Logistic

Array = NDArray[np.float64]
RIDGE = 1.0  # precision of the coefficients, in standard deviations of the features
ROUNDS = 50


def fitted(features: Array, right: NDArray[np.bool_]) -> Logistic:
    """The regression of `right` (N,) on features (N, F)."""
    mean, scale = features.mean(axis=0), features.std(axis=0) + 1e-9
    x = np.column_stack([(features - mean) / scale, np.ones(len(features))])
    ridge = np.diag(np.append(np.full(features.shape[1], RIDGE), 1e-3))
    weights = np.zeros(x.shape[1])
    for _ in range(ROUNDS):
        p = 1.0 / (1.0 + np.exp(-x @ weights))
        gradient = x.T @ (right - p) - ridge @ weights
        weights += np.linalg.solve((x * (p * (1.0 - p))[:, None]).T @ x + ridge, gradient)
    return Logistic(tuple(mean.tolist()), tuple(scale.tolist()), tuple(weights.tolist()))
