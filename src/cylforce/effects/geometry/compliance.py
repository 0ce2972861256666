"""A link that gives under load: its joint's angle is measured off by size times the torque."""

from dataclasses import dataclass

from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.reading import angle_signal, followed, measured_torque
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class Compliance:
    """A link that gives under load: its joint's angle is measured off by size times the torque, less so beyond a knee:
    contacts grow with the load, and slack tightens."""

    stiffening: float = 0.0  # 1 / (N m), of the knee's torque
    settling: float = 0.03  # s, time constant with which the link follows its load

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "compliance",
            "rad/(N m)",
            4e-8,
            8e-6,
            Place.LINK,
            "under load, with the posture",
            "the same poses empty and with a known load, the tip surveyed",
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """a + size tau / (1 + (stiffening tau)^2)^(1/4), tau the joint's torque from its cylinders' pressures."""
        signal = angle_signal(machine, where)
        if signal is None:
            return values
        torque = followed(measured_torque(machine, values, where), t, self.settling)
        found = values.copy()
        found[:, signal] += size * torque / (1.0 + (torque * self.stiffening) ** 2) ** 0.25
        return found
