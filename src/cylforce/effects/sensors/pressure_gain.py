"""A gain (span) error of a pressure sensor."""

from dataclasses import dataclass

from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class PressureGain:
    """A gain (span) error of a pressure sensor: reading = p (1 + size)."""

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="pressure_gain",
            unit="1",
            low=0.004,
            high=0.06,
            place=Place.PRESSURE,
            shows="in proportion to the pressure",
            confirm="a known load, and the same pressure on a second gauge",
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with signal `where`, a pressure or a force pin, multiplied by 1 + size."""
        found = values.copy()
        found[:, where] *= 1.0 + size
        return found
