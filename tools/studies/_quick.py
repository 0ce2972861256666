"""The service over a recording that is known as a whole: the same steps, but the filtered rows are computed for all
samples at once, forces are not, no sensor is suspected, and it is not asked whose machine it is. A fifth of the time of
a replay, the same bookings but for what errors that nobody notices add (a test compares them)."""

from array import array
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.kernel.inputs import NEVER
from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.service.contact.interaction import ForceEstimator, Forces
from cylforce.service.core import Core
from cylforce.service.memory import NOTHING_KEPT, Memory
from cylforce.service.pipeline import Instant
from cylforce.service.plausibility.monitor import Monitor
from cylforce.service.plausibility.sample import MonitorSample
from cylforce.service.recognition import Recognizer
from cylforce.service.residual import InstantResidual
from cylforce.service.service import WeighingService
from cylforce.signals.estimate import Array, Reason, Sample, invalid_force
from cylforce.signals.events import Frame


class Recorded:
    """In place of frames, filters and what these need: gapless samples `values` (T, S) from tick `first` on, and their
    rows."""

    arrivals_us: Numbers = array("d")
    long_us = NEVER

    def __init__(self, core: Core, values: Array, first: int) -> None:
        self._core, self._values, self._first, self._k = core, values, first, 0
        self._fine = (Reason.NONE,) * values.shape[1]
        self._layout = core.pipeline.rows
        model = core.model
        moved = model.channels.run(values)
        self._rows, self._speed = model.filtered.run(moved.motion), moved.motion.speed
        self._channels = model.channels.read(values)
        usable = np.stack([moved.usable[:, list(acting)].all(axis=1) for acting in model.acting], axis=-1)
        ago = _since(~usable)
        self._waiting = np.maximum(model.settle_steps - ago, 0)
        self.steps = 0
        self.state: Numbers | None = None

    def receive(self, frames: Sequence[Frame], moving: Numbers) -> None:
        """As the assembler: there are no frames."""

    def spoofed(self, t_us: int) -> bool:
        """As the assembler: there are no frames."""
        del t_us
        return False

    def sample(self, t_us: int) -> Sample:
        """As the assembler: the recorded one."""
        self._k = t_us // self._core.period_us - self._first
        return Sample(t_us, array("d", self._values[self._k].tolist()), self._fine, Reason.NONE)

    def read(self, values: Numbers) -> Numbers:
        """As the constants of the pipeline: the channels of the last sample."""
        del values
        return numbers(self._channels[self._k])

    def moving(self, speed: Numbers) -> Numbers:
        """As the constants of the pipeline: no signal is looked at whether it is frozen."""
        del speed
        return array("d")

    def stop(self) -> None:
        """As the pipeline."""
        self.steps, self.state = 0, None

    def begin(self, channels: Numbers) -> None:
        """As the pipeline."""
        self.steps, self.state = 0, channels

    def update(self, channels: Numbers, periods: int = 1) -> Instant:
        """As the pipeline: the rows of the last sample."""
        del periods, channels
        self.steps += 1
        k = self._k - 1
        rows = numbers(np.append(self._rows.columns[k].ravel(), self._rows.torque[k]))
        usable = numbers(self._waiting[k] == 0.0)
        return Instant(rows, self._layout, 0j, 0j, usable, numbers(self._speed[k]))


class _Known(Recognizer):
    """In place of the recognition: it is this machine."""

    __slots__ = ()

    def update(self, residual: InstantResidual, usable: Numbers) -> None:
        """Learn nothing."""


class _NoForces(ForceEstimator):
    """In place of the forces: none is known."""

    __slots__ = ()

    def update(self, *rest: object) -> Forces:  # none of it is used
        """Return none."""
        del rest
        nothing = invalid_force(Reason.STARTING)
        return Forces(nothing, nothing)


class _Trusting(Monitor):
    """In place of the monitor: no sensor is suspected."""

    __slots__ = ()

    def update(self, now: MonitorSample) -> None:
        """Suspect nothing."""


def _since(marks: NDArray[np.bool_]) -> Array:
    """How many rows ago (T, R) a mark was set; very many where none was."""
    t = np.arange(len(marks))[:, None]
    last = np.maximum.accumulate(np.where(marks, t, -(10**6)), axis=0)
    return np.asarray(t - last)


def served(core: Core, values: Array, first: int = 1, kept: Memory = NOTHING_KEPT) -> Iterator[WeighingService]:
    """The service after each of the samples (T, S), the first of which is that of tick number `first`: one object,
    which the next step changes. It starts with what was `kept`."""
    quick = Core(core.service, core.tares)
    recorded = Recorded(quick, values, first)
    service = WeighingService.start(quick, kept)
    service.recognizer = _Known.start(quick.recognizer)
    service.force = _NoForces.start(quick.force)
    service.monitor = _Trusting.start(quick.monitor)
    quick.pipeline = service.pipeline = service.inputs = recorded  # type: ignore[assignment]  # in place of three
    for k in range(len(values)):
        service.on_tick((first + k) * core.period_us)
        yield service
