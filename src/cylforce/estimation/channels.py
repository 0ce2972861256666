"""Conversion of samples to motion.

Signals become channels (angles, forces, attitude), which are smoothed. Means and slopes of four samples give the
motion."""

from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cylforce.estimation.filters import Filter, fours, mean, poles, second_order, slope
from cylforce.mechanics.installation import Filters
from cylforce.mechanics.machine import Geometry, Machine
from cylforce.mechanics.motion import Attitude, Motion, motion
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import INERTIAL, Kind

MIN_TRANSMISSION = 0.15  # sine of the angle between rocker and link below which the force is not used; chosen
MIN_LEVER = 0.02  # m/rad, smallest lever with which a cylinder's force is used; chosen


Signals = Array | Sequence[float]  # values of all signals: (S, ...), or numbers of one sample


class Moved(NamedTuple):
    """Motion of the machine, and where its forces can be used.

    motion: the motion
    usable: (..., C) whether a cylinder's force shows the load: no dead point of the linkage, no end stop of the piston
    """

    motion: Motion
    usable: Array


@dataclass(frozen=True)
class Channels:
    """Conversion of signals (..., S) to channels (..., D), D = N + C + 3.

    The channels are joint angles (N) [rad], cylinder forces (C) [N], pitch and roll [rad], slew rate [rad/s] or, where
    no sensor measures it, slew angle [rad]. With an inertial sensor on the base, its rate [rad/s] and its specific
    forces forwards and upwards [m/s^2] precede pitch: D = N + C + 6.

    machine: machine with its N joints, C cylinders and S signals
    filters: rates and cut-off frequencies
    """

    machine: Machine
    filters: Filters

    @cached_property
    def smooth(self) -> Filter:
        """Poles of the second-order low-pass on every channel; the mean of four samples in `between` adds its zeros."""
        return poles(second_order(self.filters.channel_hz, self.dt))

    @property
    def dt(self) -> float:
        """Fixed step [s]."""
        return 1.0 / self.filters.rate_hz

    @cached_property
    def forces(self) -> slice:
        """Slice of the cylinder forces among the channels."""
        return slice(self.machine.size, self.machine.size + len(self.machine.cylinders))

    @cached_property
    def _where(self) -> dict[tuple[Kind, int], int]:
        """Number of each signal, by its kind and the number of its joint or cylinder."""
        return {(s.kind, s.index): k for k, s in enumerate(self.machine.signals)}

    @cached_property
    def _by_length(self) -> dict[int, int]:
        """Number of the cylinder whose measured length gives a joint's angle, by the number of the joint."""
        measured = [c for c in range(len(self.machine.cylinders)) if (Kind.CYLINDER_LENGTH, c) in self._where]
        return {self.machine.spans[c][0]: c for c in measured}

    @cached_property
    def by_length(self) -> tuple[tuple[int, int, int], ...]:
        """(Joint, cylinder, signal) of each joint whose angle is computed from the length of a cylinder."""
        read = [j for j, (encoder, inclined) in enumerate(self.turned) if encoder is None and inclined is None]
        return tuple((j, c := self._by_length[j], self._where[Kind.CYLINDER_LENGTH, c]) for j in read)

    @cached_property
    def inertial(self) -> bool:
        """Whether the base's acceleration is measured."""
        return all((kind, 0) in self._where for kind in INERTIAL)

    def read(self, values: Array) -> Array:
        """Return the channels (..., D) of samples: angles, forces and attitude, computed from the signals.

        Their order is: joint angles [rad]; cylinder forces [N], positive when they push; with an inertial sensor on the
        base its rate [rad/s] and specific forces forwards and upwards [m/s^2]; pitch and roll [rad]; slew rate [rad/s],
        or where no sensor measures it slew angle [rad]. A joint's angle without an encoder or inclinometer is computed
        from the length of its cylinder. A force, pitch, roll or slew that no sensor measures is 0.

        values: (..., S) of all signals [SI]
        """
        # one sample as numbers: arithmetic with arrays of one element takes many times as long
        each: Signals = values.tolist() if values.ndim == 1 else np.moveaxis(values, -1, 0)
        pitch, roll, slew = (self._value(each, k, 0.0) for k in self.house)
        theta = self._angles(each, pitch)
        force = [self._force(each, c) for c in range(len(self.machine.cylinders))]
        found = (*theta, *force, *(each[k] for k in self.base), pitch, roll, slew)
        if values.ndim == 1:
            return np.array(found, dtype=np.float64)
        channels = np.empty((*values.shape[:-1], len(found)))
        for k, channel in enumerate(found):
            channels[..., k] = channel
        return channels

    @cached_property
    def house(self) -> tuple[int | None, int | None, int | None]:
        """Numbers of the signals of pitch, roll, and slew rate or angle; None: not measured."""
        at = self._where.get
        slew = at((Kind.SLEW_RATE, 0), at((Kind.SLEW_ANGLE, 0)))
        return at((Kind.PITCH, 0)), at((Kind.ROLL, 0)), slew

    @cached_property
    def base(self) -> tuple[int, ...]:
        """Numbers of the signals of the base's inertial sensor."""
        return tuple(self._where[kind, 0] for kind in INERTIAL) if self.inertial else ()

    @cached_property
    def turned(self) -> tuple[tuple[int | None, int | None], ...]:
        """Numbers of the signals of each joint's encoder and of its link's inclinometer; None: no such sensor."""
        at, joints = self._where.get, range(self.machine.size)
        return tuple((at((Kind.JOINT_ANGLE, j)), at((Kind.LINK_INCLINATION, j))) for j in joints)

    @cached_property
    def pushed(self) -> tuple[tuple[int | None, int | None, int | None], ...]:
        """Numbers of the signals of each cylinder's force pin, head and rod side; None: no such sensor."""
        kinds, cylinders = (Kind.FORCE_PIN, Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE), range(len(self.machine.cylinders))
        pin, head, rod = ([self._where.get((kind, c)) for c in cylinders] for kind in kinds)
        return tuple(zip(pin, head, rod, strict=True))

    def _value(self, values: Signals, k: int | None, default: Array | float) -> Array | float:
        """Return the value of signal k of all signals; `default` where it is None."""
        return default if k is None else values[k]

    def _angles(self, values: Signals, pitch: Array | float) -> list[Array | float]:
        """Return the N joint angles [rad] from encoders, from inclinometers on the links, or from cylinder lengths.

        An inclinometer measures the link's angle from the horizontal: the inclination of the link before is subtracted.

        values: of all signals [SI]
        pitch:  of the chassis [rad]
        """
        theta: list[Array | float] = []
        inner = pitch  # inclination of the next link inwards
        for j, (encoder, inclined) in enumerate(self.turned):
            if encoder is not None:
                angle = values[encoder]
            elif inclined is not None:
                angle = values[inclined] - inner
            else:
                c = self._by_length[j]
                angle = self.machine.joint_angle(c, values[self._where[Kind.CYLINDER_LENGTH, c]])
            theta.append(angle)
            inner = inner + angle
        return theta

    @cached_property
    def unwraps(self) -> bool:
        """Whether the last channel is an encoder's slew angle; a measured slew rate takes precedence over it."""
        return (Kind.SLEW_ANGLE, 0) in self._where and (Kind.SLEW_RATE, 0) not in self._where

    def follow(self, before: Array, channels: "array[float]") -> "array[float]":
        """Return the channels (D,) with the slew angle, the last one, unwrapped to half a turn of the one before.

        An encoder that passes the end of its range has not turned back. Channels without a slew angle are returned as
        they are.

        before:   (D,) channels of the last sample
        channels: (D,) channels of this sample
        """
        if not self.unwraps:
            return channels
        return channels[:-1] + array("d", [np.unwrap([before[-1], channels[-1]])[1]])

    def _force(self, values: Signals, c: int) -> Array | float:
        """Return the force of cylinder c [N], positive when it pushes; 0 where it is not measured.

        It is that of a force pin, or it follows from the pressures of head and rod side and their areas. On a rod side
        without a sensor the constant pressure `Cylinder.rod_pressure` [Pa] is assumed.

        values: of all signals [SI]
        c:      number of the cylinder
        """
        pin, head, rod = self.pushed[c]
        if pin is not None:
            return values[pin]
        if head is None:
            return 0.0
        return self.machine.cylinder_force(
            c, values[head], self._value(values, rod, self.machine.cylinders[c].rod_pressure)
        )

    def between(self, four: Array) -> Moved:
        """Return the motion in the middle of four consecutive samples, and which cylinders' forces can be used.

        The values are their mean with the weights (1, 3, 3, 1)/8, which completes the low-pass `smooth`. The rates are
        (last - first)/(3 dt). Lever and speed of an unusable cylinder are 0.

        four: (4, ..., D) channels after `smooth`: joint angles [rad], cylinder forces [N], attitude
        """
        return self.moved(mean(four), slope(four, self.dt))

    def moved(self, middle: Array, rate: Array, geometry: Geometry | None = None) -> Moved:
        """Return the motion that channels and their rates describe, and which cylinders' forces can be used.

        Lever and speed of an unusable cylinder (dead point, end stop) are set to zero.

        middle:   (..., D) channels: joint angles [rad], cylinder forces [N], attitude
        rate:     (..., D) their rates [1/s]
        geometry: of these angles, where the caller has computed it
        """
        n = self.machine.size
        slew = middle[..., -1] if (Kind.SLEW_RATE, 0) in self._where else rate[..., -1]
        attitude = self._attitude(middle, rate, slew)
        found = motion(self.machine, middle[..., :n], rate[..., :n], middle[..., self.forces], attitude, geometry)
        good = self.usable(found)
        lever, speed = found.lever, found.speed
        if not good.all():
            lever, speed = np.where(good[..., None], lever, 0.0), np.where(good, speed, 0.0)
        return Moved(found._replace(lever=lever, speed=speed, force_rate=rate[..., self.forces]), good)

    def _attitude(self, middle: Array, rate: Array, slew: Array) -> Attitude:
        """Return the base's attitude and motion: pitch, roll [rad], pitch rate [rad/s], slew rate, specific force.

        Without an inertial sensor on the base only the slew rate of its motion is known. The specific force [m/s^2] of
        the first pin is that of the sensor at r less (i alpha - omega^2) r. It excludes the part of slewing, for which
        the effect `Slew` accounts.

        middle: (..., D) channels, of which the last three are pitch, roll and slew; before them those of the inertial
                sensor
        rate:   (..., D) their rates [1/s]
        slew:   (...,) slew rate [rad/s]
        """
        pitch, roll = middle[..., -3], middle[..., -2]
        if not self.inertial:
            return Attitude(pitch, roll, 0.0, slew)
        turns, forwards, upwards = np.moveaxis(middle[..., self.forces.stop : -3], -1, 0)
        place, out = self.machine.inertial, self.machine.slew_axis + self.machine.inertial.real
        specific = forwards + 1j * upwards - (1j * rate[..., self.forces.stop] - turns**2) * place + slew**2 * out
        return Attitude(pitch, roll, turns, slew, specific)

    @cached_property
    def stops(self) -> tuple[Array, Array]:
        """Shortest and longest length (C,) [m] at which a cylinder's force is used."""
        margin = 0.005  # m from an end stop, which carries force that the pressures do not show; chosen
        low = np.array([c.length_low + margin for c in self.machine.cylinders])
        return low, np.array([c.length_high - margin for c in self.machine.cylinders])

    def usable(self, moving: Motion | Geometry) -> Array:
        """Return whether each cylinder's force (..., C) can be used: at no dead point and at no end stop.

        moving: levers [m/rad], lengths [m] and transmissions of the cylinders at one or more instants (...)
        """
        low, high = self.stops
        lever = np.abs(moving.lever).max(axis=-1)
        clear = (moving.transmission > MIN_TRANSMISSION) & (lever > MIN_LEVER)
        return np.asarray(clear & (moving.length > low) & (moving.length < high))

    def run(self, values: Array) -> Moved:
        """Return the motion in the T-1 intervals between the samples of a recording, and which forces can be used.

        values: (T, S) samples of all signals [SI], without gaps
        """
        return self.between(fours(self.smoothed(self.course(values))))

    def course(self, values: Array) -> Array:
        """Return the channels (T, D) of a recording: joint angles [rad], cylinder forces [N], attitude.

        A slew angle is unwrapped.

        values: (T, S) samples of all signals [SI], without gaps
        """
        channels = self.read(values)
        if self.unwraps:
            channels[:, -1] = np.unwrap(channels[:, -1])
        return channels

    def turning(self, values: Array) -> Array:
        """Return the rate (T-1,) [rad/s] at which the chassis turns in the arm's plane, along a recording.

        values: (T, S) samples of all signals [SI], without gaps

        It is the derivative of the pitch less the part that slewing on a slope causes; zero without a pitch sensor."""
        if (Kind.PITCH, 0) not in self._where:
            return np.zeros(len(values) - 1)
        four = fours(self.smoothed(self.course(values)))
        rate, middle = slope(four, self.dt), mean(four)
        slew = middle[:, -1] if (Kind.SLEW_RATE, 0) in self._where else rate[:, -1]
        return np.asarray(rate[:, -3] - slew * np.tan(middle[:, -2]) * np.cos(middle[:, -3]))

    def smoothed(self, channels: Array) -> Array:
        """Return the channels (T + 2, D) after the low-pass, which is settled at the first sample.

        The first filtered sample is put twice before all T of them, so that their groups of four (`fours`) give the
        T - 1 intervals between the samples.

        channels: (T, D) channels of a recording, without gaps
        """
        _, smooth = self.smooth.run(self.smooth.steady(channels[0]), channels)
        return np.concatenate([smooth[:1], smooth[:1], smooth])
