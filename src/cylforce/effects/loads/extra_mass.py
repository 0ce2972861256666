"""An additional mass on a link: a tool, a repair, mud."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class ExtraMass:
    """An additional mass on a link that the model does not contain: a tool, a repair, mud."""

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="extra_mass",
            unit="kg",
            low=15.0,
            high=1500.0,
            place=Place.LINK,
            shows="with the posture, at rest too, in this joint and all before it",
            confirm="take it off, or weigh the machine",
            sign=1,
        )

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the sizes of which the effect consists."""
        return ("kg", "kg m", "kg m", "kg m^2")

    @property
    def typical(self) -> tuple[float, ...]:
        """Typical sizes, the scale of the diagnosis' prior: mass [kg], its first moments about the link's centre of
        gravity [kg m], its inertia [kg m^2]; chosen for a machine of 20 t."""
        return (500.0, 60.0, 60.0, 300.0)

    def change(self, machine: Machine, where: int) -> Array:
        """Return the change (3N, 4) of (J, X, Z) [kg m^2, kg m, kg m] of all links per unit of each size.

        The sizes are a mass [kg] at the centre of gravity of link `where`, two first moments about that point along the
        link's x and z axes [kg m], and the change of J of this link by these moments and
        by inertia [kg m^2]. The rows are J, X, Z link by link; a mass is also in J and X of the links before.
        """
        link, columns = machine.links[where], np.zeros((machine.size, 3, 4))
        for i in range(where):
            columns[i, 0, 0], columns[i, 1, 0] = machine.links[i].length ** 2, machine.links[i].length
        columns[where, :, 0] = link.cx**2 + link.cz**2, link.cx, link.cz
        columns[where, 1, 1] = columns[where, 2, 2] = columns[where, 0, 3] = 1.0
        return columns.reshape(3 * machine.size, 4)
