"""Rows of the instant, for the force at the tool: torque = columns @ parameters as in `regressor`. Each part passes
only the filter that its own noise needs.

The hydraulics hold the motion, so that a force of the soil appears in the pressures at once, but hardly in the
acceleration. Cylinder forces therefore pass a quick filter. Only the inertia, whose noise grows with the square of its
corner frequency, passes a slow one. The cost is a lag of the torque of inertia where it changes. Alternatives are
compared in `tools/studies/force_ways.py`. The arithmetic of a step is the kernel's (`kernel/rows.py`)."""

from dataclasses import dataclass
from functools import cached_property

from cylforce.estimation.filters import Filter, first_order, second_order
from cylforce.mechanics.installation import Filters


@dataclass(frozen=True)
class FastFilters:
    """Filters of the rows of the instant.

    The cylinder forces pass `quick`, the rate of the momentum columns `slow`; static columns pass no filter of theirs.
    Momentum and static columns, before the filters, are those of the weighing.

    filters: rates and cut-off frequencies of the machine file [Hz]
    """

    filters: Filters

    @property
    def dt(self) -> float:
        """Fixed step [s]."""
        return 1.0 / self.filters.rate_hz

    @cached_property
    def quick(self) -> Filter:
        """Low-pass of the cylinder forces, of second order."""
        return second_order(self.filters.force_hz, self.dt)

    @cached_property
    def slow(self) -> Filter:
        """Low-pass of the torque of inertia, of first order."""
        return first_order(self.filters.inertia_hz, self.dt)

    @property
    def delay(self) -> float:
        """Delay [s] of a slow change of the cylinder forces."""
        return self.quick.delay * self.dt
