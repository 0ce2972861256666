"""Detector of frozen pressures: constant apart from white noise.

A pressure changes when its cylinder reverses, because supply becomes return. Analysis of variance: sixteen means over
0.25 s of one pressure while its cylinder moves, at least four each way, are compared with the noise within them. The
noise of a frozen sensor is white. Where the variance within a mean exceeds that of the second differences, the oil
oscillates, and the sensor is not frozen."""

from dataclasses import dataclass

import numpy as np

from cylforce.estimation.kernel.pressures import GROUPS
from cylforce.service.plausibility.detector import Features, MarkedPressures
from cylforce.service.plausibility.pressure_groups import CHANGES, COLOURED
from cylforce.service.plausibility.suspicion import SensorFault

# Variance between the groups' means over that expected from the noise within them: below this, the pressure does not
# change. A constant with white noise exceeds it once in fifty times; healthy machines are at 4 and more.
CONSTANT = 28.2595 / (GROUPS - 1)  # chi-squared with 15 degrees of freedom, exceeded by 2 %


@dataclass(slots=True)
class FrozenPressure(MarkedPressures):
    """Pressures that do not change in 4 s of motion."""

    def on_step(self, features: Features) -> None:
        """Mark the pressures that are constant apart from white noise, when a group of readings has ended.

        The group's ratios (2, P) are the variance between the means of the last groups over that expected from the
        noise within them (-1: not enough groups), and that noise over its white part. A mark stays until the pressure
        clearly changes."""
        ratios = features.groups.ratios
        if not ratios:
            return
        varied, coloured = np.frombuffer(ratios).reshape(2, -1)
        limit = np.where(self.marked, CHANGES, CONSTANT)
        constant = np.where(varied >= 0.0, (varied <= limit) & ~(coloured > COLOURED), self.marked)
        self.mark(constant, SensorFault.FROZEN)
