"""Recursive least squares in square-root information form, with forgetting in the regressor's row space only.

The information R'R is kept as its triangular root: never indefinite, no covariance to wind up. With forgetting off it
equals batch least squares with the same weights and the prior as extra rows, to rounding.
"""

from typing import NamedTuple

import numpy as np

from cylforce.signals.estimate import Array


class Root(NamedTuple):
    """R (P, P) upper triangular and z (P,): R'R is the information, R values = z."""

    factor: Array
    right: Array


def nothing_known(size: int) -> Root:
    """No prior at all."""
    return Root(np.zeros((size, size)), np.zeros(size))


def known(mean: Array, standard_error: Array) -> Root:
    """Independent priors."""
    return Root(np.diag(1.0 / standard_error), mean / standard_error)


def update(root: Root, columns: Array, observed: Array, variance: Array) -> Root:
    """Take in rows `observed` (R,) = columns (R, P) @ values with `variance` (R,); infinite variance: no
    information."""
    weight = 1.0 / np.sqrt(variance)
    size = root.right.size
    stacked = np.empty((size + weight.size, size + 1))
    stacked[:size, :size], stacked[:size, size] = root.factor, root.right
    stacked[size:, :size], stacked[size:, size] = columns * weight[:, None], observed * weight
    triangle = np.asarray(np.linalg.qr(stacked, mode="r"))
    return Root(triangle[:size, :size], triangle[:size, size])


def forget(root: Root, columns: Array, keep: float) -> Root:
    """Lose the share 1 - `keep` of the information about what `columns` (R, P) see, and of nothing else: parked or
    unexcited, nothing is forgotten (SIFt-RLS, arXiv 2404.10844).

    With Q an orthonormal basis of R columns', R <- (I - (1 - sqrt(keep)) Q Q') R leaves the estimate as it is."""
    seen = root.factor @ columns.T
    basis, size, _ = np.linalg.svd(seen, full_matrices=False)
    basis = basis[:, size > FORGETTING_RANK * max(float(size[0]), 1e-300)] if size[0] > 0.0 else basis[:, :0]
    lose = (1.0 - np.sqrt(keep)) * basis
    return Root(root.factor - lose @ (basis.T @ root.factor), root.right - lose @ (basis.T @ root.right))


def solution(root: Root) -> tuple[Array, Array]:
    """The estimate (P,) and its covariance (R'R)^-1 (P, P); raises numpy.linalg.LinAlgError while the information is
    singular."""
    inverse = np.linalg.inv(root.factor)
    return inverse @ root.right, inverse @ inverse.T


FORGETTING_RANK = 1e-6
