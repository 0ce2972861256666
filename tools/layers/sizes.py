"""The prior of an effect's size: log-uniform over what is plausible."""

from math import gamma, pi

import numpy as np
from numpy.typing import NDArray

from layers.statistics import Column

Array = NDArray[np.float64]
BEYOND = 1.3  # of the largest plausible size: the end of the range
FEWEST = 8  # draws that must be plausible for a mean of them
DRAWS = np.random.default_rng(0).standard_normal((1024, 6))  # of the integral over a size: the same for all
WIDE = 0.25  # prior precision of a size where the recording tells nothing, in units of half the largest plausible one


def axes_of(column: Column) -> int:
    """How many of its sizes are the axes of its magnitude."""
    return min(column.axes, len(column.columns))


def beside(column: Column) -> Array:
    """Prior precision (M,) of a proposal's sizes in units of their spread: of those beside its size proper."""
    return np.where(np.arange(len(column.columns)) < axes_of(column), 0.0, 1.0)


def log_size(column: Column, sizes: Array, covariance: Array) -> float:
    """Log of the prior density of a proposal's sizes (M,), averaged over their uncertainty: log-uniform in magnitude
    from the least to the largest plausible one, in any direction that the effect's sign allows."""
    axes = axes_of(column)
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
    density = float(_density(column, axes, wanted[None, :] * (1.0 + 1e-12))[0])
    density = density if np.isfinite(density) else float(_density(column, axes, wanted[None, :] * (1.0 - 1e-12))[0])
    return density - 0.5 * float(apart @ np.linalg.solve(covariance, apart))


def surface(axes: int) -> float:
    """Of the unit sphere; of one axis its two directions."""
    return float(2.0 * pi ** (axes / 2.0) / gamma(axes / 2.0))
