"""An angle encoder whose disc or magnet sits off the axis about which it turns."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind


@dataclass(frozen=True, slots=True)
class EncoderEccentricity:
    """An angle sensor mounted off its axis: reading = a + size sin(a), or with `across` a + size cos(a). Both together
    are size sin(a - phase): one wave per turn, of the eccentricity divided by the radius of the track that is read."""

    across: bool = False  # whether the error is a cosine of the angle, not a sine

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="encoder_eccentricity",
            unit="rad",
            low=0.004,  # 0.1 mm on a radius of 25 mm
            high=0.08,  # 0.8 mm on a radius of 10 mm
            place=Place.ANGLE,
            shows="as a sine of that joint's angle, at rest too",
            confirm="the joint's angle at five poses over its range, against a level; then look at the sensor's seat",
            axes=2,
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with angle `where` changed to a + size sin(a), or with `across` a + size cos(a).

        Angles and size are in rad. The same object where the signal is a length.
        """
        if machine.signals[where].kind is Kind.CYLINDER_LENGTH:
            return values
        found, angle = values.copy(), values[:, where]
        found[:, where] += size * (np.cos(angle) if self.across else np.sin(angle))
        return found
