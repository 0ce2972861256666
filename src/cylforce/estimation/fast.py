"""Rows of this instant, for the force at the tool: torque = columns @ parameters as in `regressor`, but each part
passes only the filter that its own noise needs.

The hydraulics hold the motion, so that a force of the soil shows in the pressures at once and in the acceleration
hardly. Cylinder forces therefore pass quickly; only the inertia, whose noise grows with the square of its corner
frequency, passes slowly. What that costs is known: where the torque of inertia changes, it is late. Ways that were
compared: `tools/studies/force_ways.py`. The arithmetic of a step is the kernel's (`kernel/rows.py`)."""

from dataclasses import dataclass
from functools import cached_property

from cylforce.estimation.filters import Filter, first_order, second_order
from cylforce.mechanics.installation import Filters


@dataclass(frozen=True)
class FastFilters:
    """The filters of the rows of this instant, whose momentum and static columns are those of the weighing."""

    filters: Filters

    @property
    def dt(self) -> float:
        """The fixed step [s]."""
        return 1.0 / self.filters.rate_hz

    @cached_property
    def quick(self) -> Filter:
        """Low-pass of the forces."""
        return second_order(self.filters.force_hz, self.dt)

    @cached_property
    def slow(self) -> Filter:
        """Low-pass of the inertia."""
        return first_order(self.filters.inertia_hz, self.dt)

    @property
    def delay(self) -> float:
        """Delay [s] of a slow change of the cylinder forces."""
        return self.quick.delay * self.dt
