"""Slow adaptation in service: friction and pressure zeros follow temperature and wear, while the bucket returns empty.

The parameters identified at commissioning remain the reference; only their drift is estimated. The recursive least
squares forget only what the present motion measures, so that nothing changes while the machine is parked. The drift is
limited to what is physically possible, and is also given in kilograms."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cylforce.estimation.model import CERTAIN_SHARE, Model, Tares
from cylforce.estimation.recursive import Root, forget, known, solution, update
from cylforce.estimation.regressor import Rows
from cylforce.signals.estimate import Array

MEMORY_SECONDS = 30.0  # s of empty motion after which old information has faded to 1/e; chosen
STROKE_SECONDS = 3.0  # s, duration of a typical stroke, over which model errors keep their sign; chosen
EVERY = 5  # steps between updates, because neighbouring samples contain the same information; chosen
ZERO_ERROR, ZERO_LIMIT = 3e4, 6e5  # Pa, prior standard error of a pressure's zero drift, and its limit; chosen
FRICTION_ERROR = 0.1  # times the identified friction: prior standard error of its drift; chosen
FRICTION_RANGE = (0.2, 3.0)  # times the identified friction: limits of the adapted friction; chosen
SHOWN = 0.02  # share of the difference by which each update changes the drift in kilograms; chosen: smooths it


class Drift(NamedTuple):
    """State of the adaptation: `values` (D,) to be added to the tares (Coulomb and viscous friction, then pressure
    zeros), their information `root`; `waited`: steps since the last update; `mass` [kg] that the empty bucket would
    show without the adaptation; `following`: whether this instant was usable, else nothing changes."""

    root: Root
    values: Array
    waited: int
    mass: float
    following: bool


@dataclass(frozen=True)
class Adapter:
    """The adaptation of one machine."""

    model: Model
    tares: Tares

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

    def begin(self) -> Drift:
        """The state without drift, with the prior standard errors above; old information fades within the memory."""
        zero = [ZERO_ERROR * c.area_head for c in self.model.machine.cylinders]
        floor = [1e-3 * self.model.machine.cylinders[0].area_head * 1e5] * len(self.model.changing_friction)
        friction = np.maximum(FRICTION_ERROR * np.abs(self.tares.values[self.model.changing_friction]), floor)
        spread = np.concatenate([friction, zero])
        return Drift(known(np.zeros_like(spread), spread), np.zeros_like(spread), 0, 0.0, False)

    def columns(self, rows: Rows) -> Array:
        """Columns (R, D) of the adapted parameters."""
        return np.concatenate(
            [rows.columns[..., self.model.changing_friction], rows.columns[..., self.model.zero]], axis=-1
        )

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
        columns = self.columns(rows)
        keep = 1.0 - EVERY / (MEMORY_SECONDS * self.model.filters.rate_hz)
        root = forget(drift.root, columns[good], keep)
        observed = torque + columns @ drift.values
        root = update(root, columns[good], observed[good], self._memory * variance[good])
        values, _ = solution(root)
        limited = np.clip(values, *self._limits)
        if np.any(limited != values):
            root = Root(root.factor, root.factor @ limited)
        return Drift(root, limited, 0, self._mass(drift, columns @ limited, rows), True)

    def _mass(self, drift: Drift, torque: Array, rows: Rows) -> float:
        """Mass [kg] of the load that would explain the `torque` (R,) of the drift, smoothed over updates."""
        load = rows.columns[..., : len(self.model.parameters)] @ self.model.load[:, 0] / self.tares.row_error
        now = float(load @ (torque / self.tares.row_error) / (load @ load + 1e-12))
        return drift.mass + SHOWN * (now - drift.mass)
