"""How late the force is, and its error therefore while it changes."""

from array import array
from dataclasses import dataclass
from math import pi, sqrt, tan

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.mechanics.installation import Filters
from cylforce.signals.quick import once

NOT_BEGUN: Numbers = array("d")  # before the first force, or after an interruption


def wait_s(filters: Filters, period_s: float) -> float:
    """Return the time [s] that a value waits: a signal half a step until it is measured and one step until it is used,
    the result until the next publication."""
    step = 1.0 / filters.rate_hz
    return 1.5 * step + max(period_s - step, 0.0) / 2.0


def force_delay_s(filters: Filters, period_s: float) -> float:
    """Return the time [s] from a slow change of the true force to the bus: the Butterworth low-pass, and the waits."""
    step = 1.0 / filters.rate_hz
    return wait_s(filters, period_s) + step / (sqrt(2.0) * tan(pi * filters.force_hz * step))


@dataclass(frozen=True)
class Lateness:
    """A force is that of `delay_s` ago. Its error is its rate of change times that delay.

    delay_s: time [s] by which the force is late
    dt:      step [s]
    """

    delay_s: float
    dt: float

    @once
    def _steps(self) -> int:
        """Steps over which the rate of change is measured: the delay itself."""
        return max(1, round(self.delay_s / self.dt))

    @once
    def _share(self) -> float:
        """Delay over the time in which the change is measured, 1 but for whole steps."""
        return self.delay_s / (self._steps * self.dt)

    def error(self, recent: Numbers, x: float, z: float) -> tuple[float, float]:
        """Return the error (x, z) [N] of the force `x`, `z` [N]; `recent`: those of the steps before (`keep`)."""
        if not recent:
            return 0.0, 0.0
        first, share = max(len(recent) - 2 * self._steps, 0), self._share
        return share * (x - recent[first]), share * (z - recent[first + 1])

    def keep(self, recent: Numbers, x: float, z: float) -> Numbers:
        """Return x and z [N] of the steps in turn that the next one needs, the newest last."""
        kept = recent[2:] if len(recent) >= 2 * self._steps else recent[:]
        kept.append(x)
        kept.append(z)
        return kept
