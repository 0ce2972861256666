"""Acceleration of a base that rocks or brakes and has no inertial sensor.

It is estimated from the second difference of the tilt, and from the residual torques that all joints have in common. It
does not correct the weight; it widens the error of every row (mechanics/README.md, section 3)."""

from array import array
from dataclasses import dataclass
from typing import Self

from cylforce.estimation.kernel import choice, making
from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO, solver
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.residual import MIN_SECONDS
from cylforce.service.loading.lift import Lift
from cylforce.service.residual import InstantResidual
from cylforce.service.snapshot import Constants, Estimator
from cylforce.signals.kinds import Kind

MEMORY_SECONDS = 4.0  # s over which the acceleration is averaged; chosen: two periods of a slowly rocking machine
# s between two updates, over which the tilt is averaged; three such means give an acceleration; chosen: a tenth of a
# period of rocking on tyres
LAG_SECONDS = 0.1
# m from the ground, about which a base turns, to the first pin: 1.7 to 2.1 on machines of 15 to 20 t
PIN_HEIGHT = 2.0
FITS = 9.0  # mean squared residual in standard errors (3 squared), above which it is no load; as for the weighing
WIDEST = 2.0  # m/s^2, prior standard error of an acceleration: tyres slide at 5; chosen


class BaseConstants(Constants):
    """Constants of the motion of one machine's base.

    inertial:   whether an inertial sensor on the base measures it
    lag:        steps between two updates
    lag_s:      time between two updates [s]
    share:      weight of each update in the averages
    noise:      variance of the angular acceleration by the tilt sensor's noise alone [rad^2/s^4]
    settled:    samples of a lift before its load is used
    parameters: P, number of parameters of the model
    """

    def __init__(self, model: Model, tares: Tares, kernel: Kernel | None = None) -> None:
        """Compute the constants for estimating the acceleration of a rocking base; times become numbers of steps.

        The second difference of three mean pitches has 1 + 4 + 1 = 6 times the variance of one of them, which is that
        of the sensor over the number of steps.

        model:  of the machine
        tares:  identified parameters of the empty machine
        kernel: form of the kernel; None: the compiled one if there is one
        """
        self.inertial, self.kernel, rate_hz = model.channels.inertial, kernel or choice.chosen(), model.filters.rate_hz
        self.lag = max(round(LAG_SECONDS * rate_hz), 1)
        self.lag_s, self.share = self.lag / rate_hz, self.lag / (MEMORY_SECONDS * rate_hz)
        error = max((s.standard_error for s in model.machine.signals if s.kind is Kind.PITCH), default=0.0)
        self.noise = 6.0 * error**2 / self.lag / self.lag_s**4
        self.settled = MIN_SECONDS * rate_hz
        self.parameters = len(model.parameters)
        self.solver = solver(model, tares, self.kernel)
        self.plan = making.plan(model, self.kernel.KernelPlan)


@dataclass(slots=True)
class BaseFilter(Estimator):
    """Variances of the base's acceleration.

    constants: of the machine
    forward:   variance of the first pin's acceleration forwards, from the torques [m^2/s^4]
    upward:    variance of the first pin's acceleration upwards, from the torques [m^2/s^4]
    turning:   variance of the base's angular acceleration, from the tilt [rad^2/s^4]
    pitches:   the last mean pitches [rad], at most three, newest last
    total:     sum of the pitches of the running mean [rad]
    number:    number of these pitches
    wider:     (R,) added to the variance of each row [N^2 m^2]; empty before the first update
    """

    constants: BaseConstants
    forward: float
    upward: float
    turning: float
    pitches: tuple[float, ...]
    total: float
    number: int
    wider: Numbers

    @classmethod
    def start(cls, constants: BaseConstants) -> Self:
        """Return the state of a base that has not moved."""
        return cls(constants, forward=0.0, upward=0.0, turning=0.0, pitches=(), total=0.0, number=0, wider=array("d"))

    def interrupt(self) -> None:
        """Begin the mean pitches anew after a gap in the samples."""
        self.pitches, self.total, self.number = (), 0.0, 0

    def update(self, residual: InstantResidual, channels: Numbers, lift: Lift, usable: Numbers) -> None:
        """Update the variances of a rocking base's acceleration, and set the variance that they add to each row.

        `forward`, `upward` and `turning` change every `lag` steps; `residual.wider` is set at each step from the first
        such change on. With an inertial sensor on the base nothing is done, because that measures its motion.

        residual: residual torque of the instant; its field `wider` (R,) [N^2 m^2] is set
        channels: (D,) of the step, of which the last three are pitch, roll [rad] and slew (see `Channels`)
        lift:     estimate of the present lift's load, before this instant; the torques count only once it has settled
        usable:   (R,) 1 where the row of a measured joint torque can be used, else 0
        """
        if self.constants.inertial:
            return
        self.total += channels[-3]
        self.number += 1
        if self.number >= self.constants.lag:
            self._learn(residual, channels, lift, usable)
        if self.wider:
            residual.wider = self.wider

    def _learn(self, residual: InstantResidual, channels: Numbers, lift: Lift, usable: Numbers) -> None:
        """Update the variances of the accelerations, and the variance that they add to each row.

        They follow from a mean pitch of the last steps and, if all rows are usable, from the torques that a settled
        load does not explain (`recognised.rocking_variance`).

        residual: residual torque of the instant: measured less that of the empty machine and the drift [N m]
        channels: (D,) of the step, of which the last three are pitch, roll [rad] and slew (see `Channels`)
        lift:     estimate of the present lift's load, before this instant
        usable:   (R,) 1 where the row of a measured joint torque can be used, else 0
        """
        c, rows = self.constants, len(usable)
        self._append_pitch()
        # variance of the first pin's acceleration by the tilt [m^2/s^4]
        swings = PIN_HEIGHT**2 * max(self.turning - c.noise, 0.0)
        settled = not lift.refused and lift.taken > c.settled
        accelerations, wider = array("d", (self.forward, self.upward)), ZERO * rows
        instant = (residual.rows, residual.numbers, lift.numbers, channels, settled and all(usable), swings)
        room = (ZERO * rows, ZERO * c.parameters, ZERO * (2 * rows))
        limits = (c.share, FITS, 1.0 / WIDEST**2)
        c.kernel.rocking_variance(c.plan, c.solver, *instant, *limits, *room, accelerations, wider)
        self.forward, self.upward = accelerations
        self.wider = wider

    def _append_pitch(self) -> None:
        """Append the mean pitch [rad] of the last steps, and update the variance `turning` of the base's rotation.

        Three mean pitches give one angular acceleration [rad/s^2]. The average `turning` of its square moves towards
        that by the constant `share`."""
        self.pitches = (*self.pitches, self.total / self.number)[-3:]
        self.total, self.number = 0.0, 0
        if len(self.pitches) == 3:
            before, middle, after = self.pitches
            acceleration = (after - 2.0 * middle + before) / self.constants.lag_s**2
            self.turning += self.constants.share * (acceleration**2 - self.turning)
