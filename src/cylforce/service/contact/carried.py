"""Load in the bucket, from the weighing, which the soil force does not contain."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.layout import LIFT
from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.estimation.residual import load_spread
from cylforce.mechanics.machine import Machine
from cylforce.service.loading.lift import Lift
from cylforce.service.snapshot import Constants, Estimator

FILLING_S = 5.0  # s of contact in which a bucket can be filled or emptied; chosen


class CarriedConstants(Constants):
    """Limits of the load of one machine.

    full:   (4,) m, m x, m z, J about the last pin of a full bucket [kg, kg m, kg m, kg m^2]
    before: (4, 4) prior covariance of a load
    """

    def __init__(self, machine: Machine, kernel: Kernel | None = None) -> None:
        """Compute the load of a full bucket and the prior covariance of a load.

        The full bucket contains a rated payload in the middle of its reach. The prior covariance is diagonal
        (`load_spread`).

        kernel: form of the kernel; None: the compiled one if there is one
        """
        self.kernel = kernel or choice.chosen()
        rated, middle = machine.rated_payload, machine.payload_reach / 2.0
        self.full = numbers([rated, rated * middle, 0.0, rated * middle**2])
        self.before = numbers(np.diag(load_spread(machine) ** 2).ravel())


@dataclass(slots=True)
class CarriedFilter(Estimator):
    """The load in the bucket.

    constants:  of the machine
    values:     (4,) m, m x, m z, J about the last pin, as last weighed [kg, kg m, kg m, kg m^2]
    weighed:    (4, 4) covariance of these values when they were weighed
    filling:    time in contact since they were weighed [s]
    known:      whether the content of the bucket, perhaps none, is weighed now: in the air, with a valid weight
    """

    constants: CarriedConstants
    values: Numbers
    weighed: Numbers
    filling: float
    known: bool

    @classmethod
    def start(cls, constants: CarriedConstants) -> Self:
        """Return the state without a weighed load."""
        return cls(constants, values=ZERO * 4, weighed=constants.before, filling=0.0, known=False)

    def forget(self) -> None:
        """Discard the load after an interruption of the measurement."""
        self.values, self.weighed, self.filling, self.known = ZERO * 4, self.constants.before, 0.0, False

    def update(self, lift: Lift | None, dt: float, *, in_contact: bool) -> None:
        """Update the load in the bucket with one instant: as it is weighed now, or as it was weighed last.

        In contact the load stays, and the time is counted in which the bucket may fill.

        lift:       present lift, which weighs the load; None: there is no valid weight
        dt:         length of the instant [s]
        in_contact: whether the tool is in contact
        """
        self.known = lift is not None and not in_contact
        if lift is not None and not in_contact:
            self.values, self.weighed = lift.numbers[LIFT.values], lift.numbers[LIFT.covariance]
            self.filling = 0.0
        else:
            self.filling += dt * in_contact

    @property
    def covariance(self) -> Numbers:
        """Covariance (4, 4) of the load (m, m x, m z, J about the last pin): as weighed, wider after time in contact.

        In contact the bucket may fill: after FILLING_S it may contain anything up to a full load."""
        if not self.filling:
            return self.weighed
        found, c = ZERO * 16, self.constants
        c.kernel.widen_load(self.weighed, c.full, min(self.filling / FILLING_S, 1.0), found)
        return found
