"""Share of each joint's torque that the identified parameters explain, and their distance from the data sheet.

Torque that is unexplained, or explained by implausible parameters, comes from a wrong machine file or a wrong
connection. The limits come from `tools/studies/unexplained.py`.
"""

from typing import NamedTuple

import numpy as np

from cylforce.commissioning.emptiness import CORRELATED
from cylforce.estimation.batch import converged
from cylforce.estimation.blocks import Factors, of_row, residual_squares
from cylforce.estimation.model import Model
from cylforce.estimation.priors.prior import Prior
from cylforce.signals.estimate import Array

NOTHING = 0.0  # share explained below which a constant torque would explain the recording better: refused
# Share explained below which there is a warning: six times the unexplained share of the worst healthy machine (a real
# crane, 0.9969; simulated ones 0.9992).
LITTLE = 0.98
# Share explained below which there is a warning when a single correction explains decisively more: three times the
# unexplained share of that machine; joints that turn by a few degrees only reach it, too.
DOUBTFUL = 0.99
FAR = 5.0  # squared distance from the data sheet per base parameter, in its variances: healthy machines stay below 3
MOVED = np.radians(5.0)  # rad, motion of a joint between two blocks from which on its torque should be usable; chosen


class Quality(NamedTuple):
    """Quality of a fit of the empty machine.

    explained: (R,) share of each joint's torque that is explained; NaN where no row was fitted
    distance: squared distance from the data sheet per base parameter, in its variances
    farthest: name of the base parameter that differs most from the data sheet, and its difference in standard errors
    unseen: (R,) joints that moved, but never with a usable cylinder
    """

    explained: Array
    distance: float
    farthest: tuple[str, float]
    unseen: tuple[bool, ...]


def quality(model: Model, fitted: Factors, values: Array, covariance: Array) -> Quality:
    """Return the quality of a fit.

    fitted: factors of the recording
    values, covariance: (P,) parameters and their covariance (P, P)
    """
    size = 3 * model.machine.size
    difference = (values - model.prior.mean)[:size]
    spread = (model.prior.covariance + covariance)[:size, :size]
    errors = difference / np.sqrt(np.diag(spread))
    most = int(np.argmax(np.abs(errors)))
    return Quality(
        explained=explained(model, fitted, values),
        distance=float(difference @ np.linalg.solve(spread, difference)) / size,
        farthest=(model.parameters[most].name, float(errors[most])),
        unseen=unseen(model, fitted),
    )


def explained(model: Model, fitted: Factors, values: Array) -> Array:
    """Return the share of each measured joint's torque (R,) that parameters explain.

    1 - (squared residuals) / (squares of the torque about its mean): 1 is all, 0 is the share of a constant torque,
    NaN where no row was fitted.

    fitted: factors of the recording
    values: (P,) parameters
    """
    count = np.sum(fitted.samples, axis=0)
    rows = len(model.machine.rows)
    torque, share = fitted.mark[:, -2 * rows : -rows], fitted.mark[:, -rows:]
    total = np.sum(fitted.samples * torque / np.where(share > 0.0, share, 1.0), axis=0)
    squares = np.sum(fitted.triangle[..., -1] ** 2, axis=(0, 2)) - total**2 / np.maximum(count, 1.0)
    residual = np.sum(residual_squares(fitted, values), axis=0)
    return np.asarray(np.where(count > 0, 1.0 - residual / np.maximum(squares, 1e-9), np.nan))


def unseen(model: Model, fitted: Factors) -> tuple[bool, ...]:
    """Return per measured joint whether it moved, but had no usable cylinder in any block's mean posture.

    fitted: factors of the recording
    """
    posture = fitted.mark[:, : model.machine.size]
    usable_cylinders = model.channels.usable(model.machine.geometry(posture))
    has_rows = np.sum(fitted.samples + fitted.others, axis=0) > 0
    moved = np.ptp(posture, axis=0)[list(model.machine.rows)] > MOVED
    usable = [bool(np.any(np.all(usable_cylinders[:, acting], axis=1))) for acting in model.acting]
    return tuple(bool(m and not r and not u) for m, r, u in zip(moved, has_rows, usable, strict=True))


def criterion(model: Model, fitted: Factors, squares: Array, values: Array, added: int) -> float:
    """Return the Bayesian information criterion of an explanation; the smaller, the better.

    It is n ln(unexplained share of a joint's squared torque), summed over the joints, plus added ln(n) (Schwarz 1978,
    doi:10.1214/aos/1176344136), plus the squared distance of the masses from the data sheet in its variances. n is the
    number of independent samples: CORRELATED consecutive samples count as one.

    fitted: factors of the recording
    squares: (R,) sum of the squared residuals [N^2 m^2]
    values: parameters of the empty machine (P,); further ones after them are not used
    added: number of parameters beyond those of the empty machine
    """
    count, size = np.sum(fitted.samples, axis=0) / CORRELATED, 3 * model.machine.size
    torque = np.sum(fitted.triangle[..., -1] ** 2, axis=(0, 2))
    has_rows = count > 0.0
    share = np.maximum(squares[has_rows], 1e-9) / np.maximum(torque[has_rows], 1e-9)
    difference = values[:size] - model.prior.mean[:size]
    distance = float(difference @ np.linalg.solve(model.prior.covariance[:size, :size], difference))
    return float(count[has_rows] @ np.log(share)) + added * float(np.log(np.sum(count))) + distance


def row_noise(factors: Factors, prior: Prior) -> Array:
    """Return the rms residual (R,) [N m] of each measured torque fitted alone, used as the rows' standard errors.

    A torque without any fitted row gets the largest value of the others.

    Residuals of the common fit are not used: a row that fits well would get a larger weight, then fit still better, and
    dominate.

    factors: factors of a recording, for the P parameters of `prior` alone
    """
    rows = range(factors.samples.shape[1])
    alone = [_alone(factors, prior, r) if np.any(factors.samples[:, r]) else np.nan for r in rows]
    return np.asarray(np.where(np.isnan(alone), np.nanmax(alone), alone))


def _alone(factors: Factors, prior: Prior, r: int) -> float:
    """Return the rms residual [N m] of row r fitted without the others."""
    one = of_row(factors, r)
    size = np.sqrt(np.sum(one.triangle[..., -1] ** 2) / np.sum(one.samples))
    return float(converged(one, np.array([size + 1e-9]), prior).row_error[0] + 1e-6 * size + 1e-9)
