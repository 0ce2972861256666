"""Detector of pressures that have lost their noise.

The pressures of a moving cylinder never vary less than their noise. A frozen sensor, or a node that repeats its last
value, shows neither the noise nor the motion. The variance of the last 0.25 to 1 s of motion is compared with the noise
of the 15 s before (`pressure_groups`). A slower pump also reduces the noise. The suspicion therefore ends when the
pressure changes, and the noise is learned anew."""

from dataclasses import dataclass
from typing import Self

from cylforce.service.plausibility.detector import Detector, Features, MonitoredMachine, suspicion_of
from cylforce.service.plausibility.pressure_groups import GroupConstants
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorFault, SensorSuspicion


@dataclass(slots=True)
class LostNoise(Detector):
    """Pressures that have lost their noise.

    constants: of the pressures
    report:    present suspicion
    """

    constants: GroupConstants
    report: SensorSuspicion = NOTHING_SUSPECTED

    @classmethod
    def start(cls, machine: MonitoredMachine) -> Self:
        """Return the state before any reading."""
        return cls(machine.groups)

    def on_step(self, features: Features) -> None:
        """Suspect the pressures whose noise is gone, when a group of readings has ended."""
        if features.groups.ended:
            self.report = suspicion_of(
                features.groups.gone, self.constants.signals, SensorFault.FROZEN, Level.SUSPECTED
            )
