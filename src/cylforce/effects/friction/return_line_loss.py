"""Pressure loss between sensor and chamber, which grows with the flow more than in proportion."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class ReturnLineLoss:
    """Pressure loss between sensor and chamber as a force of the cylinder: f sgn(v) |v|^power, times `extending` or
    `retracting` by the direction of motion."""

    extending: float = 1.0  # factor while extending
    retracting: float = 1.0  # factor while retracting
    power: float = 2.0  # 2: turbulent flow through an orifice; 1.75: in a smooth pipe (Blasius)

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "return_line_loss",
            "N (s/m)^power",
            1e4,
            1e6,
            Place.CYLINDER,
            "at high speed only",
            "the fastest strokes both ways, pressures at both ends of the hose compared",
            form=0.2,  # chosen: power and direction factors differ from machine to machine
        )

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """Force per unit of f: sgn(v) |v|^power times the factor of the direction."""
        share = np.where(speed > 0.0, self.extending, self.retracting)
        return np.asarray(share * np.sign(speed) * np.abs(speed) ** self.power)
