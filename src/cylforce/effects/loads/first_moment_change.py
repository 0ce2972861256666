"""A link whose first moments (mass times centre of gravity) differ from the data sheet."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class FirstMomentChange:
    """A link whose first moments (mass times centre of gravity) and inertia differ from the data sheet."""

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="first_moment_change",
            unit="kg m",
            low=20.0,
            high=2e3,
            place=Place.LINK,
            shows="with the posture, at rest too, in this joint and all before it alike",
            confirm="hold poses from either side, slowly, over the whole range",
            axes=2,
        )

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the sizes of which the effect consists."""
        return ("kg m", "kg m", "kg m^2")

    @property
    def typical(self) -> tuple[float, ...]:
        """Typical changes of X, Z [kg m] and J [kg m^2], the scale of the diagnosis' prior; chosen for a machine of
        20 t."""
        return (1000.0, 1000.0, 3000.0)

    def change(self, machine: Machine, where: int) -> Array:
        """Return the change (3N, 3) of (J, X, Z) of all links per unit of X, Z and J of link `where`.

        The rows are J [kg m^2], X, Z [kg m] link by link. No other link's parameters change.
        """
        columns = np.zeros((machine.size, 3, 3))
        columns[where, 1, 0] = columns[where, 2, 1] = columns[where, 0, 2] = 1.0
        return columns.reshape(3 * machine.size, 3)
