"""Pressure loss between sensor and chamber, which grows with the flow more than in proportion."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.signals.estimate import Array

STATED_SPEED = 0.3  # m/s, speed at which the size f is stated


@dataclass(frozen=True, slots=True)
class ReturnLineLoss:
    """Pressure loss in the lines between sensors and chambers, as a force of the cylinder.

    It is f sgn(v) (|v| / 0.3 m/s)^power in one direction of motion, zero in the other, and is contained in the measured
    force (positive: it pushes; v > 0: it extends) but does not reach the piston. Extending and retracting have sizes of
    their own: the lines of both sides, their areas and a one-way throttle allow any ratio.
    """

    way: int = 1  # 1: while extending, -1: while retracting
    power: float = 1.75  # 2: turbulent flow through an orifice; 1.75: in a smooth pipe (Blasius); 1: laminar

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="return_line_loss",
            unit="N",
            low=800.0,  # 2 bar at 0.3 m/s on 40 cm^2
            high=9e4,  # 15 bar at 0.3 m/s in both lines, on 600 cm^2
            place=Place.CYLINDER,
            shows="at high speed only",
            confirm="the fastest strokes both ways, pressures at both ends of the hose compared",
            axes=2,
            form=0.2,  # chosen: bends, hoses and fittings follow no one power
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Range of `power`: from laminar flow to an orifice."""
        return (ShapeRange("power", 1.0, 2.0),)

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """Return the force [N] per newton of f, shaped as `speed` v [m/s]; f is the force at 0.3 m/s.

        It is way (|v| / 0.3 m/s)^power in the direction `way`, else 0.
        """
        return np.asarray(self.way * (np.maximum(self.way * speed, 0.0) / STATED_SPEED) ** self.power)
