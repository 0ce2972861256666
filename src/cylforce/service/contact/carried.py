"""The load that the force of the soil does not contain: as the weighing knows it."""

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
    """What the load of one machine can be.

    full:   (4,) m, m x, m z, J about the last pin of a full bucket
    before: (4, 4) covariance of a load before anything is seen
    """

    def __init__(self, machine: Machine, kernel: Kernel | None = None) -> None:
        self.kernel = kernel or choice.chosen()
        rated, middle = machine.rated_payload, machine.payload_reach / 2.0
        self.full = numbers([rated, rated * middle, 0.0, rated * middle**2])
        self.before = numbers(np.diag(load_spread(machine) ** 2).ravel())


@dataclass(slots=True)
class CarriedFilter(Estimator):
    """The load in the bucket.

    constants:  of the machine
    values:     (4,) m, m x, m z, J about the last pin, as last weighed
    weighed:    (4, 4) covariance of it then
    filling:    seconds of contact since then
    known:      whether a load hangs and is weighed now
    """

    constants: CarriedConstants
    values: Numbers
    weighed: Numbers
    filling: float
    known: bool

    @classmethod
    def start(cls, constants: CarriedConstants) -> Self:
        """Return the state in which nothing is known of the load."""
        return cls(constants, values=ZERO * 4, weighed=constants.before, filling=0.0, known=False)

    def forget(self) -> None:
        """Forget the load after an interruption of the measurement."""
        self.values, self.weighed, self.filling, self.known = ZERO * 4, self.constants.before, 0.0, False

    def update(self, lift: Lift | None, dt: float, *, touching: bool) -> None:
        """Take one instant of `dt` [s]: the `lift` where a load hangs, and whether the tool is `touching` something."""
        self.known = lift is not None and not touching
        if lift is not None and not touching:
            self.values, self.weighed = lift.numbers[LIFT.values], lift.numbers[LIFT.covariance]
            self.filling = 0.0
        else:
            self.filling += dt * touching

    @property
    def covariance(self) -> Numbers:
        """Covariance (4, 4) of the load: as weighed, and of a bucket that fills while it is in contact."""
        if not self.filling:
            return self.weighed
        found, c = ZERO * 16, self.constants
        c.kernel.fill(self.weighed, c.full, min(self.filling / FILLING_S, 1.0), found)
        return found
