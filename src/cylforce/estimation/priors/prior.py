"""What is known of parameters before anything is measured. A file of its own, so that the service, which has priors but
fits nothing, does without the least squares of `batch`."""

from typing import NamedTuple

from cylforce.signals.estimate import Array


class Prior(NamedTuple):
    """Prior knowledge of K parameters: `mean` (K,) and `covariance` (K, K)."""

    mean: Array
    covariance: Array
