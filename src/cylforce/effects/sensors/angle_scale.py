"""A scale error of an angle or length sensor: it grows with the distance from where the sensor was set."""

from dataclasses import dataclass

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind


@dataclass(frozen=True, slots=True)
class AngleScale:
    """A scale error of an angle or length sensor: reading = a + size (a - a_0), correct where the sensor was set, at
    a_0 = low + right (high - low) of its range: at an end stop, or in the middle."""

    right: float = 0.5  # share of the range at which the reading is correct

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "angle_scale",
            "1",
            0.004,
            0.08,
            Place.ANGLE,
            "more the farther from where it was set",
            "each joint at both end stops",
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """It is set anywhere in its range."""
        return (ShapeRange("right", 0.0, 1.0),)

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """The signals (T, S) with signal `where` changed to a + size (a - a_0)."""
        found, (low, high) = values.copy(), _range(machine, where)
        found[:, where] += size * (values[:, where] - low - self.right * (high - low))
        return found


def _range(machine: Machine, where: int) -> tuple[float, float]:
    """Lowest and highest value of an angle sensor: of its joint's or cylinder's range, else of its own range."""
    signal = machine.signals[where]
    if signal.kind is Kind.JOINT_ANGLE:
        return machine.links[signal.index].angle_low, machine.links[signal.index].angle_high
    if signal.kind is Kind.CYLINDER_LENGTH:
        return machine.cylinders[signal.index].length_low, machine.cylinders[signal.index].length_high
    return signal.low, signal.high
