"""Batch least squares on a recording's factors: weighted, with a prior, robust against spoilt blocks, with standard
errors that hold for correlated residuals, and with the names of what the recording does not tell."""

from typing import NamedTuple

import numpy as np
from scipy import linalg

from cylforce.regression.blocks import Factors, residual_squares, scores, stacked_triangle
from cylforce.words.estimate import Array

RANK = 1e-6  # singular value, as a share of the largest, below which a direction of the scaled parameters is not told
SPOILT = 16.0  # times the usual mean square of a row's residual: from there on a block counts down
ROUNDS = 4


class Fit(NamedTuple):
    """`values` (K,), `covariance` (K, K), `row_error` (R,): rms of the residual per row, `excited` (K,): whether the
    data alone tell the parameter, `weakest` (K, D): directions of the scaled parameters that the data do not tell,
    `trust` (B, R): 1 for a block that counts in full, `memory`: residuals of so many samples say the same."""

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
    middle = found.meat / found.memory**2 + root[:, :-1].T @ root[:, :-1]
    excited, weakest = _excitation(found.triangle[:, :-1], _scale(found.triangle, prior))
    covariance = found.bread @ middle @ found.bread
    return Fit(
        found.values, covariance, _row_rms(held, found.values, found.trust), excited, weakest, found.trust, found.memory
    )


def best(held: Factors, weight: Array, prior: Prior | None) -> tuple[Array, float]:
    """(values (K,), least sum of squares) of `held`, its blocks and rows multiplied by `weight` (B, R), and the prior.
    At equal weights, models of the same data may be compared by it."""
    rows = np.concatenate([stacked_triangle(held, weight), _prior_rows(prior, held.triangle.shape[-1] - 1)])
    values = _solved(rows)
    return values, float(np.sum((rows @ np.append(values, -1.0)) ** 2))


def predicted(held: Factors, row_error: Array, prior: Prior | None, memory: float, out: Array) -> Array:
    """Mean squared residual per sample, in units of row_error, of each block in `out` (B,) bool, predicted from the
    others alone (B_out,)."""
    weight = np.where(out[:, None], 0.0, 1.0 / row_error) / np.sqrt(memory)
    triangle = stacked_triangle(held, weight * np.ones_like(held.samples))
    values = _solved(np.concatenate([triangle, _prior_rows(prior, triangle.shape[1] - 1)]))
    squares = np.sum(residual_squares(held, values)[out] / row_error**2, axis=1)
    return np.asarray(squares / np.maximum(np.sum(held.samples[out], axis=1), 1.0))


class _Round(NamedTuple):
    """One pass: the solution, what it rests on, and the weights that follow from it."""

    values: Array
    triangle: Array
    bread: Array
    meat: Array
    memory: float
    next_memory: float
    trust: Array


def _round(held: Factors, row_error: Array, root: Array, trust: Array, memory: float) -> _Round:
    weight = trust / row_error
    triangle = stacked_triangle(held, weight / np.sqrt(memory))
    values = _solved(np.concatenate([triangle, root]))
    meat = _spread(held, values, weight**2)
    longer = max(1.0, _inflation(triangle * np.sqrt(memory), meat))
    return _Round(values, triangle, _inverse(triangle, root), meat, memory, longer, _trust(held, values))


def _prior_rows(prior: Prior | None, size: int) -> Array:
    """The prior as rows [columns | observed] with unit errors."""
    if prior is None:
        return np.zeros((0, size + 1))
    spread = np.sqrt(np.diag(prior.covariance))
    values, vectors = linalg.eigh(prior.covariance / np.outer(spread, spread))
    root = (vectors / np.sqrt(np.maximum(values, 1e-9))).T / spread
    return np.asarray(np.column_stack([root, root @ prior.mean]))


def _solved(rows: Array) -> Array:
    scale = linalg.norm(rows[:, :-1], axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    return np.asarray(linalg.lstsq(rows[:, :-1] / scale, rows[:, -1])[0] / scale)


def _inverse(triangle: Array, root: Array) -> Array:
    """(R'R + L'L)^-1 of the parameters' part, scaled so that it does not lose digits."""
    rows = np.concatenate([triangle[:-1, :-1], root[:, :-1]])
    scale = linalg.norm(rows, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    inverse = linalg.pinv(rows / scale)
    return np.asarray((inverse @ inverse.T) / np.outer(scale, scale))


def _spread(held: Factors, values: Array, weight: Array) -> Array:
    """Sum over blocks of s s', s = sum over rows of A' e: the scores' own scatter, correlated as it may be."""
    pull = np.sum(scores(held, values) * weight[..., None], axis=1)
    return np.asarray(pull.T @ pull)


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
    squares = np.sum(residual_squares(held, values) * trust**2, axis=0)
    return np.asarray(np.sqrt(squares / np.maximum(np.sum(held.samples * trust**2, axis=0), 1.0)))
