"""Recursive least squares in square-root information form, with forgetting in the row space of the regressor only.

The information matrix U'U is stored as its triangular root U, so that it can never become indefinite, and no covariance
grows without bound. Without forgetting the result equals batch least squares with the same weights and the prior as
additional rows, to rounding (mechanics/README.md, section 10).
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from cylforce.signals.estimate import Array


class Root(NamedTuple):
    """Information about P parameters; the estimate solves U values = z.

    factor: (P, P) upper triangle U of the information matrix U'U
    right:  (P,) right-hand side z
    """

    factor: Array
    right: Array


def nothing_known(size: int) -> Root:
    """Return the state without any prior information about `size` parameters."""
    return Root(np.zeros((size, size)), np.zeros(size))


def known(mean: Array, standard_error: Array) -> Root:
    """Return the information of independent priors of P parameters: U = diag(1/standard error), z = U mean.

    mean:           (P,) prior means
    standard_error: (P,) prior standard errors
    """
    return Root(np.diag(1.0 / standard_error), mean / standard_error)


def update(root: Root, columns: Array, observed: Array, variance: Array) -> Root:
    """Return the state after further rows observed = columns @ values, by the QR decomposition of old and new rows.

    A row of infinite variance has no effect. Without rows the factor becomes a triangle again.

    root:     information about P parameters so far: triangle U and right-hand side z
    columns:  (rows, P) coefficients of the new rows
    observed: (rows,) observed values
    variance: (rows,) of the error of each row, in the squared unit of `observed`
    """
    weight = 1.0 / np.sqrt(variance)
    size = root.right.size
    stacked = np.empty((size + weight.size, size + 1))
    stacked[:size, :size], stacked[:size, size] = root.factor, root.right
    stacked[size:, :size], stacked[size:, size] = columns * weight[:, None], observed * weight
    # QR of [U z; A/s b/s], with the standard errors s; below the diagonal: the vectors of the reflections
    reflected = np.linalg.qr(stacked, mode="raw")[0].T
    return Root(reflected[:size, :size] * _upper(size), reflected[:size, size].copy())


@cache
def _upper(size: int) -> Array:
    """Return (P, P), 1 on and above the diagonal, else 0."""
    return np.triu(np.ones((size, size)))


def forget(root: Root, columns: Array, keep: float) -> Root:
    """Return the state without a share 1 - keep of its information in the directions of some rows.

    root:    information about P parameters: triangle U and right-hand side z
    columns: (rows, P) coefficients of these rows
    keep:    share of the information that remains, 0 to 1

    Nothing is forgotten in directions that these rows do not measure, hence nothing while the machine is parked
    (SIFt-RLS, arXiv 2404.10844). With Q an orthonormal basis of U columns', U <- (I - (1 - sqrt(keep)) Q Q') U leaves
    the estimate unchanged."""
    vectors = root.factor @ columns.T
    basis, sigma, _ = np.linalg.svd(vectors, full_matrices=False)
    basis = basis[:, sigma > FORGETTING_RANK * max(float(sigma[0]), 1e-300)] if sigma[0] > 0.0 else basis[:, :0]
    lose = (1.0 - np.sqrt(keep)) * basis  # U <- U - (1 - sqrt(keep)) Q Q' U
    return Root(root.factor - lose @ (basis.T @ root.factor), root.right - lose @ (basis.T @ root.right))


def solution(root: Root) -> tuple[Array, Array]:
    """Return the least-squares estimate U^-1 z (P,) and its covariance (U'U)^-1 (P, P), from the information `root`.

    Raises numpy.linalg.LinAlgError while the information is singular."""
    inverse = np.linalg.inv(root.factor)
    return inverse @ root.right, inverse @ inverse.T


FORGETTING_RANK = 1e-6  # times the largest singular value: directions below it are not forgotten; chosen
