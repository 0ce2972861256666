"""Friction that changes with the oil's temperature in the course of a recording."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class FrictionTemperatureDrift:
    """The identified friction of all cylinders, or of one `alone`, multiplied by 1 + size (1 - exp(-t / settling)), t
    in seconds since the start of the recording: all of it, or only the viscous part (`viscous`). The size is the share
    reached in the end, negative while the oil warms. With `cold` the identified friction is that of the warm machine:
    1 + size exp(-t / settling), positive after a cold start.

    Heat made by even work, and lost in proportion to temperature, gives this course (Newton's law of cooling); a tank
    of oil takes some five minutes to an hour. One cylinder alone changes when it alone works, or its seals run in."""

    settling: float = 900.0  # s, the oil's thermal time constant
    viscous: bool = False
    cold: bool = False
    alone: bool = False

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "friction_temperature_drift",
            "1",
            0.1,
            2.0,
            Place.CYLINDER if self.alone else Place.MACHINE,
            "in motion, first quickly and then ever more slowly changing",
            "the same strokes at the start and the end of a shift, oil temperature noted",
            form=0.1,  # chosen: viscosity is exponential in the temperature, and work is not even
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Oil of one cylinder at hard work warms within 20 s, a tank with its machine in an hour."""
        return (ShapeRange("settling", 20.0, 3600.0, log=True),)

    @property
    def laws(self) -> tuple[str, ...]:
        """Names of the identified friction laws that change together."""
        return ("viscous",) if self.viscous else ("coulomb", "viscous", "load_dependent")

    def course(self, t: Array) -> Array:
        """1 - exp(-t / settling), with `cold` exp(-t / settling), at times t (T,) [s]."""
        return np.asarray(np.exp(-t / self.settling) if self.cold else -np.expm1(-t / self.settling))
