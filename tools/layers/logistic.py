"""A multinomial ridge logistic regression."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from cylforce.diagnosis.answer.calibration import Outcomes

Array = NDArray[np.float64]
RIDGE = 3.0  # precision of the coefficients, in standard deviations of the features; of 0.1 to 30 the best log score
KINDS = 4  # of outcomes


def fitted(features: Array, outcome: NDArray[np.intp], weight: Array, tempered: float) -> Outcomes:
    """The regression of `outcome` (N,), numbers from 0 to 3, on features (N, F), cases counted by `weight` (N,)."""
    mean, scale = features.mean(axis=0), features.std(axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    x = np.column_stack([(features - mean) / scale, np.ones(len(features))])
    ridge, true = np.append(np.full(features.shape[1], RIDGE), 1e-3), np.eye(KINDS)[outcome]

    def cost(flat: Array) -> tuple[float, Array]:
        w = flat.reshape(KINDS, -1)
        logs = x @ w.T
        logs -= np.logaddexp.reduce(logs, axis=1, keepdims=True)
        gradient = ((np.exp(logs) - true) * weight[:, None]).T @ x + ridge * w
        return float(-np.sum(weight * np.sum(true * logs, axis=1)) + 0.5 * np.sum(ridge * w**2)), gradient.ravel()

    found = minimize(cost, np.zeros(KINDS * x.shape[1]), jac=True, method="L-BFGS-B").x.reshape(KINDS, -1)
    return Outcomes(tuple(mean.tolist()), tuple(scale.tolist()), tuple(map(tuple, found.tolist())), tempered)
