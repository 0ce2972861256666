"""The error of the force while it changes, because it is late."""

from array import array
from dataclasses import dataclass

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.signals.quick import once

NOT_BEGUN: Numbers = array("d")  # before the first force, or after an interruption


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
        kept = recent[-2 * self._steps :]
        if not kept:
            return 0.0, 0.0
        return self._share * (x - kept[0]), self._share * (z - kept[1])

    def keep(self, recent: Numbers, x: float, z: float) -> Numbers:
        """Return x and z [N] of the steps in turn that the next one needs, the newest last."""
        return recent[-2 * self._steps :] + array("d", (x, z))
