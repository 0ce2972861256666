"""Detector of angles that have stepped farther than the machine can move.

The inputs add up such steps (`service/assembler.py`); the sum is the error of the angle."""

from dataclasses import dataclass
from typing import Self

from cylforce.service.plausibility.detector import Detector, Features, MonitoredMachine
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorFault, SensorSuspicion


@dataclass(slots=True)
class AngleStep(Detector):
    """Signals that have stepped.

    report: present suspicion: the signals that have stepped
    """

    report: SensorSuspicion = NOTHING_SUSPECTED

    @classmethod
    def start(cls, machine: MonitoredMachine) -> Self:
        """Return the detector before any sample."""
        del machine
        return cls()

    def on_step(self, features: Features) -> None:
        """Report the signals that have stepped, as rejected; the inputs have compared successive values of each signal.

        features: of the step, with the numbers of these signals
        """
        stepped = features.now.stepped
        if stepped != self.report.signals:
            self.report = (
                SensorSuspicion(Level.REJECTED, SensorFault.ANGLE_STEPPED, stepped) if stepped else NOTHING_SUSPECTED
            )
