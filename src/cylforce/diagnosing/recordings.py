"""Recordings as the diagnosis takes them."""

from dataclasses import dataclass

import numpy as np

from cylforce.signals.estimate import Array


@dataclass(frozen=True)
class Recording:
    """A gapless stretch of a recording.

    name:     of the file
    values:   (T, S) samples of all signals at the service's rate, SI units
    load_kg:  known load in the bucket [kg]; 0: empty
    begins_s: time of its first sample since the start of the file [s]
    """

    name: str
    values: Array
    load_kg: float = 0.0
    begins_s: float = 0.0

    def times(self, rate_hz: float) -> Array:
        """Return the times (T,) [s] of the samples since the start of the file."""
        return np.asarray(self.begins_s + np.arange(len(self.values)) / rate_hz)
