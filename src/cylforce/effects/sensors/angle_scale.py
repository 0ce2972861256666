"""A scale error of an angle or length sensor: it grows with the distance from where the sensor was set."""

from dataclasses import dataclass

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind


@dataclass(frozen=True, slots=True)
class AngleScale:
    """Scale error of an angle or length sensor: reading = a + size (a - a_0).

    It is correct where the sensor was set, at a_0 = low + right (high - low) of its range: at an end stop, or in the
    middle.
    """

    right: float = 0.5  # share of the range at which the reading is correct

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="angle_scale",
            unit="1",
            low=0.004,
            high=0.08,
            place=Place.ANGLE,
            shows="more the farther from where it was set",
            confirm="each joint at both end stops",
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Range of `right`: the sensor may be set anywhere in its range."""
        return (ShapeRange("right", 0.0, 1.0),)

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with signal `where`, an angle a [rad] or length a [m], changed to
        a + size (a - a_0).

        values: (T, S) signals without the error [SI]
        size:   relative error of the scale [1]
        """
        found, (low, high) = values.copy(), _range(machine, where)
        found[:, where] += size * (values[:, where] - low - self.right * (high - low))
        return found


def _range(machine: Machine, where: int) -> tuple[float, float]:
    """Return the lowest and highest value of an angle [rad] or length sensor [m].

    They are the ends of its joint's range (encoder) or of its cylinder's stroke (length sensor), else the limits within
    which the sensor's readings are accepted (inclinometer).

    where: number of the signal
    """
    signal = machine.signals[where]
    if signal.kind is Kind.JOINT_ANGLE:
        return machine.links[signal.index].angle_low, machine.links[signal.index].angle_high
    if signal.kind is Kind.CYLINDER_LENGTH:
        return machine.cylinders[signal.index].length_low, machine.cylinders[signal.index].length_high
    return signal.low, signal.high
