"""Latency of the force, and the error that it causes while the force changes."""

from array import array
from dataclasses import dataclass
from math import pi, sqrt, tan

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.mechanics.installation import Filters
from cylforce.service.snapshot import Estimator


def wait_s(filters: Filters, period_s: float) -> float:
    """Return the mean time [s] from a change at a sensor to the value published from it, without that of the filters.

    A signal waits half a step until it is measured and one step until it is used, the result until it is published.

    filters:  of the machine file, of which the rate of the steps is used
    period_s: time between two publications [s]
    """
    step = 1.0 / filters.rate_hz
    return 1.5 * step + max(period_s - step, 0.0) / 2.0


def force_delay_s(filters: Filters, period_s: float) -> float:
    """Return the delay [s] from a slow change of the true force to the bus: of the Butterworth low-pass, and waits.

    filters:  of the machine file, with the corner of the forces' low-pass
    period_s: time between two publications of the force [s]
    """
    step = 1.0 / filters.rate_hz
    return wait_s(filters, period_s) + step / (sqrt(2.0) * tan(pi * filters.force_hz * step))


class Lateness:
    """Error of a force by its latency: its rate of change times the delay.

    delay_s: delay of the force [s]
    steps:   over which the rate of change is measured: the delay, in whole steps
    share:   delay over the time of these steps
    """

    def __init__(self, delay_s: float, dt: float) -> None:
        """Compute the constants; `dt`: time between two samples [s]."""
        self.delay_s = delay_s
        self.steps = max(1, round(delay_s / dt))
        self.share = delay_s / (self.steps * dt)

    def error(self, recent: "RecentForces", x: float, z: float) -> tuple[float, float]:
        """Return the error (x, z) [N] of a force by its latency: its rate of change times the delay.

        The change is that over the last `steps` steps; `share` is the delay over the time of these steps. The error is
        zero before the second force.

        recent: forces of the last steps, without this one
        x, z:   this force, forwards and upwards [N]
        """
        if not recent.x:
            return 0.0, 0.0
        first = max(len(recent.x) - self.steps, 0)
        return self.share * (x - recent.x[first]), self.share * (z - recent.z[first])


@dataclass(slots=True)
class RecentForces(Estimator):
    """Forces of the last steps, newest last; empty before the first force.

    x: components forwards [N]
    z: components upwards [N]
    """

    x: Numbers
    z: Numbers

    def keep(self, x: float, z: float, steps: int) -> None:
        """Append a force, x forwards and z upwards [N], and drop the oldest one of more than `steps` forces."""
        if len(self.x) >= steps:
            del self.x[0], self.z[0]
        self.x.append(x)
        self.z.append(z)

    def clear(self) -> None:
        """Discard all forces after an interruption."""
        self.x, self.z = array("d"), array("d")


def no_forces() -> RecentForces:
    """Return the state before the first force."""
    return RecentForces(x=array("d"), z=array("d"))
