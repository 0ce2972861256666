"""From samples to filtered rows, one fixed step at a time; the same numbers as `observation.observe` from a
recording. The arithmetic is the kernel's (estimation/kernel/README.md)."""

from array import array
from dataclasses import dataclass, field
from math import inf, isfinite, prod
from typing import Any, NamedTuple

import numpy as np

from cylforce.estimation.kernel import choice, making
from cylforce.estimation.kernel.restricted import Counts, Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.estimation.model import Model
from cylforce.estimation.regressor import Rows
from cylforce.estimation.residual import Residual
from cylforce.mechanics.machine import FORCE_KINDS
from cylforce.signals.estimate import Array, Reason
from cylforce.signals.quick import new, once

MOVING = 0.005  # m/s of a cylinder, from which on it counts as moving; chosen


class Sizes(NamedTuple):
    """D channels, R rows, K columns, C cylinders."""

    d: int
    r: int
    k: int
    c: int


class Pipe(NamedTuple):
    """State of the filters: number of `steps`, and the state of every filter as the kernel keeps it (`kept`)."""

    steps: int
    kept: Numbers
    sizes: Sizes

    @property
    def raw(self) -> Array:
        """Last channels (D,)."""
        return self._part(0, self.sizes.d)

    @property
    def smooth(self) -> Array:
        """Last three outputs (3, D) of their low-pass."""
        return self._part(3 * self.sizes.d, 3 * self.sizes.d).reshape(3, -1)

    @property
    def middle(self) -> Numbers:
        """Their mean (D,)."""
        d = self.sizes.d
        outputs = (self.kept[3 * d : 4 * d], self.kept[4 * d : 5 * d], self.kept[5 * d : 6 * d])
        return array("d", [(x + y + z) / 3.0 for x, y, z in zip(*outputs, strict=True)])

    @property
    def waiting(self) -> Array:
        """Steps (R,) for which each row is not used, because its filters still contain an unusable lever."""
        d, r, k, _ = self.sizes
        return self._part(6 * d + 3 * r * (k + 1), r)

    def _part(self, begin: int, size: int) -> Array:
        return np.frombuffer(self.kept, count=size, offset=8 * begin)


class Instant(NamedTuple):
    """What the kernel knows of this instant, all rows of a step (`kernel/rows.py`) as it keeps them; position `place`
    [m] of the tool from the first pin and its `velocity` [m/s], as x + i z; `usable` (R,) rows: 1, else 0; `speed` (C,)
    of the cylinders [m/s]."""

    kept: Numbers
    sizes: Sizes
    place: complex
    velocity: complex
    usable: Numbers
    speed: Numbers

    @property
    def slow(self) -> Rows:
        """Columns (R, K) and torques (R,) for the weighing."""
        _, r, k, _ = self.sizes
        return Rows(self._part(0, (r, k)), self._part(r * k, (r,)))

    @property
    def rows(self) -> Rows:
        """Those of the instant."""
        _, r, k, _ = self.sizes
        begin = r * k + r
        return Rows(self._part(begin, (r, k)), self._part(begin + r * k, (r,)))

    @property
    def change(self) -> Array:
        """Time derivative (R, K) of the columns of inertia [1/s]."""
        _, r, k, _ = self.sizes
        return self._part(2 * (r * k + r), (r, k))

    @property
    def reversing(self) -> Array:
        """1 where a cylinder (C,) is about to turn round, else 0."""
        _, r, k, c = self.sizes
        return self._part(3 * r * k + 2 * r, (c,))

    @property
    def reverses(self) -> bool:
        """Whether any does."""
        _, r, k, c = self.sizes
        begin = 3 * r * k + 2 * r
        return any(self.kept[begin : begin + c])

    def _part(self, begin: int, shape: tuple[int, ...]) -> Array:
        return np.frombuffer(self.kept)[begin : begin + prod(shape)].reshape(shape)


@dataclass(frozen=True)
class Pipeline:
    """The filters of a model, step by step."""

    model: Model
    most_tilted: float = inf  # rad, of the chassis
    kernel: Any = field(default_factory=lambda: choice.chosen())  # noqa: PLW0108 - asked when it is made

    @once
    def _plan(self) -> Any:  # noqa: ANN401 - the compiled or the interpreted class
        return making.plan(self.model, self.kernel.KernelPlan)

    @once
    def _sensors(self) -> Any:  # noqa: ANN401 - the compiled or the interpreted class
        return making.sensors(self.model, self.kernel.KernelSensors, self.most_tilted)

    def read(self, values: Numbers) -> Numbers | Reason:
        """Joint angles, cylinder forces and attitude (D,) of a sample (S,); or why it is not usable."""
        channels = ZERO * self._numbers.d
        for joint, cylinder, signal in self.model.channels.by_length:
            channels[joint] = float(self.model.machine.joint_angle(cylinder, values[signal]))
        if self.kernel.sense(self._sensors, values, channels):
            return Reason.TILT
        return channels if isfinite(sum(channels)) else Reason.END_STOP

    @once
    def _sizes(self) -> tuple[int, int]:
        """Numbers of a state and of the rows of a step."""
        return self.kernel.state_size(self._plan), self.kernel.rows_size(self._plan)

    @once
    def _numbers(self) -> Sizes:
        machine = self.model.machine
        channels = machine.size + len(machine.cylinders) + (6 if self.model.channels.inertial else 3)
        columns = len(self.model.filtered.regressor.names)
        return Sizes(channels, len(machine.rows), columns, len(machine.cylinders))

    def begin(self, channels: Numbers) -> Pipe:
        """The state after the first channels (D,) at the start or after a gap, settled at them."""
        first, low_pass = np.asarray(channels), self.model.channels.smooth
        state, smooth = low_pass.step(low_pass.steady(first), first)
        kept = np.zeros(self._sizes[0])
        kept[: 6 * len(channels)] = np.concatenate([first, *state, smooth, smooth, smooth])
        return Pipe(0, array("d", kept.tobytes()), self._numbers)

    def advance(self, pipe: Pipe, channels: Numbers, periods: int) -> tuple[Pipe, Instant]:
        """The state and the rows `periods` >= 1 steps later, at `channels` (D,); missing steps are filled by linear
        interpolation."""
        here = self.model.channels.follow(pipe.raw, channels) if self.model.channels.unwraps else channels
        if periods > 1:
            pipe = self._filled(pipe, here, periods)
        size, rows = self._sizes
        state, out = ZERO * size, ZERO * rows
        old = pipe.kept if pipe.steps else array("d", pipe.kept)  # the kernel begins its filters there
        self.kernel.advance(self._plan, old, here, state, out, pipe.steps == 0)
        return new(Pipe, (pipe.steps + 1, state, self._numbers)), self._instant(out)

    def moving(self, speed: Numbers) -> Numbers:
        """Per signal whether it should change (1) at the speed (C,) [m/s] of the cylinders, so that a repeated value
        means a frozen sensor: a pressure while its own cylinder moves, any other signal while any cylinder moves,
        because the whole machine then shakes."""
        by = self._moved_by
        found = ZERO * len(by)
        self.kernel.moves(speed, len(speed), MOVING, by, len(by), found)
        return found

    @once
    def _moved_by(self) -> Counts:
        """Per signal the number of the cylinder whose motion changes it; -1: that of any cylinder."""
        signals = self.model.machine.signals
        return making.counts(s.index if s.kind in FORCE_KINDS else -1 for s in signals)

    def _filled(self, pipe: Pipe, here: Numbers, periods: int) -> Pipe:
        """The state one step before `here`."""
        first = pipe.raw
        for k in range(1, periods):
            between = first + (np.asarray(here) - first) * (k / periods)
            pipe, _ = self.advance(pipe, array("d", between.tobytes()), 1)
        return pipe

    def _instant(self, out: Numbers) -> Instant:
        sizes = self._numbers
        end = len(out) - sizes.c
        begin = end - sizes.r
        x, z, forwards, upwards = out[begin - 4 : begin]
        now = (complex(x, z), complex(forwards, upwards), out[begin:end], out[end:])
        return new(Instant, (out, sizes, *now))


class Unexplained(NamedTuple):
    """One instant of R measured joints: its `rows`, of which the first are columns (R, K), then torques (R,); what is
    left of them, `kept`: torque (R,) [N m], its variance without friction at rest, that of friction at rest
    [N^2 m^2], the columns (R, D) of the drift (`weighed.explain`); `wider` (R,): what the variance is wider by, for
    those who ask for it [N^2 m^2]."""

    rows: Numbers
    kept: Numbers
    wider: Numbers

    @property
    def torque(self) -> Numbers:
        """The torque (R,) [N m]."""
        return self.kept[: len(self.wider)]

    @property
    def variance(self) -> Numbers:
        """Its variance (R,) [N^2 m^2]."""
        size = len(self.wider)
        return self.kept[size : 2 * size]

    @property
    def rest(self) -> Numbers:
        """The variance of friction at rest (R,) [N^2 m^2]."""
        size = len(self.wider)
        return self.kept[2 * size : 3 * size]


def unexplained(left: Residual, columns: int, drifts: int) -> Unexplained:
    """The same of arrays, the columns filled up with zeros to so many; friction and zeros do not drift."""
    rows, own = np.zeros((len(left.torque), columns)), left.columns.shape[1]
    rows[:, :own] = left.columns
    kept = np.concatenate([left.torque, left.variance, left.rest, np.zeros(len(rows) * drifts)])
    return Unexplained(array("d", rows.tobytes()), array("d", kept.tobytes()), ZERO * len(rows))
