"""A machine's quantities over its recordings, with their standard errors, and by how much each recording differs from
the machine's earlier ones and from other machines of its type."""

from typing import NamedTuple

import numpy as np

from cylforce.fleet.gaussians import Belonging, loosened, solved
from cylforce.fleet.usual import Usual
from cylforce.signals.estimate import Array

RIDGE = 1e-9  # of a quantity's usual daily difference: information about what a recording does not move at all


class Course(NamedTuple):
    """n recordings of one machine. `own` (n, K) and `own_error`: by this recording, with what is usual for the type;
    `value` and `error`: with the machine's earlier recordings, too. `expected` (n, K): by the earlier recordings alone.
    `from_past` and `from_type` (n,): the recording's difference from what the earlier ones, and what other machines
    show, rms over its quantities in usual differences: about 1 where it is in order; NaN where there is nothing
    earlier."""

    own: Array
    own_error: Array
    value: Array
    error: Array
    expected: Array
    from_past: Array
    from_type: Array


def course(days: Belonging, usual: Usual, past: Array, whole: Array) -> Course:
    """The course of one machine's recordings `days` (n,) in order of time; `past` (n,): the first recording that counts
    as earlier (after a change, what was before is none); `whole` (K, K'): the quantities that are told, as sums of
    those that are estimated."""
    information, pull = loosened(days.information, days.pull, usual.days**2)
    earlier = [slice(int(first), k) for k, first in enumerate(past)]
    precision = np.array([information[each].sum(axis=0) for each in earlier]) + np.diag(usual.between**-2.0)
    weighted = np.array([pull[each].sum(axis=0) for each in earlier]) + usual.between**-2.0 * usual.mean
    expected, covariance = solved(precision, weighted)
    own, own_error, from_type = _updated(days, usual.mean, np.diag(usual.between**2 + usual.days**2), whole)
    value, error, from_past = _updated(days, expected, covariance + np.diag(usual.days**2), whole)
    from_past = np.where(np.arange(len(past)) > past, from_past, np.nan)
    return Course(own, own_error, value, error, expected @ whole.T, from_past, from_type)


def _updated(days: Belonging, mean: Array, covariance: Array, whole: Array) -> tuple[Array, Array, Array]:
    """Means and standard errors (n, K) of what N(mean, covariance) and each recording tell together of the `whole`
    (K, K'), and the distance (n,) of what the recording finds from the former, rms over the quantities."""
    size = days.pull.shape[-1]
    joined = np.linalg.solve(
        np.eye(size) + covariance @ days.information, np.broadcast_to(covariance, days.information.shape)
    )
    force = days.pull - (days.information @ np.broadcast_to(mean, days.pull.shape)[..., None])[..., 0]
    moved = (joined @ force[..., None])[..., 0]
    error = np.sqrt(np.maximum(np.sum((whole @ joined) * whole, axis=-1), 0.0))
    away = np.linalg.solve(days.information + RIDGE * np.eye(size), force[..., None])[..., 0]
    # (S^-1 + P)^-1 of the difference S^-1 f is f - S (S + P^-1)^-1 f
    square = np.sum(force * (away - moved), axis=-1)
    return (mean + moved) @ whole.T, error, np.sqrt(np.maximum(square, 0.0) / size)
