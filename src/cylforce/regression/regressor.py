"""The regressor: a Machine and an ordered tuple of effects, their columns side by side, filtered so that no
acceleration is needed (PHYSICS section 5)."""

from dataclasses import dataclass
from functools import cached_property
from math import pi
from typing import NamedTuple

import numpy as np

from cylforce.machine.effect import Effect, Parameter
from cylforce.machine.machine import Machine
from cylforce.machine.motion import Motion, joint_torque
from cylforce.regression.filters import Filter, first_order, second_order
from cylforce.words.estimate import Array


@dataclass(frozen=True)
class Regressor:
    """Columns of several effects for the R measured torques of a machine; columns of one name are added."""

    machine: Machine
    effects: tuple[Effect, ...]

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The P parameters, each once, in the order of first appearance."""
        return tuple(dict.fromkeys(p for e in self.effects for p in e.parameters(self.machine)))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The parameters' names."""
        return tuple(p.name for p in self.parameters)

    @cached_property
    def _places(self) -> tuple[Array | slice, ...]:
        places = {p: k for k, p in enumerate(self.parameters)}
        return tuple(_compact([places[p] for p in e.parameters(self.machine)]) for e in self.effects)

    @cached_property
    def _shared(self) -> tuple[bool, ...]:
        """For each effect whether an earlier one has a parameter of it."""
        named = [set(e.parameters(self.machine)) for e in self.effects]
        return tuple(bool(own & set().union(*named[:k])) for k, own in enumerate(named))

    @cached_property
    def _rows(self) -> tuple[int, ...] | slice:
        rows = self.machine.rows
        return slice(None) if rows == tuple(range(self.machine.size)) else rows

    def both_halves(self, moving: Motion) -> tuple[Array, Array]:
        """Momentum and static columns, each (..., R, P)."""
        shape = (*moving.q.shape[:-1], self.machine.size, len(self.parameters))
        momentum, static = np.zeros(shape), np.zeros(shape)
        for effect, places, shared in zip(self.effects, self._places, self._shared, strict=True):
            part = effect.halves(self.machine, moving)
            if shared:
                static[..., places] += part.static
            else:
                static[..., places] = part.static
            if part.momentum is not None:
                momentum[..., places] += part.momentum
        return momentum[..., self._rows, :], static[..., self._rows, :]

    def torque(self, moving: Motion) -> Array:
        """Measured torque (..., R) [N m]."""
        return joint_torque(moving)[..., self._rows]


def _compact(places: list[int]) -> Array | slice:
    """A slice where the places are neighbours: much faster than an array of indices."""
    if places == list(range(places[0], places[0] + len(places))):
        return slice(places[0], places[0] + len(places))
    return np.array(places)


class Rows(NamedTuple):
    """Filtered columns (..., R, P) and filtered torque (..., R): torque = columns @ parameters."""

    columns: Array
    torque: Array


class FilterState(NamedTuple):
    """States of the first-order and of the smoothing filter, for (R, P+1) columns, torque last."""

    first: Array
    smooth: Array


@dataclass(frozen=True)
class FilteredRegressor:
    """w (momentum - L momentum) + L static = L torque, both sides smoothed by the same second-order low-pass.

    L starts at the first momentum, so that the identity holds from the first sample; all other states start at zero."""

    regressor: Regressor
    dt: float
    regressor_hz: float
    smoothing_hz: float

    @cached_property
    def _first(self) -> Filter:
        return first_order(self.regressor_hz, self.dt)

    @cached_property
    def _smooth(self) -> Filter:
        return second_order(self.smoothing_hz, self.dt)

    def _inputs(self, moving: Motion) -> tuple[Array, Array]:
        """w * momentum and static - w * momentum (..., R, P+1), the torque as the last static column."""
        (left, static), torque = self.regressor.both_halves(moving), self.regressor.torque(moving)
        momentum = np.concatenate([left, np.zeros((*torque.shape, 1))], axis=-1) * (2 * pi * self.regressor_hz)
        return momentum, np.concatenate([static, torque[..., None]], axis=-1) - momentum

    def begin(self, moving: Motion) -> FilterState:
        """State before the first sample."""
        momentum, rest = self._inputs(moving)
        return FilterState(self._first.start(rest, -momentum), self._smooth.zero(momentum.shape))

    def step(self, state: FilterState, moving: Motion) -> tuple[FilterState, Rows]:
        """One sample."""
        momentum, rest = self._inputs(moving)
        first, low = self._first.step(state.first, rest)
        smooth, rows = self._smooth.step(state.smooth, momentum + low)
        return FilterState(first, smooth), Rows(rows[..., :-1], rows[..., -1])

    def run(self, moving: Motion) -> Rows:
        """A recording: leading axis is time."""
        momentum, rest = self._inputs(moving)
        _, low = self._first.run(self._first.start(rest[0], -momentum[0]), rest)
        _, rows = self._smooth.run(self._smooth.zero(momentum.shape[1:]), momentum + low)
        return Rows(rows[..., :-1], rows[..., -1])

    def left(self, moving: Motion, values: Array) -> Array:
        """What parameters `values` (P,) leave of the filtered torque (T, R), along a recording."""
        momentum, static = self.regressor.both_halves(moving)
        known = (momentum @ values) * (2 * pi * self.regressor_hz)
        rest = static @ values - known - self.regressor.torque(moving)
        _, low = self._first.run(self._first.start(rest[0], -known[0]), rest)
        _, rows = self._smooth.run(self._smooth.zero(known.shape[1:]), known + low)
        return np.asarray(-rows)
