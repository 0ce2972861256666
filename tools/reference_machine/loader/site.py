"""Where a loader's scenario is planned: what the arm may do there, and at what temperature."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reference_machine.plan import RATE, Path
from reference_machine.site import ZERO

from .geometry import Geometry

Array = NDArray[np.float64]
CLEAR = 0.15  # m that an empty bucket stays above the ground
QUICKEST = np.array([0.18, 0.26])  # m/s of lift and tilt


@dataclass
class Site:
    """Where and with what a scenario is planned; the oil starts at `degc` and warms by `degc_per_s`."""

    geometry: Geometry
    rng: np.random.Generator
    degc: float = 40.0
    degc_per_s: float = 0.0125

    def kelvin(self, rows: int) -> Array:
        """Oil temperature of the rows of a piece."""
        return ZERO + self.degc + self.degc_per_s * np.arange(rows) / RATE

    def posture(self) -> Array:
        """Lengths of a posture clear of the ground, anywhere in the working range."""
        while True:
            arm, attitude = np.radians(self.rng.uniform((-34.0, -42.0), (44.0, 45.0)))
            lengths = self.geometry.lengths(float(arm), float(attitude))
            if self.geometry.clearance(lengths[None]) > CLEAR + 0.1:
                return np.asarray(lengths)

    def clear(self, part: Array) -> bool:
        """Whether a path stays above the ground and within what the linkage allows."""
        return self.geometry.clearance(part[::10]) > CLEAR

    def go(self, path: Path, most: float = 1.0) -> None:
        """To another posture, all joints at once, at some share of the quickest speeds, at most `most`."""
        while True:
            target = self.posture()
            speeds = QUICKEST * self.rng.uniform(0.2, most, 2)
            late = self.rng.uniform(0.0, 0.6, 2)
            if self.clear(path.sketch(target, speeds, late)):
                path.go(target, speeds, late)
                return

    def heap(self) -> tuple[float, float]:
        """Centre of a load in the bucket's frame [m]."""
        return float(self.rng.uniform(0.45, 0.70)), float(self.rng.uniform(0.10, 0.30))
