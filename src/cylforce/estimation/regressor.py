"""The regressor: a Machine and an ordered tuple of effects, their columns side by side, filtered so that no
acceleration is needed (mechanics/README.md, section 5)."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cylforce.effects.effect import Effect, Parameter
from cylforce.estimation.filters import Filter, first_order, poles, second_order
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion, joint_torque
from cylforce.signals.estimate import Array


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

    def products(self, moving: Motion, values: Array, without: Collection[Effect] = ()) -> tuple[Array, Array]:
        """Momentum and static columns times `values` (P,), each (..., R); those of some effects may be left out."""
        momentum, static = np.zeros((2, *moving.q.shape))
        for effect, places in zip(self.effects, self._places, strict=True):
            if effect in without:
                continue
            part, own = effect.halves(self.machine, moving), values[places]
            static += _times(part.static, own)
            if part.momentum is not None:
                momentum += _times(part.momentum, own)
        return momentum[..., self._rows], static[..., self._rows]

    def torque(self, moving: Motion) -> Array:
        """Measured torque (..., R) [N m]."""
        return joint_torque(moving)[..., self._rows]


def _times(columns: Array, values: Array) -> Array:
    """Columns (..., N, P) @ values (P,) as one product, not one for each sample."""
    return np.asarray((columns.reshape(-1, len(values)) @ values).reshape(columns.shape[:-1]))


def _compact(places: list[int]) -> Array | slice:
    """A slice where the places are neighbours: much faster than an array of indices."""
    if places == list(range(places[0], places[0] + len(places))):
        return slice(places[0], places[0] + len(places))
    return np.array(places)


class Rows(NamedTuple):
    """Filtered columns (..., R, P) and filtered torque (..., R): torque = columns @ parameters."""

    columns: Array
    torque: Array


@dataclass(frozen=True)
class FilteredRegressor:
    """S (d/dt L momentum + L static) = S L torque: L first-order, S the smoothing of second order, as one filter with
    two numerators, the slope's for momentum and the mean's for the rest (`filters.mean`, `filters.slope`).

    It starts as if the momentum had always been the first one and the rest began with the first sample, so that the
    identity holds from there on."""

    regressor: Regressor
    dt: float
    regressor_hz: float
    smoothing_hz: float

    @cached_property
    def _mean(self) -> Filter:
        low = poles(first_order(self.regressor_hz, self.dt), second_order(self.smoothing_hz, self.dt))
        return Filter(tuple(low.b[0] * share / 8.0 for share in (1.0, 3.0, 3.0, 1.0)), low.a)

    @cached_property
    def _slope(self) -> Filter:
        gain = 8.0 * self._mean.b[0] / (3.0 * self.dt)
        return Filter((gain, 0.0, 0.0, -gain), self._mean.a)

    @property
    def delay(self) -> float:
        """By how much a row comes after its motion [s]."""
        return self._mean.delay * self.dt

    def _inputs(self, moving: Motion) -> tuple[Array, Array]:
        """Momentum (..., R, P) and static columns (..., R, P+1), the torque as the last of these."""
        (momentum, static), torque = self.regressor.both_halves(moving), self.regressor.torque(moving)
        return momentum, np.concatenate([static, torque[..., None]], axis=-1)

    def begin(self, moving: Motion) -> Array:
        """State (3, R, P+1) before the first sample."""
        momentum, static = self._inputs(moving)
        state = self._begun(static)
        state[..., :-1] += self._slope.rest(momentum)
        return state

    def _begun(self, static: Array) -> Array:
        """The mean's state before the first sample: of three steps only those since then count, 0, 1/3 and 2/3 of
        it."""
        extra = [step * sum(self._mean.b) / 3.0 - sum(self._mean.b[: step + 1]) for step in range(3)]
        return np.stack([share * static for share in extra])

    def step(self, state: Array, moving: Motion) -> tuple[Array, Rows]:
        """One sample."""
        momentum, static = self._inputs(moving)
        first, *_, last = self._slope.b  # the others are zero
        begun = state.copy()
        begun[0, ..., :-1] += first * momentum
        new, rows = self._mean.step(begun, static)
        new[-1, ..., :-1] += last * momentum
        return new, Rows(rows[..., :-1], rows[..., -1])

    def run(self, moving: Motion) -> Rows:
        """A recording: leading axis is time."""
        momentum, static = self._inputs(moving)
        rows = self._mean.run(self._begun(static[0]), static)[1]
        moved = self._slope.run(self._slope.rest(momentum[0]), momentum)[1]
        return Rows(rows[..., :-1] + moved, rows[..., -1])

    def left(self, moving: Motion, values: Array) -> Array:
        """What parameters `values` (P,) leave of the filtered torque (T, R), along a recording."""
        momentum, static = self.regressor.products(moving, values)
        return self.filtered(-momentum, self.regressor.torque(moving) - static)

    def filtered(self, momentum: Array, static: Array) -> Array:
        """S (d/dt L momentum + L static) of a recording (T, ...)."""
        moved = self._slope.run(self._slope.rest(momentum[0]), momentum)[1]
        return np.asarray(self._mean.run(self._begun(static[0]), static)[1] + moved)
