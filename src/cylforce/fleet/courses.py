"""A machine's quantities over its recordings with standard errors, and how unusual each recording is.

A recording is compared with the machine's earlier recordings and with other machines of its type.
"""

from typing import NamedTuple

import numpy as np

from cylforce.fleet.gaussians import GroupedGaussians, solved, with_added_variance
from cylforce.fleet.usual import Usual
from cylforce.signals.estimate import Array

RIDGE = 1e-9  # information about a quantity that a recording does not show, in units of the day-to-day spread


class Course(NamedTuple):
    """Course of n recordings of one machine with K quantities.

    own: (n, K) values from this recording, with the usual spreads of the type
    own_error: (n, K) their standard errors
    value: (n, K) values from this and the machine's earlier recordings
    error: (n, K) their standard errors
    expected: (n, K) values from the earlier recordings alone
    from_past: (n,) difference from the earlier recordings, rms over the quantities in usual differences: about 1 for a
        healthy machine; NaN without earlier recordings
    from_type: (n,) difference from other machines of the type, likewise
    """

    own: Array
    own_error: Array
    value: Array
    error: Array
    expected: Array
    from_past: Array
    from_type: Array


def course(days: GroupedGaussians, usual: Usual, past: Array, whole: Array) -> Course:
    """Return the course of one machine's recordings in order of time.

    days: information of each recording about its day
    usual: usual spreads of the type
    past: (n,) number of the first recording that counts as earlier; after a change, those before do not
    whole: (K, K') matrix from the K' estimated quantities to the K quantities of the course
    """
    information, pull = with_added_variance(days.information, days.pull, usual.days**2)
    earlier = [slice(int(first), k) for k, first in enumerate(past)]
    precision = np.array([information[span].sum(axis=0) for span in earlier]) + np.diag(usual.between**-2.0)
    weighted = np.array([pull[span].sum(axis=0) for span in earlier]) + usual.between**-2.0 * usual.mean
    expected, covariance = solved(precision, weighted)
    own, own_error, from_type = _updated(days, usual.mean, np.diag(usual.between**2 + usual.days**2), whole)
    value, error, from_past = _updated(days, expected, covariance + np.diag(usual.days**2), whole)
    from_past = np.where(np.arange(len(past)) > past, from_past, np.nan)
    return Course(
        own=own,
        own_error=own_error,
        value=value,
        error=error,
        expected=expected @ whole.T,
        from_past=from_past,
        from_type=from_type,
    )


def _updated(days: GroupedGaussians, mean: Array, covariance: Array, whole: Array) -> tuple[Array, Array, Array]:
    """Combine a prior N(mean, covariance) with each recording.

    Return means and standard errors (n, K) of the combination, and the distance (n,) of each recording's own value from
    the prior, rms over the quantities.
    """
    size = days.pull.shape[-1]
    joined = np.linalg.solve(
        np.eye(size) + covariance @ days.information, np.broadcast_to(covariance, days.information.shape)
    )
    force = days.pull - (days.information @ np.broadcast_to(mean, days.pull.shape)[..., None])[..., 0]
    shift = (joined @ force[..., None])[..., 0]
    error = np.sqrt(np.maximum(np.sum((whole @ joined) * whole, axis=-1), 0.0))
    undamped = np.linalg.solve(days.information + RIDGE * np.eye(size), force[..., None])[..., 0]
    # (S^-1 + P)^-1 of the difference S^-1 f is f - S (S + P^-1)^-1 f
    square = np.sum(force * (undamped - shift), axis=-1)
    return (mean + shift) @ whole.T, error, np.sqrt(np.maximum(square, 0.0) / size)
