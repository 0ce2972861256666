"""Interaction force F: the residual torque after tares and drift is -(dP/dq)^T F (mechanics/README.md, section 8)."""

from math import hypot

import numpy as np

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.model import Tares
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array, Force, Quantity, Reason, Status, invalid
from cylforce.signals.units import STANDARD_GRAVITY

BLIND = 0.3  # times the rated force: a component with a larger standard error is INVALID; chosen
POOR = 0.05  # times the rated force: a component with a larger standard error is DEGRADED; chosen
CLEAR = 3.0  # times its standard error across: a smaller force has no direction; chosen


def prior(machine: Machine, rated_force: float) -> Array:
    """Return the diagonal prior information (T, T) [1/N^2, 1/(N m)^2] on force x, z and moment at the tool.

    Prior standard errors are the rated force, and for the moment that of a full payload at its reach. T is 3, or 2
    (forces only) with fewer than three measured torques.

    rated_force: of the machine at the tool [N]
    """
    moment = machine.rated_payload * STANDARD_GRAVITY * machine.payload_reach
    known = np.array([rated_force, rated_force, moment])
    return np.diag(known[: 3 if len(machine.rows) > 2 else 2] ** -2.0)


class ForceSensor:
    """Status of a force at the tool.

    With three measured torques force and moment on the last link are estimated. With two it is the force at the known
    tooth line (the paper's method), without a moment.

    The estimate has a prior: forces with a standard error of the rated force, a moment with that of a full payload.
    Therefore a singular pose or a missing row needs no special case: a direction that the pose does not determine keeps
    this large standard error.

    identified:  whether the tares are from a recording
    rated_force: [N]
    """

    def __init__(self, tares: Tares, rated_force: float) -> None:
        self.identified, self.rated_force = tares.identified, rated_force
        self._blind, self._poor = BLIND * rated_force, POOR * rated_force

    def force(self, shown: Numbers, contact: bool, late: tuple[float, float] = (0.0, 0.0)) -> Force:
        """Return the published force: components, magnitude and direction, each with its status.

        A component (or the magnitude) is INVALID if its standard error, without the part by the latency, exceeds BLIND
        rated forces, or if its value exceeds the rated force. It is DEGRADED above POOR rated forces of standard error,
        or without identified tares. The direction is INVALID where the force is not clearly larger than its standard
        error across it. Without contact the direction is INVALID, and components and magnitude that are OK have the
        reason NO_CONTACT.

        shown:   (14,) from the kernel (`pushed.publish`), in the order of the names below: components x, z and size
                 [N]; angle from x towards z [rad]; standard errors of x, z and size (`along`) [N] and of the angle
                 (`across`) [rad]; covariance of x and z [N^2]; 1 where the direction is certain; largest of the errors
                 of x, z and size; largest of these three values [N]
        contact: whether the ground or, in a resultant, a load acts on the tool, so that there is a force at all
        late:    error (x, z) of the force by its latency [N]
        """
        x, z, size, angle, x_error, z_error, along, across, xx, xz, zz, certain, largest_error, largest = shown
        fine = Reason.NONE if contact else Reason.NO_CONTACT
        if largest_error <= self._poor and largest <= self.rated_force and self.identified:
            force_x = Quantity(x, x_error, Status.OK, fine)
            force_z = Quantity(z, z_error, Status.OK, fine)
            magnitude = Quantity(size, along, Status.OK, fine)
        else:
            late_x, late_z = late
            late_along = (x * late_x + z * late_z) / size if certain > 0.0 else hypot(late_x, late_z)
            force_x, force_z = self._bounded(x, x_error, late_x, fine), self._bounded(z, z_error, late_z, fine)
            magnitude = self._bounded(size, along, late_along, fine)
        if not contact:
            direction = NO_CONTACT
        elif certain > 0.0:
            direction = self._quantity(angle, across, Reason.NONE)
        else:
            direction = UNCERTAIN
        return Force(force_x, force_z, magnitude, direction, (xx, xz, zz))

    def _bounded(self, value: float, error: float, late: float, fine: Reason) -> Quantity:
        """Return a component or the magnitude with its status.

        It is INVALID where the pose does not determine it (SINGULAR), or beyond the rated force
        (OUT_OF_DECLARED_RANGE); otherwise OK or DEGRADED.

        value: of the quantity [N]
        error: its standard error [N]
        late:  part of the error by the latency, which does not count for the pose [N]
        fine:  reason where the status is OK
        """
        if not error * error - late * late <= self._blind * self._blind:
            return invalid(Reason.SINGULAR)
        if not abs(value) <= self.rated_force:  # also true for NaN, to which absurd parameters may lead
            return invalid(Reason.OUT_OF_DECLARED_RANGE)
        return self._quantity(value, error, fine)

    def _quantity(self, value: float, error: float, fine: Reason) -> Quantity:
        """Return a value that the pose determines, with its status: OK or DEGRADED.

        It is DEGRADED without identified tares (NOT_IDENTIFIED), or with a standard error above POOR rated forces
        (UNCERTAIN), which the error of a direction never reaches.

        value: component or magnitude [N], or direction [rad]
        error: its standard error, in the same unit
        fine:  reason where the status is OK
        """
        if not self.identified:
            return Quantity(value, error, Status.DEGRADED, Reason.NOT_IDENTIFIED)
        if error > self._poor:
            return Quantity(value, error, Status.DEGRADED, Reason.UNCERTAIN)
        return Quantity(value, error, Status.OK, fine)


UNCERTAIN, NO_CONTACT = invalid(Reason.UNCERTAIN), invalid(Reason.NO_CONTACT)
