"""From samples to filtered rows, one fixed step at a time; the same numbers as `observation.observe` from a
recording."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cylforce.estimation.channels import Moved
from cylforce.estimation.fast import Fast, Instant
from cylforce.estimation.model import Model
from cylforce.estimation.regressor import Rows
from cylforce.signals.estimate import Array


class Pipe(NamedTuple):
    """State of the filters: last channels `raw` (D,), state of the low-pass and its last three outputs `smooth` (3, D),
    state `filters` of the regressor's filters (None before the first step), number of `steps`; `waiting` (R,): steps
    for which each row is not used, because its filters still contain an unusable lever; cylinder `speed` (C,) [m/s];
    state `fast` of the filters of the force (None before the first step)."""

    raw: Array
    smooth_state: Array
    smooth: Array
    filters: Array | None
    steps: int
    waiting: Array
    speed: Array
    fast: Fast | None = None


@dataclass(frozen=True)
class Pipeline:
    """The filters of a model, step by step."""

    model: Model

    def begin(self, channels: Array) -> Pipe:
        """The state after the first channels (D,) at the start or after a gap, settled at them."""
        state, smooth = self.model.channels.smooth.step(self.model.channels.smooth.steady(channels), channels)
        rows, cylinders = len(self.model.machine.rows), len(self.model.machine.cylinders)
        return Pipe(
            channels, state, np.stack([smooth] * 3), None, 0, np.zeros(rows, dtype=np.int64), np.zeros(cylinders)
        )

    def advance(self, pipe: Pipe, channels: Array, periods: int) -> tuple[Pipe, Rows, Instant]:
        """The state, the rows and those of the instant `periods` >= 1 steps later, at `channels` (D,); missing steps
        are filled by linear interpolation."""
        first, here = pipe.raw, self.model.channels.follow(pipe.raw, channels)
        for k in range(1, periods):
            pipe, *_ = self.advance(pipe, first + (here - first) * (k / periods), 1)
        smooth_state, smooth = self.model.channels.smooth.step(pipe.smooth_state, here)
        four = np.concatenate([pipe.smooth, smooth[None]])
        moved = self.model.channels.between(four)
        filters = self.model.filtered.begin(moved.motion) if pipe.filters is None else pipe.filters
        momentum, static = self.model.filtered.inputs(moved.motion)
        filters, rows = self.model.filtered.advance(filters, momentum, static)
        fast, instant = self._instant(pipe.fast, momentum, static, moved, here)
        waiting = np.where(self._rows_usable(moved), np.maximum(pipe.waiting - 1, 0), self.model.settle_steps)
        new = Pipe(here, smooth_state, four[1:], filters, pipe.steps + 1, waiting, moved.motion.speed, fast)
        return new, rows, instant

    def _instant(
        self, fast: Fast | None, momentum: Array, static: Array, moved: Moved, channels: Array
    ) -> tuple[Fast, Instant]:
        forces = channels[self.model.channels.forces]
        fast = self.model.fast.begin(momentum, moved.motion, forces) if fast is None else fast
        return self.model.fast.step(fast, momentum, static[..., :-1], moved.motion, forces)

    def _rows_usable(self, moved: Moved) -> Array:
        usable = moved.usable.tolist()
        return np.array([all(usable[c] for c in acting) for acting in self.model.acting])
