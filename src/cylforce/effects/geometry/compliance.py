"""A link that bends under load, so that its joint's angle is measured wrong."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.reading import angle_signal, followed, measured_torque
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class Compliance:
    """Link that bends under load: the measured angle is wrong by size [rad/(N m)] times the joint's torque.

    With `stiffening` the error grows more slowly at large torque, because contact areas grow and clearances close.
    """

    stiffening: float = 0.0  # 1/(N m), inverse of the torque at which the stiffening begins; 0: linear
    settling: float = 0.03  # s, time constant with which the link follows its load; chosen

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="compliance",
            unit="rad/(N m)",
            low=4e-8,
            high=8e-6,
            place=Place.LINK,
            shows="under load, with the posture",
            confirm="the same poses empty and with a known load, the tip surveyed",
            sign=1,
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Range of `stiffening`: from a linear spring to joints that stiffen at 10 kN m."""
        return (ShapeRange("stiffening", 0.0, 1e-4, log=True, shift=2e-6),)

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with the joint's angle changed to a + size tau / (1 + (stiffening tau)^2)^(1/4).

        tau is the joint's torque from its cylinders' pressures after a first-order lag of `settling`. The same object
        without an angle sensor.

        values: (T, S) signals without the error [SI]
        t:      (T,) time, evenly spaced [s]
        where:  number of the joint
        size:   compliance of the link [rad/(N m)]
        """
        signal = angle_signal(machine, where)
        if signal is None:
            return values
        torque = followed(np.nan_to_num(measured_torque(machine, values, where)), t, self.settling)
        found = values.copy()
        found[:, signal] += size * torque / (1.0 + (torque * self.stiffening) ** 2) ** 0.25
        return found
