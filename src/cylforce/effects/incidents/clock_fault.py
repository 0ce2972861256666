"""Pressures and angles on clocks of their own: one lags the other, by a jump or more and more."""

from dataclasses import dataclass

from cylforce.effects.fault import About, Place, TimeCourse


@dataclass(frozen=True, slots=True)
class ClockFault:
    """Pressures and angles on clocks of their own: one lags the other, by a jump or more and more."""

    @property
    def about(self) -> About:
        """What it says of itself."""
        return About(
            "clock_fault",
            "s",
            0.005,
            5.0,
            Place.MACHINE,
            "while the motion changes, in all pressures alike, from one instant on or growing",
            "record SYNC and compare both nodes' time stamps",
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns whose sizes change."""
        return ("clock",)

    @property
    def course(self) -> TimeCourse:
        """How they change."""
        return TimeCourse.CLOCK
