"""Regressor: a machine and an ordered tuple of effects, their columns side by side, filtered so that no acceleration is
needed (mechanics/README.md, section 5)."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.effects.effect import Effect, Parameter
from cylforce.estimation.filters import Filter, first_order, poles, second_order
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion, joint_torque
from cylforce.signals.estimate import Array


class SparseHalves(NamedTuple):
    """Columns of several effects side by side: torque = d/dt (momentum @ p[places]) + static @ p.

    momentum: (..., R, M) columns of the M parameters whose effects have a momentum
    places:   (M,) numbers of these parameters among all P, ascending
    static:   (..., R, P) columns of all parameters
    """

    momentum: Array
    places: NDArray[np.intp]
    static: Array


@dataclass(frozen=True)
class Regressor:
    """Columns of several effects side by side, for the R measured torques of a machine. Columns of the same name are
    added.

    machine: the machine
    effects: effects in the order of their columns
    """

    machine: Machine
    effects: tuple[Effect, ...]

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The P parameters of all effects, each once, in the order of first appearance."""
        return tuple(dict.fromkeys(p for e in self.effects for p in e.parameters(self.machine)))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(p.name for p in self.parameters)

    @cached_property
    def _numbers(self) -> tuple[list[int], ...]:
        """For each effect the numbers of its columns among all P."""
        numbers = {p: k for k, p in enumerate(self.parameters)}
        return tuple([numbers[p] for p in e.parameters(self.machine)] for e in self.effects)

    @cached_property
    def _places(self) -> tuple[Array | slice, ...]:
        """For each effect the numbers of its columns among all P, as an index."""
        return tuple(map(_compact, self._numbers))

    @cached_property
    def _shared(self) -> tuple[bool, ...]:
        """For each effect whether it has a parameter in common with an earlier effect."""
        named = [set(e.parameters(self.machine)) for e in self.effects]
        return tuple(bool(own & set().union(*named[:k])) for k, own in enumerate(named))

    @cached_property
    def _rows(self) -> tuple[int, ...] | slice:
        """Joints whose torque is measured, as an index of the joints' axis."""
        rows = self.machine.rows
        return slice(None) if rows == tuple(range(self.machine.size)) else rows

    def both_halves(self, moving: Motion) -> tuple[Array, Array]:
        """Return momentum and static columns, each (..., R, P): torque = d/dt (momentum @ p) + static @ p.

        R are the measured joint torques [N m], p are the P parameters of all effects. Columns of a parameter that
        several effects share are added.

        moving: motion of the machine at one or more instants (...)
        """
        found = self.halves(moving)
        momentum = np.zeros(found.static.shape)
        momentum[..., found.places] = found.momentum
        return momentum, found.static

    def halves(self, moving: Motion) -> SparseHalves:
        """Return the columns of `both_halves` as static (..., R, P) and momentum (..., R, M).

        M are the parameters of the effects that have a momentum.

        moving: motion of the machine at one or more instants (...)
        """
        parts = [effect.halves(self.machine, moving) for effect in self.effects]
        lead, shape = moving.q.shape[:-1], (*moving.q.shape, len(self.parameters))
        static = np.zeros(shape)
        for part, places, shared in zip(parts, self._places, self._shared, strict=True):
            if shared:
                static[..., places] += part.static
            else:
                static[..., places] = part.static
        moved = [
            (part.momentum, own) for part, own in zip(parts, self._numbers, strict=True) if part.momentum is not None
        ]
        numbers = sorted({number for _, own in moved for number in own})
        momentum = np.zeros((*lead, self.machine.size, len(numbers)))
        for columns, own in moved:
            momentum[..., _compact([numbers.index(number) for number in own])] += columns
        return SparseHalves(momentum[..., self._rows, :], np.array(numbers, dtype=np.intp), static[..., self._rows, :])

    def products(self, moving: Motion, values: Array, without: Collection[Effect] = ()) -> tuple[Array, Array]:
        """Return momentum [N m s] and static torque [N m] of the effects at these parameters, each (..., R).

        The torque of a measured joint is d/dt momentum + static torque.

        moving:  motion of the machine at one or more instants (...)
        values:  (P,) parameters
        without: effects that are omitted
        """
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
        """Return the measured torque (..., R) [N m]: the sum of the cylinders' forces times their levers.

        moving: motion of the machine at one or more instants (...)
        """
        return joint_torque(moving)[..., self._rows]


def _times(columns: Array, values: Array) -> Array:
    """Return columns (..., N, P) @ values (P,), computed as one matrix product for speed."""
    return np.asarray((columns.reshape(-1, len(values)) @ values).reshape(columns.shape[:-1]))


def _compact(places: list[int]) -> Array | slice:
    """Return the indices `places` as a slice if they are consecutive and ascending, else as an array (n,).

    Indexing with a slice is much faster."""
    if places == list(range(places[0], places[0] + len(places))):
        return slice(places[0], places[0] + len(places))
    return np.array(places)


class Rows(NamedTuple):
    """Filtered rows, torque = columns @ parameters.

    columns: (..., R, P) filtered columns
    torque:  (..., R) filtered torque [N m]
    """

    columns: Array
    torque: Array


@dataclass(frozen=True)
class FilteredRegressor:
    """Filtered rows S (d/dt L momentum + L static) = S L torque: L low-pass of first order, S low-pass of second order.

    Both are one filter with two numerators: `filters.slope` for the momentum, `filters.mean` for static columns and
    torque. At the start the filter of the momentum is settled at its first input. That of static columns and torque
    begins as after an input of zero (`_begun`). The identity then holds from the first sample on.

    regressor:    the columns before the filters
    dt:           fixed step [s]
    regressor_hz: cut-off of L
    smoothing_hz: cut-off of S
    """

    regressor: Regressor
    dt: float
    regressor_hz: float
    smoothing_hz: float

    @cached_property
    def mean(self) -> Filter:
        """Filter of static columns and torque."""
        low = poles(first_order(self.regressor_hz, self.dt), second_order(self.smoothing_hz, self.dt))
        return Filter(tuple(low.b[0] * share / 8.0 for share in (1.0, 3.0, 3.0, 1.0)), low.a)

    @cached_property
    def slope(self) -> Filter:
        """Filter of momentum."""
        gain = 8.0 * self.mean.b[0] / (3.0 * self.dt)
        return Filter((gain, 0.0, 0.0, -gain), self.mean.a)

    @property
    def delay(self) -> float:
        """Delay of the rows behind the motion [s], for slow signals."""
        return self.mean.delay * self.dt

    def _begun(self, static: Array) -> Array:
        """Return the state (3, ...) of the filter `mean` before the first sample `static` (...).

        The input was zero before. The mean of four samples of a step to `static` is made 0, 1/3 and 2/3 at the first
        three outputs, then the whole: so `slope` responds to a momentum that begins to rise evenly with this step."""
        return np.stack([share * static for share in self.shares])

    @cached_property
    def shares(self) -> tuple[float, ...]:
        """State (3,) of the filter `mean` before a first input of 1, after zeros."""
        b = self.mean.b
        return tuple(step * sum(b) / 3.0 - sum(b[: step + 1]) for step in range(3))

    def run(self, moving: Motion) -> Rows:
        """Return the filtered rows of a recording: columns (T, R, P) and torque (T, R) [N m].

        moving: motion of the machine, whose leading axis is time, T steps
        """
        halves, torque = self.regressor.halves(moving), self.regressor.torque(moving)
        columns = self.mean.run(self._begun(halves.static[0]), halves.static)[1]
        # Most effects have no momentum, that of others is zero where nothing turns: only the rest is filtered.
        turns = np.any(halves.momentum, axis=(0, 1))
        momentum = halves.momentum[..., turns]
        columns[..., halves.places[turns]] += self.slope.run(self.slope.rest(momentum[0]), momentum)[1]
        return Rows(columns, self.mean.run(self._begun(torque[0]), torque)[1])

    def left(self, moving: Motion, values: Array) -> Array:
        """Return the filtered residual torque (T, R) [N m] along a recording: measured less that of the parameters.

        moving: motion of the machine, whose leading axis is time, T steps
        values: (P,) parameters of all effects
        """
        momentum, static = self.regressor.products(moving, values)
        return self.filtered(-momentum, self.regressor.torque(moving) - static)

    def filtered(self, momentum: Array, static: Array) -> Array:
        """Return S (d/dt L momentum + L static) of a recording, `momentum` and `static` (T, ...)."""
        moved = self.slope.run(self.slope.rest(momentum[0]), momentum)[1]
        return np.asarray(self.mean.run(self._begun(static[0]), static)[1] + moved)
