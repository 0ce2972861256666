"""How much of each joint's torque the identified parameters explain, and how far they lie from the data sheet: what is
left unexplained, or explained by parameters that cannot be, comes from a wrong machine file or a wrong connection.

The limits come from `tools/studies/unexplained.py`."""

from typing import NamedTuple

import numpy as np

from cylforce.commissioning.emptiness import CORRELATED
from cylforce.estimation.batch import least_squares
from cylforce.estimation.blocks import Factors, of_row, residual_squares
from cylforce.estimation.model import Model
from cylforce.estimation.priors.prior import Prior
from cylforce.signals.estimate import Array

NOTHING = 0.0  # share explained below which a constant torque would explain the recording better: refused
LITTLE = 0.98  # share explained below which there is a warning: six times what the worst machine in order (a real
# crane, 0.9969; simulated ones 0.9992) leaves unexplained
DOUBTFUL = 0.99  # share explained below which there is a warning when a single correction explains decisively more:
# three times what that machine leaves; joints that turn by a few degrees only come here, too
FAR = 5.0  # squared distance from the data sheet per base parameter, in its variances: machines in order stay below 3
MOVED = np.radians(5.0)  # of a joint between two blocks: from there on its torque should have been seen


class Quality(NamedTuple):
    """`explained` (R,): share of each joint's torque that is explained, NaN where no row was fitted; `distance` from
    the data sheet: squared, per base parameter, in its variances; `farthest`: the base parameter that differs most from
    the data sheet, and by how many of its standard errors; `unseen` (R,): joints that moved, but nowhere with a usable
    cylinder."""

    explained: Array
    distance: float
    farthest: tuple[str, float]
    unseen: tuple[bool, ...]


def quality(model: Model, fitted: Factors, values: Array, covariance: Array) -> Quality:
    """How well parameters `values` (P,) of `covariance` (P, P) explain the recording of which `fitted` are the
    factors."""
    size = 3 * model.machine.size
    away = (values - model.prior.mean)[:size]
    spread = (model.prior.covariance + covariance)[:size, :size]
    each = away / np.sqrt(np.diag(spread))
    most = int(np.argmax(np.abs(each)))
    farthest = (model.parameters[most].name, float(each[most]))
    distance = float(away @ np.linalg.solve(spread, away)) / size
    return Quality(explained(model, fitted, values), distance, farthest, unseen(model, fitted))


def explained(model: Model, fitted: Factors, values: Array) -> Array:
    """1 - (squares of what `values` (P,) leave of a joint's torque) / (squares of that torque about its mean), per
    measured joint (R,): 1 is all, 0 is what a constant torque explains, NaN where no row was fitted."""
    count = np.sum(fitted.samples, axis=0)
    rows = len(model.machine.rows)
    torque, share = fitted.mark[:, -2 * rows : -rows], fitted.mark[:, -rows:]
    total = np.sum(fitted.samples * torque / np.where(share > 0.0, share, 1.0), axis=0)
    squares = np.sum(fitted.triangle[..., -1] ** 2, axis=(0, 2)) - total**2 / np.maximum(count, 1.0)
    left = np.sum(residual_squares(fitted, values), axis=0)
    return np.asarray(np.where(count > 0, 1.0 - left / np.maximum(squares, 1e-9), np.nan))


def unseen(model: Model, fitted: Factors) -> tuple[bool, ...]:
    """Per measured joint whether it moved, but had no usable cylinder in any block's mean posture."""
    posture = fitted.mark[:, : model.machine.size]
    good = model.channels.usable(model.machine.geometry(posture))
    seen = np.sum(fitted.samples + fitted.others, axis=0) > 0
    moved = np.ptp(posture, axis=0)[list(model.machine.rows)] > MOVED
    usable = [bool(np.any(np.all(good[:, acting], axis=1))) for acting in model.acting]
    return tuple(bool(m and not s and not u) for m, s, u in zip(moved, seen, usable, strict=True))


def criterion(model: Model, fitted: Factors, squares: Array, values: Array, added: int) -> float:
    """Bayesian information criterion of an explanation with `added` parameters beyond those of the empty machine
    (Schwarz 1978, doi:10.1214/aos/1176344136): n ln(share of a joint's squared torque that is left), summed over the
    joints, plus added ln(n), plus the squared distance of the masses from the data sheet in its variances; the smaller,
    the better. n: independent samples, of which CORRELATED consecutive samples make one. `squares` (R,) [N^2 m^2]: what
    is left, with `values` (P, ...), of the samples of `fitted`."""
    count, size = np.sum(fitted.samples, axis=0) / CORRELATED, 3 * model.machine.size
    torque = np.sum(fitted.triangle[..., -1] ** 2, axis=(0, 2))
    seen = count > 0.0
    share = np.maximum(squares[seen], 1e-9) / np.maximum(torque[seen], 1e-9)
    away = values[:size] - model.prior.mean[:size]
    distance = float(away @ np.linalg.solve(model.prior.covariance[:size, :size], away))
    return float(count[seen] @ np.log(share)) + added * float(np.log(np.sum(count))) + distance


def row_noise(factors: Factors, prior: Prior) -> Array:
    """Rms residual (R,) [N m] of each measured torque fitted alone, used as the rows' standard errors. Residuals of the
    common fit are not used: a row that fits well would get a larger weight, then fit still better, and dominate."""
    rows = range(factors.samples.shape[1])
    alone = [_alone(factors, prior, r) if np.any(factors.samples[:, r]) else np.nan for r in rows]
    return np.asarray(np.where(np.isnan(alone), np.nanmax(alone), alone))


def _alone(factors: Factors, prior: Prior, r: int) -> float:
    one = of_row(factors, r)
    size = np.sqrt(np.sum(one.triangle[..., -1] ** 2) / np.sum(one.samples))
    return float(least_squares(one, np.array([size + 1e-9]), prior).row_error[0] + 1e-6 * size + 1e-9)
