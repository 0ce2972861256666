"""Spill of a load."""

from dataclasses import dataclass

from cylforce.effects.fault import About, Place, TimeCourse


@dataclass(frozen=True, slots=True)
class PayloadSpill:
    """Spill of a load: its mass and first moments change at one instant, until the bucket is emptied.

    The next load is not changed. The three sizes are the change of the mass [kg], negative, and of the first moments X
    and Z about the last pin, in the last link's frame [kg m].
    """

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="payload_spill",
            unit="kg",
            low=40.0,
            high=3e3,
            place=Place.TOOL,
            shows="from one instant on, like a smaller load",
            confirm="weigh what is left",
            sign=-1,
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns whose sizes change during the incident (see `fault.INCIDENTAL`)."""
        return ("load.mass", "load.X", "load.Z")

    @property
    def course(self) -> TimeCourse:
        """Course of the sizes over time."""
        return TimeCourse.AFTER
