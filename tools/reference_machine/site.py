"""Where a scenario is planned: what the arm may do there, and at what temperature."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .geometry import Geometry
from .plan import RATE, Path, Plan

Array = NDArray[np.float64]
CLEAR = 0.35  # m that an empty bucket stays above the ground
QUICKEST = np.array([0.22, 0.30, 0.30])  # m/s
ZERO = 273.15


@dataclass
class Site:
    """Where and with what a scenario is planned. The oil starts at `degc` and warms by `degc_per_s`; `haste`: share of
    the normal speeds, less with a load, so that stops are not shocks."""

    geometry: Geometry
    rng: np.random.Generator
    degc: float = 40.0
    degc_per_s: float = 0.0125
    haste: float = 1.0

    @property
    def quickest(self) -> Array:
        """Speeds (3,) [m/s] of the cylinders that an operator here does not exceed."""
        return self.haste * QUICKEST

    @property
    def ground(self) -> float:
        """Height of the ground from the boom pin [m]."""
        return -self.geometry.specimen.sheet.pin_height

    def kelvin(self, begin: float, rows: int) -> Array:
        """Oil temperature of the rows of a piece."""
        return ZERO + self.degc + self.degc_per_s * (begin + np.arange(rows) / RATE)

    def posture(self) -> Array:
        """Lengths of a posture clear of the ground, anywhere in the working range."""
        low, high = self.geometry.working.T
        while True:
            lengths = low + (high - low) * self.rng.uniform(0.03, 0.97, 3)
            if self.geometry.clearance(lengths[None]) > CLEAR + 0.1:
                return np.asarray(lengths)

    def clear(self, part: Array) -> bool:
        """Whether a path stays above the ground and before the cab."""
        return self.geometry.clearance(part[::5]) > CLEAR

    def go(self, path: Path, speed: float = 0.15) -> None:
        """To another posture, clear of the ground, all joints at once."""
        while True:
            target = self.posture()
            if self.clear(path.sketch(target, np.minimum(speed, self.quickest))):
                path.go(target, np.minimum(speed, self.quickest))
                return

    def loaded(self, plan: Plan, kilograms: float) -> Plan:
        """The plan with a load in the bucket all the time."""
        payload = plan.payload.copy()
        payload[:] = (kilograms, *self.heap(), 0.3)
        return replace(plan, payload=payload, notes=plan.notes | {"payload_kg": kilograms})

    def heap(self) -> tuple[float, float]:
        """Centre of a load in the bucket's frame [m]."""
        return float(self.rng.uniform(0.62, 0.85)), float(self.rng.uniform(0.02, 0.22))
