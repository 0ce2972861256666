"""Recordings as the readings and the diagnosis take them, and their rows at 20 Hz for a model without a fault."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cylforce.estimation.channels import Moved
from cylforce.estimation.filters import Filter, second_order
from cylforce.estimation.model import Model
from cylforce.estimation.observation import REST_SHARE, unusable
from cylforce.readings.constants import ROWS_HZ
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


def names_of(recordings: Sequence[Recording]) -> list[str]:
    """Return the names of the files, each once, in their order."""
    return list(dict.fromkeys(recording.name for recording in recordings))


def samples_of(recordings: Sequence[Recording], name: str) -> Array:
    """Return the samples (T, S) of all stretches of one file."""
    return np.concatenate([recording.values for recording in recordings if recording.name == name])


@dataclass(frozen=True)
class SlowRows:
    """Rows of one model at ROWS_HZ, after the low-pass that the service applies first.

    model: the model at the service's rate
    """

    model: Model

    @cached_property
    def _every(self) -> int:
        return max(round(self.model.filters.rate_hz / ROWS_HZ), 1)

    @cached_property
    def slow(self) -> Model:
        """The model at the rate of the rows."""
        filters = self.model.filters._replace(rate_hz=self.model.filters.rate_hz / self._every)
        return Model(self.model.machine, filters, self.model.friction, self.model.usual)

    @cached_property
    def _low_pass(self) -> Filter:
        return second_order(self.model.filters.channel_hz, 1.0 / self.model.filters.rate_hz)

    def thinned(self, values: Array) -> Array:
        """Return samples (T', S) at the rate of the rows, low-passed, of samples (T, S)."""
        low = self._low_pass
        return np.asarray(low.run(low.steady(values[0]), values)[1][:: self._every])

    def moved(self, recording: Recording) -> Moved:
        """Return the motion of a recording."""
        return self.slow.channels.run(self.thinned(recording.values))

    def times(self, recording: Recording, count: int) -> Array:
        """Return the times (count,) [s] of the rows of a motion: the middle of four samples."""
        return np.asarray(recording.begins_s + (np.arange(count) - 0.5) / self.slow.filters.rate_hz)

    def residual(self, recording: Recording, parameters: Array) -> Array:
        """Return the residual torque (T', R) [N m] with parameters (P,); NaN where a row is not usable."""
        moved = self.moved(recording)
        rows = self.slow.filtered.run(moved.motion)
        residual = rows.torque - rows.columns[..., : len(parameters)] @ parameters
        lost = np.logical_or(unusable(self.slow, moved), self.slow.share_at_rest(rows.columns) > REST_SHARE)
        return np.asarray(np.where(lost, np.nan, residual)[self.slow.settle_steps :])
