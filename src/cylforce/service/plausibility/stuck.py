"""Is a pressure constant? It changes when its cylinder turns round: supply becomes return. A reading that does not,
apart from white noise, is stuck.

Analysis of variance: sixteen means over 0.25 s of one pressure while its cylinder moved, at least four each way, are
compared with the noise within them. Its noise is white: where readings vary more within a mean than their second
differences say, oil oscillates, and no sensor is stuck."""

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from cylforce.estimation.kernel.heard import GROUPS
from cylforce.service.plausibility.detector import Description, Detector, Features, MonitoredMachine, doubt_of
from cylforce.service.plausibility.pressure_groups import CHANGES, COLOURED, GroupConstants, Mask
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, SensorDoubt, SensorFault

# Variance between the groups' means over that expected from the noise within them: below this, the pressure does not
# change. A constant with white noise exceeds it once in fifty times; machines in order are at 4 and more.
CONSTANT = 28.2595 / (GROUPS - 1)  # chi-squared with 15 degrees of freedom, exceeded by 2 %


@dataclass(slots=True)
class StuckPressure(Detector):
    """Pressures that do not change in 4 s of motion.

    constants: of the pressures
    constant:  (P,) which do not change
    """

    constants: GroupConstants
    constant: Mask
    doubt: SensorDoubt = NOTHING_SUSPECTED

    DESCRIPTION: ClassVar[Description] = Description(
        faults=(SensorFault.STUCK,),
        looks_at="one pressure while its cylinder moves for 4 s, 1 s at least each way",
        residual="variance of its means over 0.25 s, over that expected from its noise",
        threshold="1.9: a constant exceeds it once in fifty times; a machine in order is at 4 and more",
        levels="rejected after 4 s of motion",
        recovery="when it changes: above 3.7, which a constant exceeds once in ten hours",
    )

    @classmethod
    def start(cls, machine: MonitoredMachine) -> Self:
        """Return the state before any reading."""
        return cls(machine.groups, np.zeros(len(machine.groups.signals), dtype=bool))

    def on_step(self, features: Features) -> None:
        """Compare the groups when one has ended."""
        ratios = features.groups.ratios
        if not ratios:
            return
        varied, coloured = np.frombuffer(ratios).reshape(2, -1)
        limit = np.where(self.constant, CHANGES, CONSTANT)
        constant = np.where(varied >= 0.0, (varied <= limit) & ~(coloured > COLOURED), self.constant)
        if (constant != self.constant).any():
            self.constant = constant
            self.doubt = doubt_of(constant, self.constants.signals, SensorFault.STUCK)
