"""Play (backlash) in a joint."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.reading import angle_signal, followed, measured_torque
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class Backlash:
    """Play in a joint: the measured angle is wrong by half the play, towards the side to which the load presses."""

    turning: float = 2e2  # N m, torque beyond which the joint lies against one side; chosen
    crossing: float = 0.04  # s, time constant with which it crosses from side to side; chosen

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "backlash",
            "rad",
            0.002,
            0.05,
            Place.LINK,
            "where the joint's torque changes its sign",
            "push the link by hand, or with the tool on the ground, both ways",
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """The signals (T, S) with the joint's angle changed to a + size/2 s, ds/dt = (side - s) / crossing; side: the
        sign that the cylinders' torque had when it last exceeded `turning`. The same object without an angle sensor."""
        signal = angle_signal(machine, where)
        if signal is None:
            return values
        side, found = self._side(machine, values, where), values.copy()
        found[:, signal] += size / 2.0 * followed(side, t, self.crossing)
        return found

    def _side(self, machine: Machine, values: Array, where: int) -> Array:
        torque = measured_torque(machine, values, where)
        clear = np.abs(torque) > self.turning
        last = np.maximum.accumulate(np.where(clear, np.arange(len(torque)), 0))
        return np.asarray(np.sign(torque[last]))
