"""Interaction force: what the actuators had to supply beyond the tares is -(dP/dq)^T F
(mechanics/README.md, section 8)."""

from math import hypot

import numpy as np

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.model import Tares
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array, Force, Quantity, Reason, Status, invalid
from cylforce.signals.units import STANDARD_GRAVITY

BLIND = 0.3  # times the rated force: a component with a larger standard error is INVALID; chosen
POOR = 0.05  # times the rated force: a component with a larger standard error is DEGRADED; chosen
CLEAR = 3.0  # standard errors across it by which a force must be larger to have a direction; chosen


def prior(machine: Machine, rated_force: float) -> Array:
    """Return the information (T, T) on the force at the tool before it is measured: forces of the rated force, a moment
    of that of a full payload."""
    moment = machine.rated_payload * STANDARD_GRAVITY * machine.payload_reach
    known = np.array([rated_force, rated_force, moment])
    return np.diag(known[: 3 if len(machine.rows) > 2 else 2] ** -2.0)


class ForceSensor:
    """Status of a force at the tool. With three measured torques: force and moment on the last link. With two: the
    force at the known tooth line (the paper's method), without a moment.

    The estimate has a prior: forces with a standard error of the rated force, a moment with that of a full payload.
    Therefore a singular pose or a missing row needs no special case: a direction that the pose does not show keeps this
    large standard error.

    identified:  whether the tares are from a recording
    rated_force: [N]
    """

    def __init__(self, tares: Tares, rated_force: float) -> None:
        self.identified, self.rated_force = tares.identified, rated_force
        self._blind, self._poor = BLIND * rated_force, POOR * rated_force

    def force(self, shown: Numbers, contact: bool, late: tuple[float, float] = (0.0, 0.0)) -> Force:
        """Return the published force.

        A component whose standard error exceeds BLIND is INVALID, but not because of the error of a force that is late.
        There is no direction unless the force is larger than CLEAR standard errors across it, nor without contact;
        NO_CONTACT is then the reason.

        shown:   of the kernel (`pushed.publish`)
        contact: whether the force is the ground's or a load's
        late:    error (x, z) because the force is late [N]
        """
        x, z, size, angle, x_error, z_error, along, across, xx, xz, zz, certain, worst, largest = shown
        fine = Reason.NONE if contact else Reason.NO_CONTACT
        if worst <= self._poor and largest <= self.rated_force and self.identified:
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
        """Return a component or the magnitude. A pose that does not show the force is recognised by the error without
        that of a `late` force."""
        if not error * error - late * late <= self._blind * self._blind:
            return invalid(Reason.SINGULAR)
        if not abs(value) <= self.rated_force:  # also true for NaN, to which absurd parameters may lead
            return invalid(Reason.OUT_OF_DECLARED_RANGE)
        return self._quantity(value, error, fine)

    def _quantity(self, value: float, error: float, fine: Reason) -> Quantity:
        """Return the value with its status; where that is OK, the reason is `fine`."""
        if not self.identified:
            return Quantity(value, error, Status.DEGRADED, Reason.NOT_IDENTIFIED)
        if error > self._poor:
            return Quantity(value, error, Status.DEGRADED, Reason.UNCERTAIN)
        return Quantity(value, error, Status.OK, fine)


UNCERTAIN, NO_CONTACT = invalid(Reason.UNCERTAIN), invalid(Reason.NO_CONTACT)
