"""Friction that changes with the oil's temperature in the course of a recording, to first order in time."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class FrictionTemperatureDrift:
    """The identified friction of a cylinder multiplied by 1 + size t, t in hours since the start of the recording: all
    of it, or only the viscous part (`viscous`). The size is negative while the oil warms."""

    viscous: bool = False

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "friction_temperature_drift",
            "1/h",
            0.5,
            40.0,
            Place.CYLINDER,
            "in motion, more and more (or less) as the recording goes on",
            "the same strokes at the start and the end of a shift, oil temperature noted",
        )

    @property
    def laws(self) -> tuple[str, ...]:
        """Names of the identified friction laws that change together."""
        return ("viscous",) if self.viscous else ("coulomb", "viscous", "load_dependent")

    def course(self, t: Array) -> Array:
        """Time t (T,) [s] in hours."""
        return np.asarray(t / 3600.0)
