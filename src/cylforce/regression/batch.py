"""Batch least squares: weighted, with a prior, with standard errors that hold for autocorrelated residuals, and with
the
names of what the recording does not tell."""

from typing import NamedTuple

import numpy as np
from scipy import linalg

from cylforce.words.estimate import Array


class Fit(NamedTuple):
    """`values` (P,), `covariance` (P, P), `row_error` (R,): rms of the residual per row, `excited` (P,): whether the
    data
    alone tell the parameter, `weakest` (P, K): unit vectors (in scaled parameters) that the data do not tell."""

    values: Array
    covariance: Array
    row_error: Array
    excited: Array
    weakest: Array


class Prior(NamedTuple):
    """What is known before: `mean` (P,) and `covariance` (P, P)."""

    mean: Array
    covariance: Array


def least_squares(columns: Array, torque: Array, row_error: Array, prior: Prior | None, blocks: Array) -> Fit:
    """Fit torque (T, R) = columns (T, R, P) @ values; rows weighted by 1/row_error (R,).

    `blocks` (T,) numbers the blocks within which residuals may be correlated (longer than their memory): standard
    errors
    are the sandwich over blocks. NaN rows are left out. Raises ValueError when nothing remains."""
    good = np.isfinite(torque) & np.all(np.isfinite(columns), axis=-1)
    if not np.any(good):
        raise ValueError("no usable rows: nothing to fit")
    a = (columns / row_error[:, None])[good]
    b = (torque / row_error)[good]
    of_row = np.broadcast_to(blocks[:, None], torque.shape)[good]
    root, rhs = _prior_rows(prior, a.shape[1])
    scale = _scale(a, prior)
    memory = _memory(b - a @ (linalg.lstsq(a / scale, b)[0] / scale), of_row)
    stacked = np.concatenate([a / np.sqrt(memory), root])
    values = linalg.lstsq(stacked / scale, np.concatenate([b / np.sqrt(memory), rhs]))[0] / scale
    residual = b - a @ values
    excited, weakest = _excitation(a, scale)
    covariance = _sandwich(a, residual, of_row, memory, root)
    return Fit(values, covariance, _row_rms(columns, torque, values, good), excited, weakest)


def _prior_rows(prior: Prior | None, size: int) -> tuple[Array, Array]:
    """The prior as rows of a least-squares problem: root @ values = rhs with unit errors."""
    if prior is None:
        return np.zeros((0, size)), np.zeros(0)
    spread = np.sqrt(np.diag(prior.covariance))
    values, vectors = linalg.eigh(prior.covariance / np.outer(spread, spread))
    root = (vectors / np.sqrt(np.maximum(values, 1e-9))).T / spread
    return root, root @ prior.mean


def _scale(a: Array, prior: Prior | None) -> Array:
    """Column scaling: the prior's standard errors, else the columns' norms."""
    if prior is not None:
        return np.asarray(1.0 / np.sqrt(np.diag(prior.covariance)))
    norm = linalg.norm(a, axis=0)
    return np.where(norm > 0, norm, 1.0)


def _memory(residual: Array, block: Array) -> float:
    """By how much the sum of residuals over a block varies more than that of independent ones (>= 1)."""
    number = block - block.min()
    count = np.bincount(number)
    total = np.bincount(number, residual)
    return float(max(1.0, np.sum(total**2) / np.sum(residual**2))) if count.size > 1 else 1.0


def _sandwich(a: Array, residual: Array, block: Array, memory: float, root: Array) -> Array:
    """(A'A/c + L'L)^-1 (sum_b s_b s_b' + L'L) (...)^-1, s_b = sum of A' e over block b, scaled as the fit was."""
    bread = linalg.inv(a.T @ a / memory + root.T @ root)
    number = np.unique(block, return_inverse=True)[1]
    scores = np.zeros((number.max() + 1, a.shape[1]))
    np.add.at(scores, number, a * (residual / memory)[:, None])
    return np.asarray(bread @ (scores.T @ scores + root.T @ root) @ bread)


def _excitation(a: Array, scale: Array) -> tuple[Array, Array]:
    """What the data tell: directions of scaled parameters with a singular value below RANK of the largest are lost."""
    _, singular, vectors = linalg.svd(linalg.qr(a / scale, mode="r")[0][: a.shape[1]])
    lost = np.zeros(a.shape[1], dtype=bool)
    lost[: singular.size] = singular < RANK * max(singular[0], 1e-300)
    lost[singular.size :] = True
    weakest = vectors[lost].T
    return np.linalg.norm(weakest, axis=1) < 0.5, weakest


def _row_rms(columns: Array, torque: Array, values: Array, good: Array) -> Array:
    residual = np.where(good, torque - np.where(good[..., None], columns, 0.0) @ values, 0.0)
    return np.asarray(np.sqrt(np.sum(residual**2, axis=0) / np.maximum(np.sum(good, axis=0), 1)))


RANK = 1e-6
