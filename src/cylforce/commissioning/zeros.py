"""How long the unexplained torque keeps its sign, as far as a weight is concerned: every few seconds of the
commissioning weigh a bucket that is known to be empty, and show by how much a weight is wrong that should be zero.

What the model leaves is no white noise: friction that differs from stroke to stroke, geometry and linkages keep their
sign for seconds. Weights of zero therefore scatter more than their noise tells. The factor between both is the number
of samples that count as one.

Friction and the zeros of the pressures differ from stroke to stroke, too: parameters fitted to a recording are right on
average, but a lift sees a few strokes only. The same few seconds show by how much."""

import numpy as np

from cylforce.estimation.blocks import Factors
from cylforce.estimation.drift import drift_spread, kinds
from cylforce.estimation.model import EXPECTED, BetweenStrokes, Model
from cylforce.estimation.residual import correlated, load_spread
from cylforce.signals.estimate import Array

BLOCKS = 3  # of the recording (`observation.BLOCK_SECONDS`) in one weighing of zero; chosen: a short lift
ENOUGH = 8  # weighings of zero before anything is concluded; chosen
CERTAIN = 0.1  # times the rated payload: largest error by noise alone of a weighing that counts; chosen

PRIOR_COUNT = 1.0  # strokes that the expected spread is worth; chosen: one
STEPS = 30  # of expectation maximisation: changes are below 1 % then


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


def between_strokes(model: Model, whole: Factors, values: Array, row_error: Array) -> BetweenStrokes:
    """The spread between strokes, from blocks `whole` of the empty machine (the columns of the zeros last), with
    parameters `values` (P,) and `row_error` (R,) [N m].

    In a stroke the drift is d ~ N(0, k^2 S), S the expected spread; k^2 of friction and of zeros is the mode of its
    posterior by expectation maximisation: k^2 = (n + sum (d^2 + c) / s^2) / (n + number), c the variance of d."""
    gram, pull = _strokes(model, whole, values, row_error)
    spread, kind = drift_spread(model, values, EXPECTED), kinds(model)
    scale = np.ones(2)
    for _ in range(STEPS):
        prior = (scale[kind] * spread) ** 2
        covariance = np.linalg.inv(gram + np.diag(1.0 / prior))
        drift = np.einsum("gij,gj->gi", covariance, pull)
        square = (drift**2 + np.einsum("gii->gi", covariance)) / spread**2
        sums = np.array([square[:, kind == k].sum() for k in range(2)])
        counts = np.array([square[:, kind == k].size for k in range(2)])
        scale = np.sqrt((PRIOR_COUNT + sums) / (PRIOR_COUNT + counts))
    return BetweenStrokes(*(float(k * s) for k, s in zip(scale, EXPECTED, strict=True)))


def _strokes(model: Model, whole: Factors, values: Array, row_error: Array) -> tuple[Array, Array]:
    """Information (G, D, D) and its vector (G, D) about the drift in each of G short lifts."""
    count, zeros = len(model.machine.cylinders), whole.triangle.shape[-1] - 1
    columns = whole.triangle[..., [*model.changing_friction, *range(zeros - count, zeros)]]
    left = whole.triangle[..., -1] - whole.triangle[..., : len(values)] @ values
    both = np.concatenate([columns, left[..., None]], axis=-1) / row_error[:, None, None]
    gram = np.einsum("brki,brkj->bij", both, both) / correlated(model.filters)
    size = gram.shape[-1]
    gram = gram[: len(gram) // BLOCKS * BLOCKS].reshape(-1, BLOCKS, size, size).sum(axis=1)
    return gram[:, :-1, :-1], gram[:, :-1, -1]
