"""Play in a joint: its angle is measured off by half the play, to the side to which the load presses."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.reading import angle_signal, followed, measured_torque
from cylforce.signals.estimate import Array

NEARLY = 1.5  # by which the torque that takes up the play is uncertain


@dataclass(frozen=True, slots=True)
class Backlash:
    """Play in a joint: its angle is measured off by half the play, to the side to which the load presses."""

    turning: float = 2e2  # N m, torque that takes up the play
    crossing: float = 0.04  # s, time constant of the way from side to side

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
        """a + size/2 s, s' = (sgn(tau) - s) / crossing, tau's sign the last that |tau| > turning had."""
        signal = angle_signal(machine, where)
        if signal is None:
            return values
        side, found = self._side(machine, values, where, self.turning), values.copy()
        found[:, signal] += size / 2.0 * followed(side, t, self.crossing)
        return found

    def jumps(self, machine: Machine, values: Array, where: int) -> NDArray[np.bool_]:
        """Where the load begins to press to the other side, or would if it took half as much again, or less."""
        less, more = (self._side(machine, values, where, f * self.turning) for f in (1.0 / NEARLY, NEARLY))
        changed = [np.diff(side, prepend=side[:1]) != 0.0 for side in (less, more)]
        return np.asarray((less != more) | changed[0] | changed[1])

    @staticmethod
    def _side(machine: Machine, values: Array, where: int, turning: float) -> Array:
        torque = measured_torque(machine, values, where)
        clear = np.abs(torque) > turning
        last = np.maximum.accumulate(np.where(clear, np.arange(len(torque)), 0))
        return np.asarray(np.sign(torque[last]))
