"""Friction that changes with the oil's temperature in the course of a recording."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class FrictionTemperatureDrift:
    """Identified friction multiplied by 1 + size (1 - exp(-t / settling)), t in seconds since the start of the
    recording.

    It acts on all cylinders, or on one `alone`; on all laws, or only on the viscous one (`viscous`). The size is the
    share reached in the end, negative while the oil warms. With `cold` the identified friction is that of the warm
    machine: 1 + size exp(-t / settling), positive after a cold start.

    Steady work heats the oil, which cools in proportion to its temperature (Newton's law of cooling). A tank of oil
    takes some five minutes to an hour. One cylinder alone changes when only it works, or its seals run in.
    """

    settling: float = 900.0  # s, the oil's thermal time constant
    viscous: bool = False  # whether only viscous friction changes
    cold: bool = False  # whether the recording begins with cold oil and the identified friction is that of warm oil
    alone: bool = False  # whether one cylinder alone changes, not all of them

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="friction_temperature_drift",
            unit="1",
            low=0.1,
            high=2.0,
            place=Place.CYLINDER if self.alone else Place.MACHINE,
            shows="in motion, first quickly and then ever more slowly changing",
            confirm="the same strokes at the start and the end of a shift, oil temperature noted",
            form=0.1,  # chosen: viscosity is exponential in the temperature, and work is not even
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Range of `settling`: oil of one cylinder at hard work warms within 20 s, a tank with its machine in an
        hour."""
        return (ShapeRange("settling", 20.0, 3600.0, log=True),)

    @property
    def laws(self) -> tuple[str, ...]:
        """Names of the identified friction laws that change together."""
        return ("viscous",) if self.viscous else ("coulomb", "viscous", "load_dependent")

    def course(self, t: Array) -> Array:
        """Return 1 - exp(-t / settling), with `cold` exp(-t / settling), at times t (T,) [s] since the start of the
        recording."""
        return np.asarray(np.exp(-t / self.settling) if self.cold else -np.expm1(-t / self.settling))
