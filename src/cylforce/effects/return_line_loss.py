"""Pressure lost between sensor and chamber, growing with the flow more than in proportion: f sgn(v) |v|^power."""

from dataclasses import dataclass

import numpy as np

from cylforce.machine.candidate import About, Place
from cylforce.words.estimate import Array


@dataclass(frozen=True, slots=True)
class ReturnLineLoss:
    """Pressure lost between sensor and chamber, growing with the flow more than in proportion: f sgn(v) |v|^power."""

    way: int = 0  # 1: while extending only, -1: while retracting only
    power: float = 2.0  # 1.75 in a smooth pipe (Blasius)

    @property
    def about(self) -> About:
        """What it says of itself."""
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
        """sgn(v) |v|^power, one way or both."""
        loss = np.sign(speed) * np.abs(speed) ** self.power
        return loss if self.way == 0 else np.asarray(np.where(np.sign(speed) == self.way, loss, 0.0))
