"""Detector of angles that have stepped farther than the machine can move.

The inputs add up such steps (`service/assembler.py`); the sum is the error of the angle."""

from dataclasses import dataclass
from typing import ClassVar, Self

from cylforce.service.plausibility.detector import Description, Detector, Features, MonitoredMachine
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorDoubt, SensorFault


@dataclass(slots=True)
class AngleLeap(Detector):
    """Signals that have stepped."""

    doubt: SensorDoubt = NOTHING_SUSPECTED

    DESCRIPTION: ClassVar[Description] = Description(
        faults=(SensorFault.LEAPT,),
        looks_at="one angle",
        residual="change between two values",
        threshold="3 rad/s, and its noise: no joint of such a machine is faster; for 100 values",
        levels="rejected after 1.6 s; meanwhile its values are not used",
        recovery="when it leaps back, at the latest at the next start",
    )

    @classmethod
    def start(cls, machine: MonitoredMachine) -> Self:
        """Return the detector before any sample."""
        del machine
        return cls()

    def on_step(self, features: Features) -> None:
        """Report the signals that have stepped according to the inputs."""
        leapt = features.now.leapt
        if leapt != self.doubt.signals:
            self.doubt = SensorDoubt(Level.REJECTED, SensorFault.LEAPT, leapt) if leapt else NOTHING_SUSPECTED
