"""Samples to motion: the few channels that matter, smoothed, differenced between two samples, turned into levers."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cylforce.estimation.filters import Filter, fours, mean, poles, second_order, slope
from cylforce.mechanics.installation import Filters
from cylforce.mechanics.machine import Geometry, Machine
from cylforce.mechanics.motion import Attitude, Motion, motion
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

MIN_TRANSMISSION = 0.15  # sine of the angle between rocker and link below which a force says nothing
MIN_LEVER = 0.02  # m


class Moved(NamedTuple):
    """A motion, and per cylinder (..., C) whether its force can be believed: no dead point, no end stop."""

    motion: Motion
    usable: Array


@dataclass(frozen=True)
class Channels:
    """Signals (..., S) to channels (..., D): joint angles (N), cylinder forces (C), pitch, roll, slew (rate or
    angle)."""

    machine: Machine
    filters: Filters

    @cached_property
    def smooth(self) -> Filter:
        """The low-pass that every channel passes before anything non-linear is computed from it; `between` does the
        rest of it."""
        return poles(second_order(self.filters.channel_hz, self.dt))

    @property
    def dt(self) -> float:
        """The fixed step [s]."""
        return 1.0 / self.filters.rate_hz

    @cached_property
    def forces(self) -> slice:
        """The cylinders' forces among the channels; joint angles stand before them."""
        return slice(self.machine.size, self.machine.size + len(self.machine.cylinders))

    @cached_property
    def _where(self) -> dict[tuple[Kind, int], int]:
        return {(s.kind, s.index): k for k, s in enumerate(self.machine.signals)}

    @cached_property
    def _by_length(self) -> dict[int, int]:
        """Joint -> cylinder whose length gives its angle."""
        seen = [c for c in range(len(self.machine.cylinders)) if (Kind.CYLINDER_LENGTH, c) in self._where]
        return {self.machine.spans[c][0]: c for c in seen}

    def read(self, values: Array) -> Array:
        """Channels from SI values of all signals."""
        zero = np.zeros(values.shape[:-1])
        pitch = self._value(values, Kind.PITCH, 0, zero)
        theta = self._angles(values, pitch)
        force = [self._force(values, c, zero) for c in range(len(self.machine.cylinders))]
        roll = self._value(values, Kind.ROLL, 0, zero)
        slew = self._value(values, Kind.SLEW_RATE, 0, self._value(values, Kind.SLEW_ANGLE, 0, zero))
        channels = np.empty((*values.shape[:-1], len(theta) + len(force) + 3))
        for k, channel in enumerate((*theta, *force, pitch, roll, slew)):
            channels[..., k] = channel
        return channels

    def _value(self, values: Array, kind: Kind, index: int, default: Array) -> Array:
        k = self._where.get((kind, index))
        return default if k is None else values[..., k]

    def _angles(self, values: Array, pitch: Array) -> list[Array]:
        """Joint angles from encoders, inclinometers on the links, or cylinder lengths."""
        theta: list[Array] = []
        inner = pitch  # the true inclination of the link before
        for j in range(self.machine.size):
            if (Kind.JOINT_ANGLE, j) in self._where:
                angle = values[..., self._where[Kind.JOINT_ANGLE, j]]
            elif (Kind.LINK_INCLINATION, j) in self._where:
                angle = values[..., self._where[Kind.LINK_INCLINATION, j]] - inner
            else:
                c = self._by_length[j]
                angle = self.machine.joint_angle(c, values[..., self._where[Kind.CYLINDER_LENGTH, c]])
            theta.append(angle)
            inner = inner + angle
        return theta

    def follow(self, before: Array, channels: Array) -> Array:
        """The channels (D,) with the house's angle on the turn that it was on `before`: an encoder that passes its end
        has not swung back."""
        if (Kind.SLEW_ANGLE, 0) not in self._where:
            return channels
        return np.append(channels[:-1], np.unwrap([before[-1], channels[-1]])[1])

    def _force(self, values: Array, c: int, zero: Array) -> Array:
        if (Kind.FORCE_PIN, c) in self._where:
            return values[..., self._where[Kind.FORCE_PIN, c]]
        if (Kind.HEAD_PRESSURE, c) not in self._where:
            return zero
        head = values[..., self._where[Kind.HEAD_PRESSURE, c]]
        rod = self._value(values, Kind.ROD_PRESSURE, c, zero + self.machine.cylinders[c].rod_pressure)
        return self.machine.cylinder_force(c, head, rod)

    def between(self, four: Array) -> Moved:
        """Motion in the middle of four samples of smoothed channels (4, ..., D): means for places, slopes for
        rates."""
        return self.moved(mean(four), slope(four, self.dt))

    def moved(self, middle: Array, rate: Array, geometry: Geometry | None = None) -> Moved:
        """Motion from channels (..., D) and their rates; `geometry` at these angles, if it is known already."""
        n, c = self.machine.size, len(self.machine.cylinders)
        slew = middle[..., -1] if (Kind.SLEW_RATE, 0) in self._where else rate[..., -1]
        attitude = Attitude(middle[..., n + c], middle[..., n + c + 1], 0.0, slew)
        found = motion(self.machine, middle[..., :n], rate[..., :n], middle[..., self.forces], attitude, geometry)
        good = self._usable(found)
        lever, speed = np.where(good[..., None], found.lever, 0.0), np.where(good, found.speed, 0.0)
        return Moved(found._replace(lever=lever, speed=speed, force_rate=rate[..., self.forces]), good)

    @cached_property
    def _stops(self) -> tuple[Array, Array]:
        margin = 0.005  # m before an end stop, which carries force that pressure does not show
        low = np.array([c.length_low + margin for c in self.machine.cylinders])
        return low, np.array([c.length_high - margin for c in self.machine.cylinders])

    def _usable(self, moving: Motion) -> Array:
        low, high = self._stops
        lever = np.abs(moving.lever).max(axis=-1)
        clear = (moving.transmission > MIN_TRANSMISSION) & (lever > MIN_LEVER)
        return np.asarray(clear & (moving.length > low) & (moving.length < high))

    def run(self, values: Array) -> Moved:
        """A gapless recording (T, S): motion of its T-1 intervals."""
        return self.between(fours(self.smoothed(self.course(values))))

    def course(self, values: Array) -> Array:
        """Channels (T, D) of a gapless recording (T, S)."""
        channels = self.read(values)
        if (Kind.SLEW_ANGLE, 0) in self._where:
            channels[:, -1] = np.unwrap(channels[:, -1])
        return channels

    def turning(self, values: Array) -> Array:
        """Rate (T-1,) [rad/s] at which the chassis turns in the arm's plane, along a gapless recording (T, S): that of
        its pitch, less what slewing on a slope makes of it; zero where no sensor tells."""
        if (Kind.PITCH, 0) not in self._where:
            return np.zeros(len(values) - 1)
        four = fours(self.smoothed(self.course(values)))
        rate, middle = slope(four, self.dt), mean(four)
        slew = middle[:, -1] if (Kind.SLEW_RATE, 0) in self._where else rate[:, -1]
        return np.asarray(rate[:, -3] - slew * np.tan(middle[:, -2]) * np.cos(middle[:, -3]))

    def smoothed(self, channels: Array) -> Array:
        """Channels (T, D) through the low-pass (T+2, D), as if they had stood still before."""
        _, smooth = self.smooth.run(self.smooth.steady(channels[0]), channels)
        return np.concatenate([smooth[:1], smooth[:1], smooth])
