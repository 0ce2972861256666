"""What may be there and how large: columns of a recording's rows, and the prior of an effect's size, log-uniform over
what is plausible."""

from math import gamma, pi
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from cylforce.effects.fault import BEYOND
from cylforce.signals.estimate import Array

FEWEST = 8  # draws that must be plausible for a mean of them
AXES = 6  # of a magnitude, at most
WIDE = 0.25  # prior precision of a size where the recording tells nothing, in units of half the largest plausible one


class Column(NamedTuple):
    """One form of an effect at a place: its columns, the plausible range of its size, its sign (0: either), how many of
    its sizes are the axes of the magnitude; `reads`: whether it is an error of readings or of geometry; `form`: share
    of a size by which its law is only approximate."""

    name: str
    at: str
    columns: tuple[int, ...]
    low: float
    high: float
    sign: int
    axes: int
    reads: bool = False
    form: float = 0.0
    expected: bool = False  # whether it is there as probably as not: what a data sheet does not know

    @property
    def measured(self) -> int:
        """How many of its sizes are the axes of its magnitude."""
        return min(self.axes, len(self.columns))


class Terms(NamedTuple):
    """What all recordings of a machine have in common: standard errors of all columns' sizes, `always` (K,) as part of
    the machine and `spread` (K,) as an effect; `forms`: all that may be the cause; how many columns are the machine's
    own, `first`."""

    always: Array
    spread: Array
    forms: tuple[Column, ...]
    first: int


class Fitted(NamedTuple):
    """Sizes (M,) of forms beyond those taken out already, `more`, all of them, `sizes`, their covariance (M, M) [of the
    prior spread], and the evidence that they `gain`, integrated over their uncertainty; `doubt`: by how much no such
    size is more probable because noise in column and residual is not told exactly (less than 0 of a small score)
    [nats]."""

    more: Array
    sizes: Array
    covariance: Array
    gain: float
    doubt: float


class Marginal(NamedTuple):
    """A recording under a noise: its information (K, K), the covariance (K, K) and the sizes (K,) of the nuisances that
    follow, the marginal score (K,) of sizes and samples (S, K) of what is not known of it beyond the noise, whose
    products add up to a covariance, and the log likelihood without any."""

    known: Array
    covariance: Array
    fitted: Array
    score: Array
    vague: Array
    log: float

    def gain(self, own: list[int]) -> Array:
        """How the nuisances follow sizes (K, M) of some columns."""
        return self.covariance @ self.known[:, own]

    def information(self, own: list[int]) -> Array:
        """Marginal information (M, M) of the sizes of some columns."""
        return self.known[np.ix_(own, own)] - self.known[own] @ self.gain(own)


def _draws(count: int) -> Array:
    """Points (count, AXES) of a standard normal distribution, evenly spread (Kronecker sequence; Roberts 2018)."""
    golden = 2.0
    for _ in range(50):
        golden = (1.0 + golden) ** (1.0 / (AXES + 1.0))
    steps = golden ** -(1.0 + np.arange(AXES))
    return np.asarray(ndtri((0.5 + np.outer(1.0 + np.arange(count), steps)) % 1.0))


DRAWS = _draws(1024)


def beside(column: Column) -> Array:
    """Prior precision (M,) of a form's sizes in units of their spread: of those beside its size proper."""
    return np.where(np.arange(len(column.columns)) < column.measured, 0.0, 1.0)


def log_size(column: Column, sizes: Array, covariance: Array) -> float:
    """Log of the prior density of a form's sizes (M,), averaged over their uncertainty: log-uniform in magnitude from
    the least to the largest plausible one, in any direction that the effect's sign allows."""
    axes = column.measured
    root = np.linalg.cholesky(covariance[:axes, :axes] + 1e-300 * np.eye(axes))
    drawn = sizes[:axes] + DRAWS[:, :axes] @ root.T
    inside = np.exp(_density(column, axes, drawn))
    if np.count_nonzero(inside) >= FEWEST:
        return float(np.log(np.mean(inside)))
    return _outside(column, axes, sizes[:axes], covariance[:axes, :axes])


def _density(column: Column, axes: int, sizes: Array) -> Array:
    """Log density (D,) at sizes (D, axes)."""
    magnitude = np.linalg.norm(sizes, axis=1)
    plausible = (magnitude >= column.low) & (magnitude <= BEYOND * column.high)
    plausible &= (column.sign == 0) | (axes > 1) | (column.sign * sizes[:, 0] > 0.0)
    whole = np.log(BEYOND * column.high / column.low) * (1.0 if column.sign and axes == 1 else surface(axes))
    return np.where(plausible, -axes * np.log(np.maximum(magnitude, 1e-300)) - np.log(whole), -np.inf)


def _outside(column: Column, axes: int, sizes: Array, covariance: Array) -> float:
    """The same where hardly any draw is plausible: the density at the nearest plausible size, less how improbable
    that is."""
    magnitude = float(np.linalg.norm(sizes))
    nearest = float(np.clip(magnitude, column.low, BEYOND * column.high))
    sign = column.sign if column.sign and axes == 1 else 0
    wanted = np.array([sign * nearest]) if sign else sizes * (nearest / max(magnitude, 1e-300))
    apart = wanted - sizes
    density = -axes * float(np.log(nearest)) - float(np.log(np.log(BEYOND * column.high / column.low) * surface(axes)))
    return density - 0.5 * float(apart @ np.linalg.solve(covariance, apart))


def plausible(column: Column, sizes: Array) -> Array:
    """Sizes (M,), no larger than any plausible one, in proportion: where they are uncertain, the likeliest may be."""
    largest = BEYOND * column.high * (1.0 - 1e-9)  # whatever is rounded
    return np.asarray(sizes * min(largest / max(float(np.linalg.norm(sizes[: column.measured])), 1e-300), 1.0))


def surface(axes: int) -> float:
    """Of the unit sphere; of one axis its two directions."""
    return float(2.0 * pi ** (axes / 2.0) / gamma(axes / 2.0))


def positive(matrix: Array) -> Array:
    """The nearest matrix (..., M, M) that is symmetric and not negative: differences of large ones may be neither."""
    values, vectors = np.linalg.eigh((matrix + np.swapaxes(matrix, -1, -2)) / 2.0)
    return np.asarray((vectors * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(vectors, -1, -2))
