"""Pressures and angles time-stamped by different clocks."""

from dataclasses import dataclass

from cylforce.effects.fault import About, Place, RunToRun, TimeCourse


@dataclass(frozen=True, slots=True)
class ClockFault:
    """Pressures and angles time-stamped by different clocks: from some instant on all pressures lag behind the angles,
    by a constant time or by a growing one.

    The two sizes are the delay of the pressures at that instant [s] and its growth [s/s]; negative: the angles lag."""

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="clock_fault",
            unit="s",
            low=0.005,
            high=5.0,
            place=Place.MACHINE,
            shows="while the motion changes, in all pressures alike, from one instant on or growing",
            confirm="record SYNC and compare both nodes' time stamps",
            varies=RunToRun.EACH_START,
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns whose sizes change during the incident (see `fault.INCIDENTAL`)."""
        return ("clock",)

    @property
    def course(self) -> TimeCourse:
        """Course of the sizes over time."""
        return TimeCourse.CLOCK
