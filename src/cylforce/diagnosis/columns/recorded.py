"""Recordings as they are given to the diagnosis, and as rows of a linear problem."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.sensitivity import Sensitivity
from cylforce.signals.estimate import Array


class Recorded(NamedTuple):
    """A gapless recording: its `name`, samples `values` (T, S) at the service's rate, the known `load` [kg] in the
    bucket (0: empty), the time [s] at which it `begins`; which of its rows (T',) count, None: all."""

    name: str
    values: Array
    load: float
    begins: float = 0.0
    counts: NDArray[np.bool_] | None = None


class RecordedRun(NamedTuple):
    """A recording, the tares (P,) of the machine with what it carries there, how its rows change then, and the rate
    `turning` (T',) [rad/s] of its base."""

    recorded: Recorded
    tares: Array
    change: Sensitivity
    turning: Array


Columns = NDArray[np.float32] | NDArray[np.float64]


class GapRows(NamedTuple):
    """A recording's rows: `base` (T, R, P) columns of the model, `effects` (T, R, E) of the proposals, `incidental`
    (T, R, I) columns of incidents (see `INCIDENTAL`, `TORQUES`), `left` (T, R) [N m] what the tares leave, NaN where
    not usable, `rockers` (T, R, K) columns of linkages' bars, `t` (T,) [s], `speed`, `force` (T, C), `posture` (T, N),
    `turning` (T,) [rad/s] of the base."""

    base: Array
    effects: Columns
    incidental: Columns
    left: Array
    rockers: Array
    t: Array
    speed: Array
    force: Array
    posture: Array
    turning: Array

    @property
    def slim(self) -> "GapRows":
        """The same, with the hundreds of columns of effects in single precision, and in half the memory."""
        return self._replace(effects=self.effects.astype(np.float32), incidental=self.incidental.astype(np.float32))
