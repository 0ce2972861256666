"""Interaction force: what the actuators had to supply beyond the tares is -(dP/dq)^T F (PHYSICS section 8)."""

from dataclasses import dataclass
from math import atan2, hypot, sqrt

import numpy as np

from cylforce.core.model import Model, Tares
from cylforce.core.weighing import Residual
from cylforce.regression.regressor import Rows
from cylforce.words.estimate import Array, Force, Quantity, Reason, Status, invalid, invalid_force

SINGULAR = (
    1e-3  # ratio of singular values of the scaled tool columns below which a direction cannot be sensed
)


@dataclass(frozen=True)
class ForceSensor:
    """Force at the tool: with three torques the resultant and its moment about the last pin's body, with two the force on
    the known contact line (the paper's mode)."""

    model: Model
    tares: Tares
    rated_force: float

    def estimate(self, rows: Rows, left: Residual, usable: Array) -> Force:
        """The force of one instant; INVALID where a direction cannot be sensed."""
        tool = rows.columns[..., self.model.tool]
        tool = tool if len(left.torque) > 2 else tool[:, :2]
        if not np.all(usable):
            return invalid_force(Reason.DEAD_POINT)
        scale = np.abs(tool).max(axis=0) + 1e-9
        left_vectors, singular, right_vectors = np.linalg.svd(tool / scale, full_matrices=False)
        if singular[-1] < SINGULAR or tool.shape[0] < tool.shape[1]:
            return invalid_force(Reason.SINGULAR)
        gain = (right_vectors.T / singular) @ left_vectors.T / scale[:, None]  # the pseudo-inverse of tool
        noise = np.diag(left.variance + left.rest) + left.columns @ self.tares.covariance @ left.columns.T
        spread = gain @ noise @ gain.T
        x, z = gain[:2] @ left.torque
        return self._force(float(x), float(z), spread[:2, :2])

    def _force(self, x: float, z: float, spread: Array) -> Force:
        size = hypot(x, z)
        unit = np.array([x, z]) / size if size > 0.0 else np.array([1.0, 0.0])
        across = np.array([-unit[1], unit[0]])
        along_error, across_error = sqrt(unit @ spread @ unit), sqrt(across @ spread @ across)
        certain = size > 3.0 * across_error
        turn = across_error / size if certain else float("nan")
        direction = self._quantity(atan2(z, x), turn) if certain else invalid(Reason.UNCERTAIN)
        return Force(
            self._bounded(x, sqrt(spread[0, 0])),
            self._bounded(z, sqrt(spread[1, 1])),
            self._bounded(size, along_error),
            direction,
        )

    def _bounded(self, value: float, error: float) -> Quantity:
        if abs(value) > self.rated_force:
            return invalid(Reason.OUT_OF_DECLARED_RANGE)
        return self._quantity(value, error) if error < self.rated_force else invalid(Reason.SINGULAR)

    def _quantity(self, value: float, error: float) -> Quantity:
        if not self.tares.identified:
            return Quantity(value, error, Status.DEGRADED, Reason.NOT_IDENTIFIED)
        return Quantity(value, error, Status.OK, Reason.NONE)
