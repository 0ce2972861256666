"""Change of a recording's residual with its readings, or with the machine: the difference of two variants.

Only the parts in which the variants differ are computed. All filters are linear, so that they are applied to
differences alone."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cylforce.effects.effect import Effect, depends_on
from cylforce.estimation.channels import Channels
from cylforce.estimation.filters import Filter, fours, mean, slope
from cylforce.estimation.model import Model
from cylforce.estimation.regressor import FilteredRegressor, Regressor
from cylforce.mechanics.machine import Geometry, Link, Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array


@dataclass(frozen=True)
class Sensitivity:
    """A recording and the model that explains it, at a reduced rate.

    Sizes: T samples of S signals, T' samples at the reduced rate, D channels (joint angles, cylinder forces, motion of
    the base), R measured torques, P parameters. Motion and residuals belong to the T' - 1 intervals between samples.

    model:  the model, with the reduced rate in its filters
    tares:  (P,) its parameters
    values: (T, S) samples of the recording [SI]
    low:    low-pass before the reduction of the rate
    thin:   every `thin`-th sample is used
    """

    model: Model
    tares: Array
    values: Array
    low: Filter
    thin: int

    def of_readings(self, more: Array, less: Array) -> Array:
        """Return the residual of samples `more` minus that of samples `less`, as (T' - 1, R) [N m].

        more, less: (T, S) the recording with some signals changed, or itself [SI]
        """
        if more is less:
            return self._nothing
        machine = self.model.machine
        return self._difference(*((machine, self._motion(self._channels(each))) for each in (more, less)))

    def of_machines(self, more: Machine, less: Machine) -> Array:
        """Return the recording's residual with the machine `more` minus that with `less`, as (T' - 1, R) [N m].

        more, less: machines with the same sensors, links or cylinders of which may differ
        """
        if more is less:
            return self._nothing
        return self._difference(*((machine, self._altered(machine)) for machine in (more, less)))

    @property
    def _nothing(self) -> Array:
        """No change of the residual, zeros (T' - 1, R) [N m]."""
        return np.zeros((len(self.thinned) - 1, len(self.model.machine.rows)))

    @cached_property
    def thinned(self) -> Array:
        """Samples (T', S) at the reduced rate."""
        return self._thinned(self.values)

    def _thinned(self, values: Array) -> Array:
        """Return samples (T', ...) at the reduced rate: samples `values` (T, ...), low-passed, every `thin`-th one."""
        return np.asarray(self.low.run(self.low.steady(values[0]), values)[1][:: self.thin])

    def _channels(self, values: Array) -> Array:
        """Return the channels (T', D) of changed samples (T, S) [SI], at the reduced rate.

        The channels are joint angles [rad], cylinder forces [N] and attitude of the base. Only the signals that differ
        from the recording's are filtered and thinned; the others are copied.

        values: (T, S) samples of the recording with some signals changed [SI]
        """
        differs, thinned = _changed(values, self.values), self.thinned.copy()
        thinned[:, differs] = self._thinned(values[:, differs])
        return self.model.channels.course(thinned)

    @cached_property
    def _plain(self) -> Array:
        """Channels (T', D) of the recording itself."""
        return self.model.channels.course(self.thinned)

    @cached_property
    def _means(self) -> tuple[Array, Array]:
        """Means of the recording's smoothed channels over four samples, and their rates [1/s], each (T' - 1, D)."""
        return self._between(self._plain)

    def _between(self, channels: Array) -> tuple[Array, Array]:
        """Return mean and rate [1/s] of the smoothed channels (T', ...) over four samples, each (T' - 1, ...)."""
        four = fours(self.model.channels.smoothed(channels))
        return mean(four), slope(four, self.model.channels.dt)

    @cached_property
    def _geometry(self) -> Geometry:
        """Levers, lengths and transmissions of the model's cylinders along the recording, T' - 1 postures."""
        return self.model.machine.geometry(self._means[0][:, : self.model.machine.size])

    @cached_property
    def motion(self) -> Motion:
        """Motion of the model's machine along the recording, T' - 1 instants."""
        return self.model.channels.moved(*self._means, self._geometry).motion

    def _motion(self, channels: Array) -> Motion:
        """Return the motion (T' - 1 instants) of the model's machine from channels (T', D), some of them changed.

        If only forces differ from the recording's channels, the motion is the recording's with these forces. If no
        joint angle differs, the geometry is the recording's."""
        differs, forces = _changed(channels, self._plain), self.model.channels.forces
        middle, rate = (each.copy() for each in self._means)
        middle[:, differs], rate[:, differs] = self._between(channels[:, differs])
        if not np.any(np.delete(differs, forces)):
            return self.motion._replace(force=middle[:, forces], force_rate=rate[:, forces])
        known = None if np.any(differs[: forces.start]) else self._geometry
        return self.model.channels.moved(middle, rate, known).motion

    def _altered(self, machine: Machine) -> Motion:
        """Return the motion (T' - 1 instants) that the recording's samples mean on another machine.

        machine: with the same sensors, but another geometry, such as a cylinder of another length
        """
        channels = Channels(machine, self.model.filters)
        course = channels.course(self.thinned)
        means = self._means if np.array_equal(course, self._plain) else self._between(course)
        return channels.moved(*means).motion

    def _difference(self, more: tuple[Machine, Motion], less: tuple[Machine, Motion]) -> Array:
        """Return the residual torque (T' - 1, R) [N m] of one machine and motion less that of another one.

        Effects that are the same in both are omitted, which saves time.

        more: machine and its motion whose residual is taken
        less: machine and its motion whose residual is subtracted
        """
        same = _linked(more[0]) == _linked(less[0])
        alike = [e for e in self.model.empty.effects if same and _alike(e, more[1], less[1])]
        one, two = (self._unfiltered(*each, alike) for each in (more, less))
        return self._filter.filtered(*(a - b for a, b in zip(one, two, strict=True)))

    def _unfiltered(self, machine: Machine, moving: Motion, alike: list[Effect]) -> tuple[Array, Array]:
        """Return the residual of momentum [N m s] and of static torque [N m], each (T' - 1, R), before the filters.

        The residual torque is d/dt of the first plus the second.

        machine: whose geometry and effects are used
        moving:  its motion
        alike:   effects that are omitted
        """
        empty = self.model.empty
        whole = empty if machine is empty.machine else Regressor(machine, empty.effects)
        momentum, static = whole.products(moving, self.tares, alike)
        return -momentum, whole.torque(moving) - static

    @cached_property
    def _filter(self) -> FilteredRegressor:
        """Filters of momentum and static torque."""
        f = self.model.filters
        return FilteredRegressor(self.model.empty, 1.0 / f.rate_hz, f.regressor_hz, f.smoothing_hz)


def _linked(machine: Machine) -> tuple[tuple[Link, ...], float]:
    """Return the parts of a machine that do not belong to its cylinders: links, distance of the slew axis [m]."""
    return machine.links, machine.slew_axis


def _changed(values: Array, plain: Array) -> NDArray[np.bool_]:
    """Return which columns (S,) of `values` (T, S) differ from those of `plain` (T, S)."""
    count = values.shape[1]
    return np.bincount(np.flatnonzero(values != plain) % count, minlength=count) > 0


def _alike(effect: Effect, one: Motion, other: Motion) -> bool:
    """Return whether the parts of the motion on which an effect depends are the same in two motions."""
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in depends_on(effect))
