"""Filtered rows from samples, one fixed step at a time.

The numbers equal those of `observation.observe` from a recording. The arithmetic is the kernel's
(estimation/kernel/README.md)."""

from array import array
from dataclasses import dataclass
from math import inf, isfinite
from typing import Self

import numpy as np

from cylforce.estimation.kernel import choice, making
from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.layout import FilterLayout, RowLayout, Sizes, part
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.estimation.model import Model
from cylforce.estimation.regressor import Rows
from cylforce.mechanics.machine import FORCE_KINDS
from cylforce.service.snapshot import Constants, Estimator
from cylforce.signals.estimate import Array, Reason

MOVING = 0.005  # m/s of a cylinder, from which on it counts as moving; chosen


class PipelineConstants(Constants):
    """Constants of the filters of one machine.

    model:       columns of all effects and their filters
    most_tilted: largest tilt of the chassis that is used [rad]; kept in `sensors`
    kernel:      compiled or interpreted functions
    plan:        the model, as the kernel takes it
    sensors:     constants for computing channels from signals, as the kernel takes them
    sizes:       numbers of channels, rows, columns and cylinders
    filters:     names of the places in the filters' state
    rows:        names of the places in the rows of a step
    by_length:   (joint, cylinder, signal) of each joint whose angle is computed from a cylinder's length
    unwraps:     whether the slew angle is unwrapped from sample to sample
    state_size:  count of numbers in the filters' state
    rows_size:   count of numbers in the rows of a step
    moved_by:    (S,) number of the cylinder whose motion changes each signal; -1: that of any cylinder
    """

    def __init__(self, model: Model, most_tilted: float = inf, kernel: Kernel | None = None) -> None:
        """Compute the kernel's plan of a model, and the places in its arrays.

        model:       of the machine
        most_tilted: largest tilt of the chassis that is used [rad]
        kernel:      form of the kernel; None: the compiled one if there is one
        """
        self.model, self.kernel = model, kernel or choice.chosen()
        machine = model.machine
        self.plan = making.plan(model, self.kernel.KernelPlan)
        self.sensors = making.sensors(model, self.kernel.KernelSensors, most_tilted)
        channels = machine.size + len(machine.cylinders) + (6 if model.channels.inertial else 3)
        columns = len(model.filtered.regressor.names)
        self.sizes = Sizes(channels, len(machine.rows), columns, len(machine.cylinders))
        self.filters, self.rows = FilterLayout(self.sizes), RowLayout(self.sizes)
        self.state_size, self.rows_size = self.kernel.state_size(self.plan), self.kernel.rows_size(self.plan)
        self.by_length = model.channels.by_length
        self.unwraps = model.channels.unwraps
        self.moved_by = making.counts(s.index if s.kind in FORCE_KINDS else -1 for s in machine.signals)

    def read(self, values: Numbers) -> Numbers | Reason:
        """Return the channels (D,) of a sample, or the reason why it has none.

        The channels are joint angles [rad], cylinder forces [N], with an inertial sensor on the base its rate [rad/s]
        and specific forces [m/s^2], pitch and roll [rad], then slew rate [rad/s] or slew angle [rad]. The reason is
        TILT where the chassis is tilted farther than is allowed, and END_STOP where a cylinder's length belongs to no
        angle.

        values: (S,) of all signals [SI]
        """
        channels = ZERO * self.sizes.channels
        for joint, cylinder, signal in self.by_length:
            channels[joint] = float(self.model.machine.joint_angle(cylinder, values[signal]))
        if self.kernel.read_channels(self.sensors, values, channels):
            return Reason.TILT
        return channels if isfinite(sum(channels)) else Reason.END_STOP

    def moving(self, speed: Numbers) -> Numbers:
        """Return for each signal (S,) 1 where it should change, so that a repeated value means a frozen sensor, else 0.

        A pressure or force should change while its own cylinder moves. Any other signal should while any cylinder
        moves, because the whole machine then shakes. A cylinder moves if it is faster than MOVING [m/s].

        speed: (C,) of the cylinders [m/s]
        """
        found = ZERO * len(self.moved_by)
        self.kernel.moving_signals(speed, len(speed), MOVING, self.moved_by, len(self.moved_by), found)
        return found


@dataclass(slots=True)
class Instant:
    """Filtered rows of one step.

    numbers:  all rows, as the kernel keeps them
    layout:   names of the places in `numbers`
    place:    of the tool from the first pin, x + i z [m]
    velocity: of the tool, x + i z [m/s]
    usable:   (R,) 1 where a row can be used, else 0
    speed:    (C,) of the cylinders, extending positive [m/s]
    """

    numbers: Numbers
    layout: RowLayout
    place: complex
    velocity: complex
    usable: Numbers
    speed: Numbers

    @property
    def slow(self) -> Rows:
        """Columns (R, K) and torques (R,) [N m] with the slow filters of the weighing."""
        columns = part(self.numbers, self.layout.slow_columns).reshape(self.layout.shape)
        return Rows(columns, part(self.numbers, self.layout.slow_torque))

    @property
    def rows(self) -> Rows:
        """Columns (R, K) and torques (R,) [N m] of the instant with the fast filters, for the force."""
        columns = part(self.numbers, self.layout.columns).reshape(self.layout.shape)
        return Rows(columns, part(self.numbers, self.layout.torque))

    @property
    def change(self) -> Array:
        """Time derivative (R, K) of the columns of inertia [1/s]."""
        return part(self.numbers, self.layout.change).reshape(self.layout.shape)

    @property
    def reversing(self) -> Numbers:
        """Flags (C,), 1 where a cylinder is about to reverse, else 0."""
        return self.numbers[self.layout.reversing]


@dataclass(slots=True)
class Pipeline(Estimator):
    """Filters of a model, step by step.

    constants: of the machine
    steps:     number of steps since the filters began
    state:     state of every filter, as the kernel keeps it; None: not begun
    """

    constants: PipelineConstants
    steps: int
    state: Numbers | None

    @classmethod
    def start(cls, constants: PipelineConstants) -> Self:
        """Return filters that have not begun."""
        return cls(constants, steps=0, state=None)

    @property
    def raw(self) -> Array:
        """Last channels (D,)."""
        return self._part(self.constants.filters.raw)

    @property
    def smooth(self) -> Array:
        """Last three outputs (3, D) of the channels' low-pass, oldest first."""
        return self._part(self.constants.filters.smooth).reshape(3, -1)

    @property
    def middle(self) -> Numbers:
        """Mean (D,) of the last three outputs of the channels' low-pass."""
        first, second, third = (row.tolist() for row in self.smooth)
        return array("d", [(x + y + z) / 3.0 for x, y, z in zip(first, second, third, strict=True)])

    @property
    def waiting(self) -> Array:
        """Number of steps (R,) for which each row is not used, because its filters still contain an unusable lever."""
        return self._part(self.constants.filters.waiting)

    def _part(self, place: slice) -> Array:
        assert self.state is not None, "the filters have not begun"  # noqa: S101 - a caller's mistake
        return part(self.state, place)

    def stop(self) -> None:
        """Discard the state after an interruption of the measurement."""
        self.steps, self.state = 0, None

    def begin(self, channels: Numbers) -> None:
        """Start the filters after the start or after a gap, settled as if the machine had rested at these channels.

        channels: (D,) of the first sample, in the order and the units of `PipelineConstants.read`
        """
        constants, low_pass = self.constants, self.constants.model.channels.smooth
        first = np.asarray(channels)
        delayed, smooth = low_pass.step(low_pass.steady(first), first)
        numbers = np.zeros(constants.state_size)
        numbers[constants.filters.begin] = np.concatenate([first, *delayed, smooth, smooth, smooth])
        self.steps, self.state = 0, array("d", numbers.tobytes())

    def update(self, channels: Numbers, periods: int = 1) -> Instant:
        """Advance the filters by one sample, and return the rows of the present step.

        The rows are the measured joint torques [N m] and the columns that explain them, both filtered.

        `begin` must have been called. Missing steps are filled by linear interpolation. The slew angle, where it is the
        last channel, is unwrapped; no other channel is.

        channels: (D,) joint angles [rad], cylinder forces [N], with an inertial sensor on the base its rate [rad/s] and
                  specific forces [m/s^2], pitch, roll [rad], slew rate [rad/s] or slew angle [rad] (`Channels`)
        periods:  number of steps since the last update, 1 or more
        """
        if self.constants.unwraps:
            channels = self.constants.model.channels.follow(self.raw, channels)
        if periods > 1:
            self._fill(channels, periods)
        constants = self.constants
        assert self.state is not None, "the filters have not begun"  # noqa: S101 - a caller's mistake
        state, rows = ZERO * constants.state_size, ZERO * constants.rows_size
        constants.kernel.advance(constants.plan, self.state, channels, state, rows, self.steps == 0)
        self.steps += 1
        self.state = state
        layout = constants.rows
        place, velocity = rows[layout.place], rows[layout.velocity]
        return Instant(rows, layout, complex(*place), complex(*velocity), rows[layout.usable], rows[layout.speed])

    def _fill(self, channels: Numbers, periods: int) -> None:
        """Advance the filters by the missing steps, with channels interpolated between the last ones and these.

        channels: (D,) of the present step, up to the step before which the filters are advanced
        periods:  number of steps since the last update, 2 or more
        """
        first = self.raw
        for k in range(1, periods):
            between = first + (np.asarray(channels) - first) * (k / periods)
            self.update(array("d", between.tobytes()))
