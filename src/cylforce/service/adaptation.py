"""Slow adaptation in service: friction and zero follow temperature and wear, from empty returns only.

What was identified at commissioning stays the reference; this is the drift on top of it. Recursive least squares
forgets only what the present motion shows (parked, nothing is forgotten and nothing moves), is bounded to what is
physically possible, and says what the drift amounts to in kilograms."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cylforce.estimation.model import CERTAIN_SHARE, Model, Tares
from cylforce.estimation.recursive import Root, forget, known, solution, update
from cylforce.estimation.regressor import Rows
from cylforce.signals.estimate import Array

MEMORY_SECONDS = 30.0  # of empty motion
STROKE_SECONDS = 3.0
EVERY = 5  # steps: neighbouring samples say the same
ZERO_ERROR, ZERO_LIMIT = 3e4, 6e5  # Pa: how far a sensor's zero may be off at the start, and how far off none ever is
FRICTION_ERROR, FRICTION_RANGE = 0.1, (0.2, 3.0)  # the same, of the value at commissioning
SHOWN = 0.02  # share by which each update moves the drift that is shown


class Drift(NamedTuple):
    """`values` (D,) on top of the tares (friction laws of speed, then pressure zeros), their `root`, steps since the
    last update, `mass` [kg] that the empty bucket would show without adaptation; `following`: whether this instant
    told something, else all is frozen."""

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
    def _friction(self) -> list[int]:
        """Columns of the friction that temperature and wear change."""
        wanted = (".coulomb", ".viscous")
        return [k for k, p in enumerate(self.model.parameters) if p.name.endswith(wanted)]

    @cached_property
    def _limits(self) -> tuple[Array, Array]:
        friction = np.abs(self.tares.values[self._friction])
        zero = np.array([ZERO_LIMIT * c.area_head for c in self.model.machine.cylinders])
        low = np.concatenate([(FRICTION_RANGE[0] - 1.0) * friction, -zero])
        return low, np.concatenate([(FRICTION_RANGE[1] - 1.0) * friction, zero])

    @property
    def _memory(self) -> float:
        """Updates that say the same: what the model leaves unexplained keeps its sign for about one stroke."""
        return STROKE_SECONDS * self.model.filters.rate_hz / EVERY

    def begin(self) -> Drift:
        """No drift, and hardly more to be expected yet: what motion shows loosens it within the memory."""
        zero = [ZERO_ERROR * c.area_head for c in self.model.machine.cylinders]
        floor = [1e-3 * self.model.machine.cylinders[0].area_head * 1e5] * len(self._friction)
        friction = np.maximum(FRICTION_ERROR * np.abs(self.tares.values[self._friction]), floor)
        spread = np.concatenate([friction, zero])
        return Drift(known(np.zeros_like(spread), spread), np.zeros_like(spread), 0, 0.0, False)

    def columns(self, rows: Rows) -> Array:
        """Columns (R, D) of what drifts."""
        return np.concatenate([rows.columns[..., self._friction], rows.columns[..., self.model.zero]], axis=-1)

    def step(self, drift: Drift, rows: Rows, torque: Array, variance: Array) -> Drift:
        """Take in what is unexplained, the drift so far taken off, of an instant: `torque` (R,) with `variance` (R,),
        infinite unless the bucket is known to be empty and in the air.

        Rows whose cylinder is hardly faster than at rest do not count: break-away friction there would look like a
        pressure's zero, and with the opposite sign like Coulomb friction, of which a boom that only sinks when the
        bucket is empty shows the sum alone."""
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
        held = np.clip(values, *self._limits)
        if np.any(held != values):
            root = Root(root.factor, root.factor @ held)
        return Drift(root, held, 0, self._mass(drift, columns @ held, rows), True)

    def _mass(self, drift: Drift, torque: Array, rows: Rows) -> float:
        """The load that would explain the drift's torque, smoothed."""
        load = rows.columns[..., : len(self.model.parameters)] @ self.model.load[:, 0] / self.tares.row_error
        now = float(load @ (torque / self.tares.row_error) / (load @ load + 1e-12))
        return drift.mass + SHOWN * (now - drift.mass)
