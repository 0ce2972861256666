"""Interaction force: what the actuators had to supply beyond the tares is -(dP/dq)^T F
(mechanics/README.md, section 8)."""

from dataclasses import dataclass
from functools import cached_property
from math import atan2, hypot, sqrt

import numpy as np

from cylforce.estimation.model import Tares
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array, Force, Quantity, Reason, Status, invalid
from cylforce.signals.units import STANDARD_GRAVITY

BLIND = 0.3  # times the rated force: a component with a larger standard error is INVALID; chosen
POOR = 0.05  # times the rated force: a component with a larger standard error is DEGRADED; chosen
CLEAR = 3.0  # standard errors across it by which a force must be larger to have a direction; chosen


def prior(machine: Machine, rated_force: float) -> Array:
    """Information (T, T) on the force at the tool before it is measured: forces of the rated force, a moment of that of
    a full payload."""
    moment = machine.rated_payload * STANDARD_GRAVITY * machine.payload_reach
    known = np.array([rated_force, rated_force, moment])
    return np.diag(known[: 3 if len(machine.rows) > 2 else 2] ** -2.0)


@dataclass(frozen=True)
class ForceSensor:
    """Force at the tool. With three measured torques: force and moment on the last link. With two: the force at the
    known tooth line (the paper's method), without a moment.

    The estimate has a prior: forces with a standard error of the rated force, a moment with that of a full payload.
    Therefore a singular pose or a missing row needs no special case: a direction that the pose does not show keeps this
    large standard error."""

    tares: Tares
    rated_force: float

    @cached_property
    def _blind(self) -> float:
        return BLIND * self.rated_force

    @cached_property
    def _poor(self) -> float:
        return POOR * self.rated_force

    @cached_property
    def _certain_scale(self) -> float:
        """Variance of the scale."""
        return self.tares.scale_error**2

    def force(self, x: float, z: float, xx: float, xz: float, zz: float, contact: bool) -> Force:
        """The published force for x, z [N] with covariance xx, xz, zz [N^2] without that of the scale. A component
        whose standard error exceeds BLIND is INVALID; there is no direction unless the force is larger than CLEAR
        standard errors across it, nor without `contact`; NO_CONTACT is then the reason."""
        scale = self._certain_scale
        xx, xz, zz = xx + scale * (x * x), xz + scale * (x * z), zz + scale * (z * z)
        size = hypot(x, z)
        cos, sin = (x / size, z / size) if size > 0.0 else (1.0, 0.0)
        along_error = sqrt(abs(cos * cos * xx + 2.0 * cos * sin * xz + sin * sin * zz))
        across_error = sqrt(abs(sin * sin * xx - 2.0 * cos * sin * xz + cos * cos * zz))
        certain = size > CLEAR * across_error
        along_error = along_error if certain else hypot(along_error, across_error)
        fine = Reason.NONE if contact else Reason.NO_CONTACT
        return Force(
            self._bounded(x, sqrt(xx), fine),
            self._bounded(z, sqrt(zz), fine),
            self._bounded(size, along_error, fine),
            self._direction(certain, contact, atan2(z, x), across_error / (size + 1e-9)),
            (xx, xz, zz),
        )

    def _direction(self, certain: bool, contact: bool, angle: float, error: float) -> Quantity:
        """Direction [rad]: there is none of a force that is not there, and none of one that is not certain."""
        if not (contact and certain):
            return UNCERTAIN if contact else NO_CONTACT
        return self._quantity(angle, error, Reason.NONE)

    def _bounded(self, value: float, error: float, fine: Reason) -> Quantity:
        """A component or the magnitude; without contact NO_CONTACT is the reason why it is nearly zero."""
        if not error <= self._blind:
            return invalid(Reason.SINGULAR)
        if not abs(value) <= self.rated_force:  # also true for NaN, to which absurd parameters may lead
            return invalid(Reason.OUT_OF_DECLARED_RANGE)
        return self._quantity(value, error, fine)

    def _quantity(self, value: float, error: float, fine: Reason) -> Quantity:
        """The value with its status; where that is OK, the reason is `fine`."""
        if not self.tares.identified:
            return Quantity(value, error, Status.DEGRADED, Reason.NOT_IDENTIFIED)
        if error > self._poor:
            return Quantity(value, error, Status.DEGRADED, Reason.UNCERTAIN)
        return Quantity(value, error, Status.OK, fine)


UNCERTAIN, NO_CONTACT = invalid(Reason.UNCERTAIN), invalid(Reason.NO_CONTACT)
