"""Batch least squares on the factors of a recording.

The fit is weighted, may have a prior, and is robust against disturbed blocks. Noisy columns do not bias it. Its
standard errors are valid for correlated residuals, and it lists the directions that the recording does not determine.

The columns contain measured angles, so that least squares alone would give parameters that are too small (errors in
variables). Therefore the Gram matrix of the sensors' noise is subtracted from that of the rows, in the information and
in the scores (corrected score, Nakamura 1990, doi:10.1093/biomet/77.1.127)."""

from typing import NamedTuple

import numpy as np
from numpy import linalg

from cylforce.estimation.blocks import Factors, of_noise, of_others, residual_squares, scores, stacked_triangle
from cylforce.estimation.priors.prior import Prior
from cylforce.signals.estimate import Array

RANK = 1e-6  # times the largest singular value: directions of the scaled parameters below it are not determined; chosen
OUTLIER = 16.0  # times the median mean square of a row's residuals: blocks beyond it get a smaller weight; chosen
ROUNDS = 4  # of reweighting after the first fit; chosen
MOST_REMOVED = 0.9  # of the information in a direction: no more is subtracted for noise or an omitted block; chosen


class Fit(NamedTuple):
    """Result of a fit of K parameters.

    values:     (K,) parameters
    covariance: (K, K) of the values
    row_error:  (R,) rms residual per measured torque, rows set aside included, blocks weighted by `trust` squared [N m]
    excited:    (K,) whether the data determine the parameter without the prior
    weakest:    (K, D) directions that the data do not determine, of the parameters over their scale (`_scale`)
    trust:      (B, R) factor on the rows of each block; 1: in full, less for an outlier
    memory:     number of consecutive samples whose residuals count as one independent residual
    """

    values: Array
    covariance: Array
    row_error: Array
    excited: Array
    weakest: Array
    trust: Array
    memory: float


def least_squares(data: Factors, row_error: Array, prior: Prior | None) -> Fit:
    """Return the robust least-squares fit of observed = columns @ values to a recording, with its covariance.

    Rows are weighted by the inverse of their standard error. A block that fits much worse than the others has a smaller
    weight. The noise of the sensors within the columns does not bias the values. Raises ValueError when there are no
    usable rows.

    data:      B blocks of rows of R measured torques
    row_error: (R,) standard error of the rows of each torque [N m]
    prior:     of the parameters; None: none
    """
    root, found = _rounds(data, row_error, prior)
    excited, weakest = _excitation(found.triangle[:, :-1], _scale(found.triangle, prior))
    covariance = _covariance(data, found, root)
    rms = _row_rms(data, found.solution.values, found.trust)
    return Fit(found.solution.values, covariance, rms, excited, weakest, found.trust, found.memory)


class Converged(NamedTuple):
    """Robust least-squares fit without standard errors; with them it is a `Fit`.

    values:    (K,) parameters
    row_error: (R,) rms residual per measured torque, as in `Fit` [N m]
    memory:    number of consecutive samples whose residuals count as one independent residual
    """

    values: Array
    row_error: Array
    memory: float


def converged(data: Factors, row_error: Array, prior: Prior | None) -> Converged:
    """Return the fit of `least_squares` without standard errors, which take a quarter of its time.

    Raises ValueError when there are no usable rows.

    data:      B blocks of rows of R measured torques
    row_error: (R,) standard error of the rows of each torque [N m]
    prior:     of the parameters; None: none
    """
    found = _rounds(data, row_error, prior)[1]
    values = found.solution.values
    return Converged(values, _row_rms(data, values, found.trust), found.memory)


def best(data: Factors, weight: Array, prior: Prior | None) -> tuple[Array, float]:
    """Return (values (K,), smallest sum of squares) of weighted data and the prior.

    With equal weights, models of the same data can be compared by this sum. Unlike in `least_squares`, the sensors'
    noise in the columns is not subtracted, and no block gets a smaller weight as an outlier.

    data:   B blocks of rows of R measured torques
    weight: (B, R) factor on the rows of each block
    prior:  of the parameters; None: none
    """
    triangle, root = stacked_triangle(data, weight), _prior_rows(prior, data.triangle.shape[-1] - 1)
    values = _solved(triangle, np.zeros_like(triangle), root).values
    return values, float(np.sum((np.concatenate([triangle, root]) @ np.append(values, -1.0)) ** 2))


def predicted(data: Factors, row_error: Array, prior: Prior | None, memory: float, out: Array) -> Array:
    """Return the mean squared prediction error per sample (B_out,) of each block left out, in squared row errors.

    The B_out blocks are predicted by one fit of the other blocks. This fit is corrected for the sensors' noise in the
    columns (`_solved`); all its blocks count in full. The mean is over the samples of all R measured torques.

    data:      B blocks of rows of R measured torques, as triangular factors
    row_error: (R,) standard error of each row [N m]
    prior:     of the parameters; None: none
    memory:    number of consecutive samples that count as one independent sample
    out:       (B,) whether a block is left out and predicted
    """
    weight = np.where(out[:, None], 0.0, 1.0 / row_error) / np.sqrt(memory) * np.ones_like(data.samples)
    root = _prior_rows(prior, data.triangle.shape[-1] - 1)
    solution = _solved(stacked_triangle(data, weight), stacked_triangle(of_noise(data), weight), root)
    squares = np.sum(residual_squares(data, solution.values)[out] / row_error**2, axis=1)
    return np.asarray(squares / np.maximum(np.sum(data.samples[out], axis=1), 1.0))


class _Solution(NamedTuple):
    """Solution of weighted least squares.

    values: (K,) parameters
    white:  (K, D) root of (A'A - N'N + L'L)^-1 = white white', see `_solved`; D directions that rows or prior determine
    """

    values: Array
    white: Array


class _Round(NamedTuple):
    """One pass of reweighting.

    solution:    of this pass
    weight:      (B, R) factor on the rows of each block: trust / row error / sqrt(memory)
    triangle:    (K+1, K+1) of the weighted rows
    memory:      on which this pass is based, see `Fit`
    next_memory: for the next pass, from the residuals of this one
    trust:       (B, R) for the next pass, from the residuals of this one, see `Fit`
    """

    solution: _Solution
    weight: Array
    triangle: Array
    memory: float
    next_memory: float
    trust: Array


def _rounds(data: Factors, row_error: Array, prior: Prior | None) -> tuple[Array, _Round]:
    """Return the prior's rows (K, K+1) (`_prior_rows`), and the last pass of reweighting.

    Raises ValueError when there are no usable rows.

    data:      B blocks of rows of R measured torques
    row_error: (R,) standard error of the rows of each torque [N m]
    prior:     of the parameters; None: none
    """
    if not np.any(data.samples):
        raise ValueError("no usable rows: nothing to fit")
    root = _prior_rows(prior, data.triangle.shape[-1] - 1)
    found = _round(data, row_error, root, np.ones_like(data.samples), 1.0)
    for _ in range(ROUNDS):
        found = _round(data, row_error, root, found.trust, found.next_memory)
    return root, found


def _round(data: Factors, row_error: Array, root: Array, trust: Array, memory: float) -> _Round:
    """Return one pass of reweighting: the weighted solution, corrected for the sensors' noise in the columns, and the
    weights and memory that follow from its residuals.

    data:      blocks of the recording
    row_error: (R,) standard error of a row [N m]
    root:      rows (..., K+1) of the prior, with errors of one
    trust:     (B, R) factor on the rows of each block by its residuals in the last pass; 1: in full
    memory:    number of consecutive samples that count as one independent sample
    """
    weight = trust / row_error / np.sqrt(memory)
    triangle = stacked_triangle(data, weight)
    found = _solved(triangle, stacked_triangle(of_noise(data), weight), root)
    scores = _scores(data, found.values, weight * np.sqrt(memory))
    longer = max(1.0, _inflation(triangle * np.sqrt(memory), scores.T @ scores))
    return _Round(found, weight, triangle, memory, longer, _trust(data, found.values))


def _prior_rows(prior: Prior | None, size: int) -> Array:
    """Return the prior of K parameters as rows [columns | observed] (K, K+1) with errors of one; (0, K+1) without it.

    The rows are an inverse root of the covariance. It is computed from the correlation, whose eigenvalues are limited
    from below.

    size: K
    """
    if prior is None:
        return np.zeros((0, size + 1))
    spread = np.sqrt(np.diag(prior.covariance))
    values, vectors = linalg.eigh(prior.covariance / np.outer(spread, spread))
    root = (vectors / np.sqrt(np.maximum(values, 1e-9))).T / spread
    return np.asarray(np.column_stack([root, root @ prior.mean]))


def _solved(triangle: Array, noise: Array, root: Array) -> _Solution:
    """Return the solution of (A'A - N'N + L'L) values = A'b - N'n + L'l, least squares corrected for column noise.

    A and b are columns and observed values of the rows, N and n their noise, L and l those of the prior. With white
    white' = (A'A + L'L)^-1 the noise is the share (N white)'(N white) of the information. It is subtracted, at most
    MOST_REMOVED of it in a direction. The columns are scaled, so that no digits are lost.

    triangle: (K+1, K+1) of the weighted rows [A | b]
    noise:    (K+1, K+1) of their noise [N | n]
    root:     rows (..., K+1) of the prior [L | l]
    """
    rows = np.concatenate([triangle, root])
    scale = linalg.norm(rows[:, :-1], axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    left, singular, right = linalg.svd(rows[:, :-1] / scale, full_matrices=False)
    good = singular > np.finfo(float).eps * rows.shape[1] * singular[0]
    white = right[good].T / singular[good] / scale[:, None]
    noise_share = noise[:, :-1] @ white
    gain, axes = _enlarged(noise_share.T @ noise_share)
    white = white @ axes * np.sqrt(gain)
    right = axes.T @ (left[:, good].T @ rows[:, -1] - noise_share.T @ noise[:, -1])
    return _Solution(np.asarray(white @ (np.sqrt(gain) * right)), white)


def _enlarged(share: Array) -> tuple[Array, Array]:
    """Return eigenvalues (..., K) and eigenvectors (..., K, K) of (I - share)^-1.

    The eigenvalues of `share` are limited to MOST_REMOVED.

    share: (..., K, K) share of the information that is subtracted
    """
    values, axes = np.linalg.eigh(share)
    return 1.0 / (1.0 - np.minimum(values, MOST_REMOVED)), axes


def _scores(data: Factors, values: Array, weight: Array) -> Array:
    """Return the score A' e of every block (B, K): the direction in which the block would change the parameters.

    A are the columns of its weighted rows, e their residuals. The part that the sensors' noise in A causes is
    subtracted.

    data:   B blocks of rows of R measured torques
    values: (K,) parameters at which the residuals e are computed
    weight: (B, R) factor on the rows of each block
    """
    each = scores(data, values) - scores(of_noise(data), values)
    return np.asarray(np.sum(each * weight[..., None] ** 2, axis=1))


def _covariance(data: Factors, last_round: _Round, root: Array) -> Array:
    """Return the sandwich covariance (K, K) of the fitted parameters, valid for residuals correlated within a block.

    data:       B blocks of rows of R measured torques
    last_round: last pass of the fit, with the weights of the rows
    root:       rows (..., K+1) of the prior, with errors of one

    It is (A'A - N'N + L'L)^-1 on both sides of the sum of the blocks' squared scores and the prior's information L'L. A
    block attracts the estimate, so that its own residual is too small. Its score is enlarged to the value that it has
    for an estimate from the other blocks alone (jackknife, CR3: Bell and McCaffrey 2002)."""
    white = last_round.solution.white
    scores = _scores(data, last_round.solution.values, last_round.weight) @ white
    across = (data.triangle[..., :-1] * last_round.weight[..., None, None]) @ white
    across = across.reshape(len(across), -1, white.shape[1])
    gain, axes = _enlarged(np.swapaxes(across, 1, 2) @ across)
    scores = np.sum(axes * (gain * np.sum(axes * scores[:, :, None], axis=1))[:, None], axis=2)
    known = root[:, :-1] @ white
    return np.asarray(white @ (scores.T @ scores + known.T @ known) @ white.T)  # B (sum s s' + L'L) B, B = white white'


def _inflation(triangle: Array, meat: Array) -> float:
    """Return the factor by which the variance of the scores exceeds that of independent residuals of unit variance.

    It is the mean over the directions that the data determine.

    triangle: (K+1, K+1) of the rows, weighted as for independent residuals
    meat:     (K, K) sum of the blocks' squared scores, the middle of the sandwich covariance
    """
    scale = linalg.norm(triangle[:, :-1], axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    _, singular, vectors = linalg.svd(triangle[:-1, :-1] / scale)
    good = singular > RANK * singular[0]
    across = (vectors[good] / scale) @ meat @ (vectors[good] / scale).T
    return float(np.mean(np.diag(across) / singular[good] ** 2))


def _trust(data: Factors, values: Array) -> Array:
    """Return the factor (B, R) on the rows of every block, by its residuals at the parameters `values` (K,).

    It is 1, and less where the block's mean squared residual of a measured torque exceeds OUTLIER times the median over
    the blocks: factor^2 * mean square then equals that bound. A disturbed block (contact, a bump) counts less.

    data: B blocks of rows of R measured torques
    """
    mean = residual_squares(data, values) / np.maximum(data.samples, 1.0)
    typical = np.array(
        [np.median(m[n > 0]) if np.any(n > 0) else 1.0 for m, n in zip(mean.T, data.samples.T, strict=True)]
    )
    bound = np.maximum(OUTLIER * typical, 1e-300)
    return np.asarray(np.sqrt(bound / np.maximum(mean, bound)))


def _scale(triangle: Array, prior: Prior | None) -> Array:
    """Return the scale of every parameter (K,), by which the parameters become comparable.

    It is the prior's standard error, or without a prior the inverse norm of the parameter's column (1 for a column of
    zeros).

    triangle: (K+1, K+1) of the weighted rows
    prior:    of the parameters; None: none
    """
    if prior is not None:
        return np.sqrt(np.diag(prior.covariance))
    norm = linalg.norm(triangle[:, :-1], axis=0)
    return np.where(norm > 0, 1.0 / np.where(norm > 0, norm, 1.0), 1.0)


def _excitation(triangle: Array, scale: Array) -> tuple[Array, Array]:
    """Return whether the data determine each parameter (K,), and the directions (K, D) that they do not determine.

    Directions are unit vectors of the parameters over their scale. One is not determined if its singular value is less
    than RANK times the largest one. A parameter is determined unless half of its unit vector or more lies in the space
    of such directions.

    triangle: (..., K) of the rows, without the observed values
    scale:    (K,) of the parameters
    """
    _, singular, vectors = linalg.svd(triangle * scale)
    undetermined = np.ones(triangle.shape[1], dtype=bool)
    undetermined[: singular.size] = singular < RANK * max(singular[0], 1e-300)
    weakest = vectors[undetermined].T
    return np.linalg.norm(weakest, axis=1) < 0.5, weakest


def _row_rms(data: Factors, values: Array, trust: Array) -> Array:
    """Return the rms residual (R,) [N m] of each measured torque at parameters `values` (K,), rows set aside included.

    data:  B blocks of rows of R measured torques
    trust: (B, R) factor on the rows of each block, so that its squared residuals have the weight `trust` squared
    """
    weight = trust**2
    squares = (residual_squares(data, values) + residual_squares(of_others(data), values)) * weight
    count = (data.samples + data.others) * weight
    return np.asarray(np.sqrt(np.sum(squares, axis=0) / np.maximum(np.sum(count, axis=0), 1.0)))
