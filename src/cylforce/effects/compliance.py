"""A link that gives under load: its joint's angle is measured off by size times the torque."""

from dataclasses import dataclass

from cylforce.machine.candidate import About, Place
from cylforce.machine.machine import Machine
from cylforce.machine.reading import angle_signal, measured_torque
from cylforce.words.estimate import Array


@dataclass(frozen=True, slots=True)
class Compliance:
    """A link that gives under load: its joint's angle is measured off by size times the torque."""

    @property
    def about(self) -> About:
        """What it says of itself."""
        return About(
            "compliance",
            "rad/(N m)",
            1e-7,
            8e-6,
            Place.LINK,
            "under load, with the posture",
            "the same poses empty and with a known load, the tip surveyed",
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """a + size tau, tau the joint's torque from its cylinders' pressures."""
        signal = angle_signal(machine, where)
        if signal is None:
            return values
        torque = measured_torque(machine, values, where)
        found = values.copy()
        found[:, signal] += size * torque
        return found
