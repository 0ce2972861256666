"""Detectors of a pressure that falls to zero within 50 ms (a burst hose), and of one below vacuum (a wrong reading)."""

from dataclasses import dataclass

from cylforce.service.plausibility.detector import Features, MarkedPressures
from cylforce.service.plausibility.pressure_groups import KEPT
from cylforce.service.plausibility.suspicion import SensorFault
from cylforce.signals.estimate import Array

FALL_STEPS = KEPT // 2  # 50 ms at 100 Hz, of the fall and of the time after it; healthy pressures dip for one step
FALLS = 20e5  # Pa from which a pressure falls when its hose bursts: above any return line; chosen
NOTHING = 1e5  # Pa: largest reading after a burst, a sensor's error of zero; return lines have 2 bar and more
VACUUM = -1e5 - NOTHING  # Pa: least possible reading, vacuum less a sensor's error of zero


def fallen(features: Features) -> Array | None:
    """Return the last T readings of P pressures (T, P) [Pa] if one of them is below NOTHING [Pa] now; else None.

    It is None, too, for no more than 2 FALL_STEPS readings.

    features: of the step, with the statistics of the pressures
    """
    groups = features.groups
    if groups.lowest >= NOTHING:
        return None
    recent = groups.recent
    return recent if len(recent) > 2 * FALL_STEPS else None


@dataclass(slots=True)
class BelowVacuum(MarkedPressures):
    """Pressures that were below vacuum."""

    def on_step(self, features: Features) -> None:
        """Mark the pressures that stayed below vacuum for the last FALL_STEPS steps; a mark stays."""
        recent = fallen(features)
        if recent is not None:
            self.mark(self.marked | (recent[-FALL_STEPS:].max(axis=0) < VACUUM), SensorFault.BELOW_VACUUM)


@dataclass(slots=True)
class BurstHose(MarkedPressures):
    """Pressures that fell to zero within 50 ms."""

    def on_step(self, features: Features) -> None:
        """Mark the pressures that fell from above FALLS to below NOTHING [Pa] and stay there, but not below vacuum.

        They fell within FALL_STEPS steps, and stayed for FALL_STEPS steps. A mark stays."""
        recent = fallen(features)
        if recent is None:
            return
        most = recent[-FALL_STEPS:].max(axis=0)
        falls = (most < NOTHING) & (most >= VACUUM) & (recent[-1 - 2 * FALL_STEPS] > FALLS)
        self.mark(self.marked | falls, SensorFault.BURST)
