"""A constant error of a pressure sensor."""

from dataclasses import dataclass

from cylforce.effects.fault import About, Place, RunToRun
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class PressureOffset:
    """A constant error of a pressure sensor: reading = p + size [Pa]."""

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="pressure_offset",
            unit="Pa",
            low=0.4e5,
            high=6e5,
            place=Place.PRESSURE,
            shows="everywhere alike, at rest too",
            confirm="engine off, lines relieved: all pressures must read zero",
            varies=RunToRun.VARYING,
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with `size` added to signal `where`: a pressure [Pa] or a force pin [N]."""
        found = values.copy()
        found[:, where] += size
        return found
