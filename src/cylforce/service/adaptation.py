"""Slow adaptation in service: friction and pressure zeros follow temperature and wear, while the bucket returns empty.

The parameters identified at commissioning remain the reference; only their drift is estimated. What sticks in the
bucket is unknown, and another amount in every return: it is estimated beside the drift, so that only what no load
explains is taken for a drift. The recursive least squares forget only what the present motion measures, so that nothing
changes while the machine is parked. The drift is limited to what is physically possible, and is also given in
kilograms."""

from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.drift import drift_spread, kinds
from cylforce.estimation.model import CERTAIN_SHARE, EXPECTED, BetweenStrokes, Model, Tares
from cylforce.estimation.recursive import Root, forget, update
from cylforce.estimation.regressor import Rows
from cylforce.estimation.residual import SMALLEST
from cylforce.signals.estimate import Array

MEMORY_SECONDS = 30.0  # s of empty motion after which old information has faded to 1/e; chosen
STROKE_SECONDS = 3.0  # s, duration of a typical stroke, over which model errors keep their sign; chosen
EVERY = 5  # steps between updates, because neighbouring samples contain the same information; chosen
ZERO_LIMIT = 6e5  # Pa, limit of a pressure's zero drift; chosen
FRICTION_RANGE = (0.1, 10.0)  # times the identified friction: limits of the adapted friction, of oil from 0 to 100 degC
PRIOR_COUNT = 1.0  # measurements that the prior spread of the drift is worth; chosen: one
LOAD = 4  # parameters of a load: m, m x, m z, J
SHOWN = 0.02  # share of the difference by which each update changes the drift in kilograms; chosen: smooths it


class Drift(NamedTuple):
    """State of the adaptation: `values` (D,) to be added to the tares (Coulomb and viscous friction, then pressure
    zeros) with `covariance` (D, D); information `root` about the load that remains in the bucket (4), with its prior,
    and the drift (D), without; `scale` (2,): variance of friction and of zeros in units of the prior's;
    `waited`: steps since the last update; `mass` [kg] that the empty bucket would show without the adaptation;
    `following`: whether this instant was usable, else nothing changes; `seen`: whether the information is in part about
    what remains in the bucket now."""

    root: Root
    values: Array
    covariance: Array
    scale: Array
    waited: int
    mass: float
    following: bool
    seen: bool


@dataclass(frozen=True)
class Adapter:
    """The adaptation of one machine; `expected`: the drift before anything is seen of it."""

    model: Model
    tares: Tares
    expected: BetweenStrokes = EXPECTED

    @cached_property
    def _limits(self) -> tuple[Array, Array]:
        friction = np.abs(self.tares.values[self.model.changing_friction])
        zero = np.array([ZERO_LIMIT * c.area_head for c in self.model.machine.cylinders])
        low = np.concatenate([(FRICTION_RANGE[0] - 1.0) * friction, -zero])
        return low, np.concatenate([(FRICTION_RANGE[1] - 1.0) * friction, zero])

    @property
    def _memory(self) -> float:
        """Updates that count as one independent measurement: model errors keep their sign for about one stroke."""
        return STROKE_SECONDS * self.model.filters.rate_hz / EVERY

    @cached_property
    def _spread(self) -> Array:
        """Prior standard errors (D,) of the drift."""
        return drift_spread(self.model, self.tares.values, self.expected)

    def begin(self) -> Drift:
        """The state without drift, with the prior standard errors above."""
        drift = np.zeros_like(self._spread)
        factor = np.diag(np.concatenate([1.0 / self._remainder, drift]))
        root, spread = Root(factor, np.zeros(len(factor))), np.diag(self._spread**2)
        return Drift(root, drift, spread, np.ones(2), 0, 0.0, following=False, seen=False)

    @cached_property
    def _remainder(self) -> Array:
        """Standard errors (4,) of what remains in an empty bucket, before anything is seen of it: evenly within what
        counts as empty, anywhere in the bucket."""
        machine = self.model.machine
        reach = machine.payload_reach
        evenly = SMALLEST / sqrt(3.0) * machine.rated_payload
        return evenly * np.array([1.0, reach, reach, reach**2], dtype=np.float64)

    def loaded(self, drift: Drift) -> Drift:
        """The state after the bucket was not empty: what remains in it next time is unknown.

        The triangle of the root lists the load first, so that its lower part is the information about the drift that is
        left when the load is unknown."""
        if not drift.seen:
            return drift._replace(following=False) if drift.following else drift
        factor, right = np.zeros_like(drift.root.factor), np.zeros_like(drift.root.right)
        factor[LOAD:, LOAD:], right[LOAD:] = drift.root.factor[LOAD:, LOAD:], drift.root.right[LOAD:]
        factor[:LOAD, :LOAD] = np.diag(1.0 / self._remainder)
        return drift._replace(root=Root(factor, right), following=False, seen=False)

    def columns(self, rows: Rows) -> Array:
        """Columns (R, D) of the adapted parameters."""
        return np.asarray(rows.columns[..., self.model.changing])

    def step(self, drift: Drift, rows: Rows, torque: Array, variance: Array) -> Drift:
        """The drift after one instant with residual `torque` (R,) [N m], from which the drift so far is already
        subtracted, and `variance` (R,) [N^2 m^2], infinite unless the bucket is known to be empty and in the air.

        Rows at very low speed are not used: break-away friction would appear there as a pressure zero and, with the
        opposite sign, as Coulomb friction. A boom that always moves down while the bucket is empty shows only the sum
        of both, so that such an error would remain."""
        good = np.isfinite(variance) & (self.model.share_at_rest(rows.columns) < CERTAIN_SHARE)
        if not good.any():
            return drift._replace(following=False)
        if drift.waited + 1 < EVERY:
            return drift._replace(waited=drift.waited + 1, following=True)
        drifting = self.columns(rows)
        own = rows.columns[..., : len(self.model.parameters)]
        columns = np.concatenate([own @ self.model.load, drifting], axis=-1)
        keep = 1.0 - EVERY / (MEMORY_SECONDS * self.model.filters.rate_hz)
        root = forget(drift.root, columns[good], keep)
        observed = torque + drifting @ drift.values
        root = update(root, columns[good], observed[good], self._memory * variance[good])
        both, covariance, scale = self._estimate(root, drift.scale)
        limited = np.clip(both[LOAD:], *self._limits)
        if np.any(limited != both[LOAD:]):
            root = Root(root.factor, root.factor @ np.append(both[:LOAD], limited))
        shown = self._mass(drift, drifting @ limited, rows)
        return Drift(root, limited, covariance[LOAD:, LOAD:], scale, 0, shown, following=True, seen=True)

    def _estimate(self, root: Root, scale: Array) -> tuple[Array, Array, Array]:
        """(Load and drift, their covariance, new scale) from what was seen, `root`, and the prior of the drift, whose
        spread is that of this machine: k^2 (2,) of friction and of zeros, one step of expectation maximisation from
        `scale` on, as between strokes (`commissioning.zeros`). A drift that was not seen leaves k as it is.

        The prior is no part of the root: it is not forgotten, nor does it grow where nothing is seen."""
        information = root.factor.T @ root.factor
        information[LOAD:, LOAD:] += np.diag(1.0 / (scale[self._kinds] * self._spread**2))
        unit = np.concatenate([self._remainder, self._spread])
        covariance = unit[:, None] * np.linalg.inv(unit[:, None] * information * unit) * unit
        both = covariance @ (root.factor.T @ root.right)
        squares = (both[LOAD:] ** 2 + np.diag(covariance)[LOAD:]) / self._spread**2
        sums, counts = (np.bincount(self._kinds, w, minlength=2) for w in (squares, np.ones_like(squares)))
        return both, covariance, (PRIOR_COUNT + sums) / (PRIOR_COUNT + counts)

    @cached_property
    def _kinds(self) -> NDArray[np.int_]:
        return kinds(self.model)

    def _mass(self, drift: Drift, torque: Array, rows: Rows) -> float:
        """Mass [kg] of the load that would explain the `torque` (R,) of the drift, smoothed over updates."""
        load = rows.columns[..., : len(self.model.parameters)] @ self.model.load[:, 0] / self.tares.row_error
        now = float(load @ (torque / self.tares.row_error) / (load @ load + 1e-12))
        return drift.mass + SHOWN * (now - drift.mass)
