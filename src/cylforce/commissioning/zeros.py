"""Estimate the correlation of the residual, and its spread between strokes, from weighings of the empty bucket.

Every few seconds of the commissioning weigh an empty bucket. The weight should be zero; its error
shows the model error. The residual is no white noise: friction that differs from stroke to stroke, geometry and
linkages keep their sign for seconds. Weights of zero therefore scatter more than white noise explains. The factor
between both is the number of consecutive samples that count as one independent sample.

Friction and the zeros of the pressures differ from stroke to stroke, too. Parameters fitted to a recording are right on
average, but a lift contains a few strokes only. The same weighings give this spread.
"""

import numpy as np

from cylforce.estimation.blocks import Factors
from cylforce.estimation.drift import drift_spread, kinds
from cylforce.estimation.model import EXPECTED, BetweenStrokes, Model
from cylforce.estimation.residual import correlated_samples, load_spread
from cylforce.signals.estimate import Array

BLOCKS = 3  # blocks of the recording (`observation.BLOCK_SECONDS`) in one weighing of zero; chosen: a short lift
ENOUGH = 8  # weighings of zero before anything is concluded; chosen
CERTAIN = 0.1  # largest error by noise alone of a weighing that counts, times the rated payload; chosen

PRIOR_COUNT = 1.0  # strokes that the expected spread is worth; chosen: one
STEPS = 30  # steps of expectation maximisation: changes are below 1 % then


def correlation(model: Model, data: Factors, values: Array, row_error: Array) -> float:
    """Return the time [s] for which the residual keeps its sign; 0 where there are too few weighings (ENOUGH).

    It is the mean over the weighings of weight^2 / variance by white noise, in samples.

    data: factors of a recording of the empty machine, for the P parameters of `values`
    values: (P,) identified parameters of the empty machine
    row_error: (R,) rms residual of each measured torque [N m]
    """
    squares = weighings(model, data, values, row_error)
    return float(np.mean(squares)) / model.filters.rate_hz if len(squares) >= ENOUGH else 0.0


def weighings(model: Model, data: Factors, values: Array, row_error: Array) -> Array:
    """Return for W weighings of zero the square (W,) of the weight over its variance by white noise.

    A weighing consists of BLOCKS blocks of the recording. W counts those whose noise is small enough (CERTAIN).

    data: factors of a recording of the empty machine, for the P parameters of `values`
    values: (P,) identified parameters of the empty machine
    row_error: (R,) rms residual of each measured torque [N m]
    """
    grams = np.einsum("brki,brkj->bij", *[_projected(model, data, values) / row_error[:, None, None]] * 2)
    grams = grams[: len(grams) // BLOCKS * BLOCKS].reshape(-1, BLOCKS, 5, 5).sum(axis=1)
    prior = np.diag(load_spread(model.machine) ** -2.0) / correlated_samples(model.filters)
    # (m, m x, m z, J) = (X'X + P0^-1)^-1 X'r of each weighing; its first component is the weight, its variance by noise
    inverse = np.linalg.inv(grams[:, :4, :4] + prior)
    mass = np.einsum("wi,wi->w", inverse[:, 0], grams[:, :4, 4])
    variance = inverse[:, 0, 0]
    limit = (CERTAIN * model.machine.rated_payload) ** 2 / correlated_samples(model.filters)
    return np.asarray((mass**2 / variance)[variance < limit])


def _projected(model: Model, data: Factors, values: Array) -> Array:
    """Return the triangles (B, R, P+1, 5) of four columns of the load and of the residual torque, in this order.

    The columns of the load (m, m x, m z, J) are combinations of those of the P parameters. The residual is that of the
    parameters `values` (P,).

    data: factors of B blocks of R measured torques, for these P parameters
    """
    change = np.zeros((len(values) + 1, 5))
    change[:-1, :4], change[:-1, 4], change[-1, 4] = model.load, -values, 1.0
    return np.asarray(data.triangle @ change)


def between_strokes(model: Model, whole: Factors, values: Array, row_error: Array) -> BetweenStrokes:
    """Return the standard deviations between strokes, of friction (share of the identified one) and of zeros [Pa].

    In each of G strokes, D frictions and zeros differ from their mean by the drift d. A drift is normally distributed
    with the standard error k s, s the expected one. The factor k of all frictions and that of all zeros are estimated
    by expectation maximisation. Their squares converge to the mode of the posterior:
    k^2 = (n + sum (d^2 + c) / s^2) / (n + N), with c the variance of d, the sum over the N drifts of this kind in all
    strokes, and n = PRIOR_COUNT.

    whole: factors of a recording of the empty machine, as of `observed_factors`: the first P columns are those of the
        parameters, the last C those of the zeros, one for each cylinder
    values: (P,) identified parameters of the empty machine
    row_error: (R,) rms residual of each measured torque [N m]
    """
    gram, vector = _strokes(model, whole, values, row_error)
    # (D,) expected standard errors; (D,) kind of each drift, 0 friction, 1 zero
    spread, kind = drift_spread(model, values, EXPECTED), kinds(model)
    scale = np.ones(2)  # k of frictions and of zeros
    for _ in range(STEPS):
        # expectation: drift (G, D) of each stroke, and its covariance (G, D, D)
        prior = (scale[kind] * spread) ** 2
        covariance = np.linalg.inv(gram + np.diag(1.0 / prior))
        drift = np.einsum("gij,gj->gi", covariance, vector)
        # maximisation
        square = (drift**2 + np.einsum("gii->gi", covariance)) / spread**2
        sums = np.array([square[:, kind == k].sum() for k in range(2)])
        counts = np.array([square[:, kind == k].size for k in range(2)])
        scale = np.sqrt((PRIOR_COUNT + sums) / (PRIOR_COUNT + counts))
    friction, zero = scale.tolist()
    return BetweenStrokes(friction=friction * EXPECTED.friction, zero=zero * EXPECTED.zero)


def _strokes(model: Model, whole: Factors, values: Array, row_error: Array) -> tuple[Array, Array]:
    """Return the information X'X (G, D, D) about the D drifts in each of G strokes, and its vector X'r (G, D).

    A stroke stands for BLOCKS blocks of the recording, as long as a short lift. X are the columns of the frictions that
    drift and of the pressure zeros, r is the residual torque of the parameters, both over the error of their row.

    whole: factors of a recording of the empty machine, with columns as in `between_strokes`
    values: (P,) identified parameters of the empty machine
    row_error: (R,) rms residual of each measured torque [N m]
    """
    count, zeros = len(model.machine.cylinders), whole.triangle.shape[-1] - 1
    columns = whole.triangle[..., [*model.changing_friction, *range(zeros - count, zeros)]]
    unexplained = whole.triangle[..., -1] - whole.triangle[..., : len(values)] @ values
    rows = np.concatenate([columns, unexplained[..., None]], axis=-1) / row_error[:, None, None]
    gram = np.einsum("brki,brkj->bij", rows, rows) / correlated_samples(model.filters)
    size = gram.shape[-1]
    gram = gram[: len(gram) // BLOCKS * BLOCKS].reshape(-1, BLOCKS, size, size).sum(axis=1)
    return gram[:, :-1, :-1], gram[:, :-1, -1]
