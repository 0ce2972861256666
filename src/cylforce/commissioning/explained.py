"""How much of each joint's torque the identified parameters explain, and how far they lie from the data sheet: what is
left unexplained, or explained by parameters that cannot be, comes from a wrong machine file or a wrong connection.

The limits come from `tools/studies/unexplained.py`."""

from typing import NamedTuple

import numpy as np

from cylforce.estimation.blocks import Factors, residual_squares
from cylforce.estimation.model import Model
from cylforce.signals.estimate import Array

NOTHING = 0.0  # share explained below which a constant torque would explain the recording better: refused
LITTLE = 0.98  # share explained below which there is a warning: six times what the worst machine in order (a real
# crane, 0.9969; simulated ones 0.9992) leaves unexplained
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
