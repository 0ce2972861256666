"""Pressure loss between sensor and chamber, which grows with the flow more than in proportion."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.signals.estimate import Array

USUAL = 0.3  # m/s, speed at which the size is stated


@dataclass(frozen=True, slots=True)
class ReturnLineLoss:
    """Pressure loss in the lines between sensors and chambers, as a force of the cylinder: f sgn(v) (|v| / 0.3
    m/s)^power in one direction of motion, none in the other. Extending and retracting have each a size of their own:
    the lines of both sides, their areas and a throttle that acts one way only make any ratio."""

    way: int = 1  # 1: while extending, -1: while retracting
    power: float = 1.75  # 2: turbulent flow through an orifice; 1.75: in a smooth pipe (Blasius); 1: laminar

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "return_line_loss",
            "N",
            800.0,  # 2 bar at 0.3 m/s on 40 cm^2
            9e4,  # 15 bar at 0.3 m/s in both lines, on 600 cm^2
            Place.CYLINDER,
            "at high speed only",
            "the fastest strokes both ways, pressures at both ends of the hose compared",
            axes=2,
            form=0.2,  # chosen: bends, hoses and fittings follow no one power
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """From laminar flow to an orifice."""
        return (ShapeRange("power", 1.0, 2.0),)

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """Force per newton of f at 0.3 m/s: way (|v| / 0.3 m/s)^power in the direction `way`, else 0."""
        return np.asarray(self.way * (np.maximum(self.way * speed, 0.0) / USUAL) ** self.power)
