"""From samples to filtered rows, one fixed step at a time; the same numbers as `observation.observe` from a
recording. The arithmetic is the kernel's (estimation/kernel/README.md)."""

from array import array
from dataclasses import dataclass, field
from functools import cached_property
from math import prod
from typing import Any, NamedTuple

import numpy as np

from cylforce.estimation.kernel import choice, making
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.estimation.model import Model
from cylforce.estimation.regressor import Rows
from cylforce.signals.estimate import Array


class Pipe(NamedTuple):
    """State of the filters: last channels `raw` (D,), last three outputs `smooth` (3, D) of their low-pass, number of
    `steps`; `waiting` (R,): steps for which each row is not used, because its filters still contain an unusable lever;
    cylinder `speed` (C,) [m/s]; all of them and the state of every filter as the kernel keeps it, `kept`."""

    raw: Array
    smooth: Array
    steps: int
    waiting: Array
    speed: Array
    kept: Numbers


class Instant(NamedTuple):
    """What the kernel knows of this instant, all rows of a step (`kernel/rows.py`) as it keeps them; numbers R of rows,
    K of columns, C of cylinders; cylinder `speed` (C,) [m/s]; position `place` [m] of the tool from the first pin and
    its `velocity` [m/s], as x + i z."""

    kept: Numbers
    sizes: tuple[int, int, int]
    speed: Array
    place: complex
    velocity: complex

    @property
    def rows(self) -> Rows:
        """Columns (R, K) and torques (R,)."""
        r, k, _ = self.sizes
        begin = r * k + r
        return Rows(self._part(begin, (r, k)), self._part(begin + r * k, (r,)))

    @property
    def change(self) -> Array:
        """Time derivative (R, K) of the columns of inertia [1/s]."""
        r, k, _ = self.sizes
        return self._part(2 * (r * k + r), (r, k))

    @property
    def reversing(self) -> Array:
        """1 where a cylinder (C,) is about to turn round, else 0."""
        r, k, c = self.sizes
        return self._part(3 * r * k + 2 * r, (c,))

    def _part(self, begin: int, shape: tuple[int, ...]) -> Array:
        return np.frombuffer(self.kept)[begin : begin + prod(shape)].reshape(shape)


@dataclass(frozen=True)
class Pipeline:
    """The filters of a model, step by step."""

    model: Model
    kernel: Any = field(default_factory=lambda: choice.chosen())  # noqa: PLW0108 - asked when it is made

    @cached_property
    def _plan(self) -> Any:  # noqa: ANN401 - the compiled or the interpreted class
        return making.plan(self.model, self.kernel.KernelPlan)

    @cached_property
    def _sizes(self) -> tuple[int, int]:
        """Numbers of a state and of the rows of a step."""
        return self.kernel.state_size(self._plan), self.kernel.rows_size(self._plan)

    @cached_property
    def _places(self) -> "_Places":
        machine = self.model.machine
        channels = machine.size + len(machine.cylinders) + (6 if self.model.channels.inertial else 3)
        columns = len(self.model.filtered.regressor.names)
        return _Places(channels, len(machine.rows), columns, len(machine.cylinders))

    def begin(self, channels: Array) -> Pipe:
        """The state after the first channels (D,) at the start or after a gap, settled at them."""
        state, smooth = self.model.channels.smooth.step(self.model.channels.smooth.steady(channels), channels)
        kept = np.zeros(self._sizes[0])
        kept[: 6 * len(channels)] = np.concatenate([channels, *state, smooth, smooth, smooth])
        return self._places.state(array("d", kept.tobytes()), 0)

    def advance(self, pipe: Pipe, channels: Array, periods: int) -> tuple[Pipe, Rows, Instant]:
        """The state, the rows and those of the instant `periods` >= 1 steps later, at `channels` (D,); missing steps
        are filled by linear interpolation."""
        first, here = pipe.raw, self.model.channels.follow(pipe.raw, channels)
        for k in range(1, periods):
            pipe, *_ = self.advance(pipe, first + (here - first) * (k / periods), 1)
        state, rows = self._sizes
        new, out = ZERO * state, ZERO * rows
        old = pipe.kept if pipe.steps else array("d", pipe.kept)  # the kernel begins its filters there
        self.kernel.advance(self._plan, old, array("d", here.tobytes()), new, out, pipe.steps == 0)
        return self._places.state(new, pipe.steps + 1), *self._places.rows(out, new)


class _Places(NamedTuple):
    """Where the kernel's results stand: D channels, R rows, K columns, C cylinders."""

    d: int
    r: int
    k: int
    c: int

    def state(self, kept: Numbers, steps: int) -> Pipe:
        """The parts of a state."""
        whole, d = np.frombuffer(kept), self.d
        waiting = 6 * d + 3 * self.r * (self.k + 1)
        speed = waiting + self.r
        return Pipe(
            whole[:d],
            whole[3 * d : 6 * d].reshape(3, d),
            steps,
            whole[waiting:speed],
            whole[speed : speed + self.c],
            kept,
        )

    def rows(self, out: Numbers, kept: Numbers) -> tuple[Rows, Instant]:
        """The rows of the weighing and those of the instant."""
        size = self.r * self.k
        whole = np.frombuffer(out, count=size + self.r)
        begin = 8 * (6 * self.d + 3 * size + 4 * self.r)
        speed = np.frombuffer(kept, count=self.c, offset=begin)
        x, z, forwards, upwards = out[-4:]
        now = Instant(out, (self.r, self.k, self.c), speed, complex(x, z), complex(forwards, upwards))
        return Rows(whole[:size].reshape(self.r, self.k), whole[size:]), now
