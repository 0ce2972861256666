"""Prior of parameters. It is in a file of its own, so that the service, which has priors but fits nothing, does without
the least squares of `batch`."""

from typing import NamedTuple

from cylforce.signals.estimate import Array


class Prior(NamedTuple):
    """Prior knowledge of K parameters.

    mean:       (K,) prior means
    covariance: (K, K) prior covariance
    """

    mean: Array
    covariance: Array
