"""A link whose centre of gravity (or whose first moment) is not where the data sheet has it."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class FirstMomentChange:
    """A link whose centre of gravity (or whose first moment) is not where the data sheet has it."""

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "first_moment_change",
            "kg m",
            20.0,
            2e3,
            Place.LINK,
            "with the posture, at rest too, in this joint and all before it alike",
            "hold poses from either side, slowly, over the whole range",
            axes=2,
        )

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the sizes of which the effect consists."""
        return ("kg m", "kg m", "kg m^2")

    @property
    def usual(self) -> tuple[float, ...]:
        """Usual sizes of X, Z [kg m] and J [kg m^2]."""
        return (1000.0, 1000.0, 3000.0)

    def change(self, machine: Machine, where: int) -> Array:
        """(3N, 3): first moments X and Z of the link, and its inertia J."""
        columns = np.zeros((machine.size, 3, 3))
        columns[where, 1, 0] = columns[where, 2, 1] = columns[where, 0, 2] = 1.0
        return columns.reshape(3 * machine.size, 3)
