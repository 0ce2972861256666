"""Pressure lost between sensor and chamber, growing with the flow more than in proportion: f sgn(v) |v|^power."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class ReturnLineLoss:
    """Pressure lost between sensor and chamber, growing with the flow more than in proportion: f sgn(v) |v|^power."""

    extending: float = 1.0  # share of the loss that counts: oil leaves through the rod side, whose area is smaller
    retracting: float = 1.0
    power: float = 2.0  # 1.75 in a smooth pipe (Blasius)

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
            form=0.2,  # widths, ways and powers differ from machine to machine
        )

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """sgn(v) |v|^power, by direction."""
        share = np.where(speed > 0.0, self.extending, self.retracting)
        return np.asarray(share * np.sign(speed) * np.abs(speed) ** self.power)
