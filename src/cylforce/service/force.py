"""Interaction force: what the actuators had to supply beyond the tares is -(dP/dq)^T F
(mechanics/README.md, section 8)."""

from dataclasses import dataclass
from functools import cached_property
from math import atan2, hypot, sqrt

import numpy as np

from cylforce.estimation.model import Model, Tares
from cylforce.estimation.regressor import Rows
from cylforce.estimation.residual import Residual
from cylforce.signals.estimate import Array, Force, Quantity, Reason, Status, invalid, invalid_force
from cylforce.signals.units import STANDARD_GRAVITY

BLIND = 0.3  # standard error, as a share of the rated force, from which on a component counts as not sensed
POOR = 0.05  # and from which on it is only DEGRADED


@dataclass(frozen=True)
class ForceSensor:
    """Force at the tool: with three torques the resultant and its moment on the last link, with two the force on the
    known contact line (the paper's mode).

    What a pose does not show stays as uncertain as it was before: a force within the rated one, a moment as of a full
    load. So neither a singular pose nor a lost row needs a special case; its direction has a large standard error."""

    model: Model
    tares: Tares
    rated_force: float

    @cached_property
    def _prior(self) -> Array:
        machine = self.model.machine
        moment = machine.rated_payload * STANDARD_GRAVITY * machine.payload_reach
        known = np.array([self.rated_force, self.rated_force, moment])
        return np.diag(known[: 3 if len(machine.rows) > 2 else 2] ** -2.0)

    def estimate(self, rows: Rows, left: Residual, usable: Array) -> Force:
        """The force of one instant; a component that cannot be sensed is INVALID."""
        if not usable.any():
            return invalid_force(Reason.DEAD_POINT)
        tool = rows.columns[usable, self.model.tool][:, : len(self._prior)]
        columns = left.columns[usable]
        noise = np.diag((left.variance + left.rest)[usable]) + columns @ self.tares.covariance @ columns.T
        weighted = np.linalg.solve(noise, tool).T
        spread = np.asarray(np.linalg.inv(weighted @ tool + self._prior), dtype=np.float64)
        found = (spread @ (weighted @ left.torque[usable]))[:2]
        spread = spread[:2, :2] + self.tares.scale_error**2 * np.outer(found, found)
        x, z = found
        return self._force(float(x), float(z), spread[:2, :2])

    def _force(self, x: float, z: float, spread: Array) -> Force:
        size = hypot(x, z)
        (xx, xz), (_, zz) = spread.tolist()
        cos, sin = (x / size, z / size) if size > 0.0 else (1.0, 0.0)
        along_error = sqrt(abs(cos * cos * xx + 2.0 * cos * sin * xz + sin * sin * zz))
        across_error = sqrt(abs(sin * sin * xx - 2.0 * cos * sin * xz + cos * cos * zz))
        certain = size > 3.0 * across_error
        turn = across_error / size if certain else float("nan")
        direction = self._quantity(atan2(z, x), turn) if certain else invalid(Reason.UNCERTAIN)
        return Force(
            self._bounded(x, sqrt(xx)),
            self._bounded(z, sqrt(zz)),
            self._bounded(size, along_error),
            direction,
            (xx, xz, zz),
        )

    def _bounded(self, value: float, error: float) -> Quantity:
        if not error <= BLIND * self.rated_force:
            return invalid(Reason.SINGULAR)
        if not abs(value) <= self.rated_force:  # NaN is not: parameters that cannot be may overflow
            return invalid(Reason.OUT_OF_DECLARED_RANGE)
        return self._quantity(value, error)

    def _quantity(self, value: float, error: float) -> Quantity:
        if not self.tares.identified:
            return Quantity(value, error, Status.DEGRADED, Reason.NOT_IDENTIFIED)
        if error > POOR * self.rated_force:
            return Quantity(value, error, Status.DEGRADED, Reason.UNCERTAIN)
        return Quantity(value, error, Status.OK, Reason.NONE)
