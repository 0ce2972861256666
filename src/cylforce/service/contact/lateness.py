"""The error of the published force while it changes, because it is late."""

from array import array
from dataclasses import dataclass

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.signals.quick import once

NOT_BEGUN: Numbers = array("d")  # before the first force, or after an interruption


@dataclass(frozen=True)
class Lateness:
    """The force on the bus is that of `delay_s` ago. Its error is the rate of change of the force times that delay.

    delay_s: time [s] from the physical event to the bus (`publication.force_delay_s`)
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

    def step(self, recent: Numbers, x: float, z: float) -> tuple[Numbers, float, float]:
        """Return the forces to be kept and the error (x, z) [N] of the force because it is late.

        recent: x and z [N] of the steps before in turn, the newest last; NOT_BEGUN: none
        x, z:   force [N] of this step
        """
        kept = recent[-2 * self._steps :]
        first_x, first_z = kept[:2] if kept else (x, z)
        return kept + array("d", (x, z)), self._share * (x - first_x), self._share * (z - first_z)
