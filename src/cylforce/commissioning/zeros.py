"""How long the unexplained torque keeps its sign, as far as a weight is concerned: every few seconds of the
commissioning weigh a bucket that is known to be empty, and show by how much a weight is wrong that should be zero.

What the model leaves is no white noise: friction that differs from stroke to stroke, geometry and linkages keep their
sign for seconds. Weights of zero therefore scatter more than their noise tells. The factor between both is the number
of samples that count as one."""

import numpy as np

from cylforce.estimation.blocks import Factors
from cylforce.estimation.model import Model
from cylforce.estimation.residual import correlated, load_spread
from cylforce.signals.estimate import Array

BLOCKS = 3  # of the recording (`observation.BLOCK_SECONDS`) in one weighing of zero; chosen: a short lift
ENOUGH = 8  # weighings of zero before anything is concluded; chosen
CERTAIN = 0.1  # times the rated payload: largest error by noise alone of a weighing that counts; chosen


def correlation(model: Model, data: Factors, values: Array, row_error: Array) -> float:
    """Time [s] for which the residual keeps its sign, from blocks `data` of the empty machine with parameters `values`
    (P,) and `row_error` (R,) [N m]; 0 where there are too few blocks."""
    squares = weighings(model, data, values, row_error)
    return float(np.mean(squares)) / model.filters.rate_hz if len(squares) >= ENOUGH else 0.0


def weighings(model: Model, data: Factors, values: Array, row_error: Array) -> Array:
    """Square (W,) of every weight of zero over its variance by white noise of `row_error`."""
    grams = np.einsum("brki,brkj->bij", *[_projected(model, data, values) / row_error[:, None, None]] * 2)
    grams = grams[: len(grams) // BLOCKS * BLOCKS].reshape(-1, BLOCKS, 5, 5).sum(axis=1)
    prior = np.diag(load_spread(model.machine) ** -2.0) / correlated(model.filters)
    inverse = np.linalg.inv(grams[:, :4, :4] + prior)
    mass = np.einsum("wi,wi->w", inverse[:, 0], grams[:, :4, 4])
    variance = inverse[:, 0, 0]
    limit = (CERTAIN * model.machine.rated_payload) ** 2 / correlated(model.filters)
    return np.asarray((mass**2 / variance)[variance < limit])


def _projected(model: Model, data: Factors, values: Array) -> Array:
    """Triangles (B, R, K+1, 5) of the load's columns and of what `values` leave."""
    change = np.zeros((len(values) + 1, 5))
    change[:-1, :4], change[:-1, 4], change[-1, 4] = model.load, -values, 1.0
    return np.asarray(data.triangle @ change)
