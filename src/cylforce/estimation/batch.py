"""Batch least squares on a recording's factors: weighted, with a prior, free of the bias of noisy columns, robust
against spoilt blocks, with standard errors that hold for correlated residuals, and with the names of what the recording
does not tell.

Columns hold measured angles, so least squares alone would shrink what it finds (errors in variables): the Gram matrix
of the sensors' noise is taken off that of the rows, in information and scores alike (corrected score, Nakamura 1990,
doi:10.1093/biomet/77.1.127)."""

from typing import NamedTuple

import numpy as np
from scipy import linalg

from cylforce.estimation.blocks import Factors, of_noise, of_others, residual_squares, scores, stacked_triangle
from cylforce.signals.estimate import Array

RANK = 1e-6  # singular value, as a share of the largest, below which a direction of the scaled parameters is not told
SPOILT = 16.0  # times the usual mean square of a row's residual: from there on a block counts down
ROUNDS = 4
MOST = 0.9  # of a direction's information: no more is taken off for noise, or for a block that is left out


class Fit(NamedTuple):
    """`values` (K,), `covariance` (K, K), `row_error` (R,): rms of the residual per row, rows that were set aside too,
    `excited` (K,): whether the data alone tell the parameter, `weakest` (K, D): directions of the scaled parameters
    that the data do not tell, `trust` (B, R): 1 for a block that counts in full, `memory`: residuals of so many samples
    say the same."""

    values: Array
    covariance: Array
    row_error: Array
    excited: Array
    weakest: Array
    trust: Array
    memory: float


class Prior(NamedTuple):
    """What is known before: `mean` (K,) and `covariance` (K, K)."""

    mean: Array
    covariance: Array


def least_squares(held: Factors, row_error: Array, prior: Prior | None) -> Fit:
    """Fit observed = columns @ values; rows weighted by 1/row_error (R,), blocks by how much they fit the others.

    Raises ValueError when there is nothing to fit."""
    if not np.any(held.samples):
        raise ValueError("no usable rows: nothing to fit")
    root = _prior_rows(prior, held.triangle.shape[-1] - 1)
    found = _round(held, row_error, root, np.ones_like(held.samples), 1.0)
    for _ in range(ROUNDS):
        found = _round(held, row_error, root, found.trust, found.next_memory)
    excited, weakest = _excitation(found.triangle[:, :-1], _scale(found.triangle, prior))
    covariance = _covariance(held, found, root)
    rms = _row_rms(held, found.solution.values, found.trust)
    return Fit(found.solution.values, covariance, rms, excited, weakest, found.trust, found.memory)


def best(held: Factors, weight: Array, prior: Prior | None) -> tuple[Array, float]:
    """(values (K,), least sum of squares) of `held`, its blocks and rows multiplied by `weight` (B, R), and the prior.
    At equal weights, models of the same data may be compared by it."""
    triangle, root = stacked_triangle(held, weight), _prior_rows(prior, held.triangle.shape[-1] - 1)
    values = _solved(triangle, np.zeros_like(triangle), root).values
    return values, float(np.sum((np.concatenate([triangle, root]) @ np.append(values, -1.0)) ** 2))


def predicted(held: Factors, row_error: Array, prior: Prior | None, memory: float, out: Array) -> Array:
    """Mean squared residual per sample, in units of row_error, of each block in `out` (B,) bool, predicted from the
    others alone (B_out,)."""
    weight = np.where(out[:, None], 0.0, 1.0 / row_error) / np.sqrt(memory) * np.ones_like(held.samples)
    root = _prior_rows(prior, held.triangle.shape[-1] - 1)
    solution = _solved(stacked_triangle(held, weight), stacked_triangle(of_noise(held), weight), root)
    squares = np.sum(residual_squares(held, solution.values)[out] / row_error**2, axis=1)
    return np.asarray(squares / np.maximum(np.sum(held.samples[out], axis=1), 1.0))


class _Solution(NamedTuple):
    """`values` (K,) and `white` (K, D), a root of (A'A - N'N + L'L)^-1 = white white'."""

    values: Array
    white: Array


class _Round(NamedTuple):
    """One pass: the solution, the `weight` (B, R) and the triangle that it rests on, and what follows from it."""

    solution: _Solution
    weight: Array
    triangle: Array
    memory: float
    next_memory: float
    trust: Array


def _round(held: Factors, row_error: Array, root: Array, trust: Array, memory: float) -> _Round:
    weight = trust / row_error / np.sqrt(memory)
    triangle = stacked_triangle(held, weight)
    found = _solved(triangle, stacked_triangle(of_noise(held), weight), root)
    pull = _pull(held, found.values, weight * np.sqrt(memory))
    longer = max(1.0, _inflation(triangle * np.sqrt(memory), pull.T @ pull))
    return _Round(found, weight, triangle, memory, longer, _trust(held, found.values))


def _prior_rows(prior: Prior | None, size: int) -> Array:
    """The prior as rows [columns | observed] with unit errors."""
    if prior is None:
        return np.zeros((0, size + 1))
    spread = np.sqrt(np.diag(prior.covariance))
    values, vectors = linalg.eigh(prior.covariance / np.outer(spread, spread))
    root = (vectors / np.sqrt(np.maximum(values, 1e-9))).T / spread
    return np.asarray(np.column_stack([root, root @ prior.mean]))


def _solved(triangle: Array, noise: Array, root: Array) -> _Solution:
    """Least squares of the rows of `triangle` and `root`, scaled so that it does not lose digits, without what `noise`
    contributes."""
    rows = np.concatenate([triangle, root])
    scale = linalg.norm(rows[:, :-1], axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    left, singular, right = linalg.svd(rows[:, :-1] / scale, full_matrices=False)
    good = singular > np.finfo(float).eps * rows.shape[1] * singular[0]
    white = right[good].T / singular[good] / scale[:, None]
    unsure = noise[:, :-1] @ white
    gain, axes = _enlarged(unsure.T @ unsure)
    white = white @ axes * np.sqrt(gain)
    pull = axes.T @ (left[:, good].T @ rows[:, -1] - unsure.T @ noise[:, -1])
    return _Solution(np.asarray(white @ (np.sqrt(gain) * pull)), white)


def _enlarged(share: Array) -> tuple[Array, Array]:
    """Eigenvalues (..., K) of (I - share)^-1 and its axes (..., K, K); `share` (..., K, K) is what is taken off."""
    values, axes = np.linalg.eigh(share)
    return 1.0 / (1.0 - np.minimum(values, MOST)), axes


def _pull(held: Factors, values: Array, weight: Array) -> Array:
    """What every block pulls the parameters by (B, K): its scores without those of the noise."""
    each = scores(held, values) - scores(of_noise(held), values)
    return np.asarray(np.sum(each * weight[..., None] ** 2, axis=1))


def _covariance(held: Factors, found: _Round, root: Array) -> Array:
    """The sandwich: bread (A'A - N'N + L'L)^-1, between two of it the scatter of the blocks' pulls, correlated within a
    block as they may be, and the prior's own.

    A block pulls the estimate towards itself and so looks better than it is: its pull is enlarged to what it is when
    the estimate is made from the others alone (jackknife, CR3: Bell and McCaffrey 2002)."""
    white = found.solution.white
    pull = _pull(held, found.solution.values, found.weight) @ white
    across = (held.triangle[..., :-1] * found.weight[..., None, None]) @ white
    across = across.reshape(len(across), -1, white.shape[1])
    gain, axes = _enlarged(np.swapaxes(across, 1, 2) @ across)
    pull = np.sum(axes * (gain * np.sum(axes * pull[:, :, None], axis=1))[:, None], axis=2)
    known = root[:, :-1] @ white
    return np.asarray(white @ (pull.T @ pull + known.T @ known) @ white.T)


def _inflation(triangle: Array, meat: Array) -> float:
    """By how much the scores scatter more than those of independent residuals of unit variance, on average over the
    directions that the data tell."""
    scale = linalg.norm(triangle[:, :-1], axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    _, singular, vectors = linalg.svd(triangle[:-1, :-1] / scale)
    good = singular > RANK * singular[0]
    across = (vectors[good] / scale) @ meat @ (vectors[good] / scale).T
    return float(np.mean(np.diag(across) / singular[good] ** 2))


def _trust(held: Factors, values: Array) -> Array:
    """A block whose residual is far larger than the row's median counts down: weight^2 * square stays bounded."""
    mean = residual_squares(held, values) / np.maximum(held.samples, 1.0)
    usual = np.array(
        [np.median(m[n > 0]) if np.any(n > 0) else 1.0 for m, n in zip(mean.T, held.samples.T, strict=True)]
    )
    bound = np.maximum(SPOILT * usual, 1e-300)
    return np.asarray(np.sqrt(bound / np.maximum(mean, bound)))


def _scale(triangle: Array, prior: Prior | None) -> Array:
    """One unit of a parameter: the prior's standard error, else what the columns' norms suggest."""
    if prior is not None:
        return np.sqrt(np.diag(prior.covariance))
    norm = linalg.norm(triangle[:, :-1], axis=0)
    return np.where(norm > 0, 1.0 / np.where(norm > 0, norm, 1.0), 1.0)


def _excitation(triangle: Array, scale: Array) -> tuple[Array, Array]:
    _, singular, vectors = linalg.svd(triangle * scale)
    lost = np.ones(triangle.shape[1], dtype=bool)
    lost[: singular.size] = singular < RANK * max(singular[0], 1e-300)
    weakest = vectors[lost].T
    return np.linalg.norm(weakest, axis=1) < 0.5, weakest


def _row_rms(held: Factors, values: Array, trust: Array) -> Array:
    weight = trust**2
    squares = (residual_squares(held, values) + residual_squares(of_others(held), values)) * weight
    count = (held.samples + held.others) * weight
    return np.asarray(np.sqrt(np.sum(squares, axis=0) / np.maximum(np.sum(count, axis=0), 1.0)))
