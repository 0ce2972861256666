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

BLIND = 0.3  # times the rated force: a component with a larger standard error is INVALID; chosen
POOR = 0.05  # times the rated force: a component with a larger standard error is DEGRADED; chosen


@dataclass(frozen=True)
class ForceSensor:
    """Force at the tool. With three measured torques: force and moment on the last link. With two: the force at the
    known tooth line (the paper's method), without a moment.

    The estimate has a prior: forces with a standard error of the rated force, a moment with that of a full payload.
    Therefore a singular pose or a missing row needs no special case: a direction that the pose does not show keeps this
    large standard error."""

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
        """The force of one instant from the residual `left` of the rows marked in `usable` (R,). A component whose
        standard error exceeds BLIND is INVALID; the direction is INVALID unless the force is larger than three standard
        errors across it."""
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
        if not abs(value) <= self.rated_force:  # also true for NaN, to which absurd parameters may lead
            return invalid(Reason.OUT_OF_DECLARED_RANGE)
        return self._quantity(value, error)

    def _quantity(self, value: float, error: float) -> Quantity:
        if not self.tares.identified:
            return Quantity(value, error, Status.DEGRADED, Reason.NOT_IDENTIFIED)
        if error > POOR * self.rated_force:
            return Quantity(value, error, Status.DEGRADED, Reason.UNCERTAIN)
        return Quantity(value, error, Status.OK, Reason.NONE)
