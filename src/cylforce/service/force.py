"""Interaction force: what the actuators had to supply beyond the tares is -(dP/dq)^T F
(mechanics/README.md, section 8)."""

from dataclasses import dataclass
from math import hypot

import numpy as np

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.model import Tares
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array, Force, Quantity, Reason, Status, invalid
from cylforce.signals.quick import new, once
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

    @once
    def _blind(self) -> float:
        return BLIND * self.rated_force

    @once
    def _poor(self) -> float:
        return POOR * self.rated_force

    def force(self, shown: Numbers, contact: bool, late: tuple[float, float] = (0.0, 0.0)) -> Force:
        """The published force of what the kernel shows of it (`pushed.publish`). A component whose standard error
        exceeds BLIND is INVALID, but not because of the error (x, z) [N] of a force that is `late`; there is no
        direction unless the force is larger than CLEAR standard errors across it, nor without `contact`; NO_CONTACT is
        then the reason."""
        x, z, size, angle, x_error, z_error, along, across, xx, xz, zz, certain, worst, largest = shown
        fine = NONE if contact else WITHOUT
        if worst <= self._poor and largest <= self.rated_force and self.tares.identified:
            each_x = new(Quantity, (x, x_error, OK, fine))
            each_z = new(Quantity, (z, z_error, OK, fine))
            whole = new(Quantity, (size, along, OK, fine))
        else:
            late_x, late_z = late
            each_x, each_z = self._bounded(x, x_error, late_x, fine), self._bounded(z, z_error, late_z, fine)
            late_along = (x * late_x + z * late_z) / size if certain > 0.0 else hypot(late_x, late_z)
            whole = self._bounded(size, along, late_along, fine)
        direction = self._direction(certain > 0.0, contact, angle, across)
        return new(Force, (each_x, each_z, whole, direction, (xx, xz, zz)))

    def _direction(self, certain: bool, contact: bool, angle: float, error: float) -> Quantity:
        """Direction [rad]: there is none of a force that is not there, and none of one that is not certain."""
        if not (contact and certain):
            return UNCERTAIN if contact else NO_CONTACT
        return self._quantity(angle, error, NONE)

    def _bounded(self, value: float, error: float, late: float, fine: Reason) -> Quantity:
        """A component or the magnitude; without contact NO_CONTACT is the reason why it is nearly zero. A pose that
        does not show the force is seen from the error without that of a `late` force."""
        if not error * error - late * late <= self._blind * self._blind:
            return invalid(Reason.SINGULAR)
        if not abs(value) <= self.rated_force:  # also true for NaN, to which absurd parameters may lead
            return invalid(Reason.OUT_OF_DECLARED_RANGE)
        return self._quantity(value, error, fine)

    def _quantity(self, value: float, error: float, fine: Reason) -> Quantity:
        """The value with its status; where that is OK, the reason is `fine`."""
        if not self.tares.identified:
            return new(Quantity, (value, error, DEGRADED, Reason.NOT_IDENTIFIED))
        if error > self._poor:
            return new(Quantity, (value, error, DEGRADED, Reason.UNCERTAIN))
        return new(Quantity, (value, error, OK, fine))


# a member of an enumeration takes longer to look up than a name
OK, DEGRADED, NONE, WITHOUT = Status.OK, Status.DEGRADED, Reason.NONE, Reason.NO_CONTACT
UNCERTAIN, NO_CONTACT = invalid(Reason.UNCERTAIN), invalid(Reason.NO_CONTACT)
