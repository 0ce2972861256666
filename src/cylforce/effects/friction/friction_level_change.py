"""Friction of a cylinder changed by one factor since identification: wear, new seals, other grease."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, RunToRun
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class FrictionLevelChange:
    """Identified friction of a cylinder, in all its `laws`, multiplied by 1 + size; a size of 0 changes nothing."""

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="friction_level_change",
            unit="1",
            low=0.08,
            high=2.0,
            place=Place.CYLINDER,
            shows="in motion, as the known friction of that cylinder",
            confirm="the same slow and fast strokes as at commissioning",
            varies=RunToRun.VARYING,
        )

    @property
    def laws(self) -> tuple[str, ...]:
        """Names of the identified friction laws that change together."""
        return ("coulomb", "viscous", "load_dependent")

    def course(self, t: Array) -> Array:
        """Return 1 at all times (T,): the change is constant."""
        return np.ones_like(t)
