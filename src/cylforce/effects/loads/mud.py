"""Mud that sticks to a link and grows while the machine works."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

STATED_TIME = 600.0  # s after the start of the recording, when the mass is `size`


@dataclass(frozen=True, slots=True)
class Mud:
    """Mud on a link: no mass at the start of the recording and `size` [kg] after ten minutes.

    It grows evenly, or, with `slowing`, as 1 - exp(-slowing t): ever more slowly as the recesses in which it stays fill
    up.
    """

    slowing: float = 0.0  # 1/s, inverse of the time in which the places are filled; 0: it grows evenly

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="mud",
            unit="kg",
            low=30.0,
            high=1000.0,
            place=Place.LINK,
            shows="like a mass on the link, more and more as the recording goes on",
            confirm="clean bucket and stick, then the same poses again",
            sign=1,
            form=0.1,  # chosen: it does not grow evenly
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Range of `slowing`: from even growth to deposits that are complete within a minute."""
        return (ShapeRange("slowing", 0.0, 1.0 / 60.0, log=True, shift=1.0 / 2000.0),)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the sizes of which the effect consists."""
        return ("kg", "kg m", "kg m")

    @property
    def typical(self) -> tuple[float, ...]:
        """Typical sizes, the scale of the diagnosis' prior: mass [kg], its first moments about the link's centre of
        gravity [kg m]; chosen for a machine of 20 t."""
        return (200.0, 60.0, 60.0)

    def change(self, machine: Machine, where: int) -> Array:
        """Return the change (3N, 3) of (J, X, Z) [kg m^2, kg m, kg m] of all links per unit of each size.

        The sizes are a mass [kg] at the centre of gravity of link `where` and two first moments about that point, along
        the link's x and z axes [kg m]. The rows are J, X, Z link by link; a mass is also in J and X of links before.
        """
        link, columns = machine.links[where], np.zeros((machine.size, 3, 3))
        for i in range(where):
            columns[i, 0, 0], columns[i, 1, 0] = machine.links[i].length ** 2, machine.links[i].length
        columns[where, :, 0] = link.cx**2 + link.cz**2, link.cx, link.cz
        columns[where, :, 1], columns[where, :, 2] = (2.0 * link.cx, 1.0, 0.0), (2.0 * link.cz, 0.0, 1.0)
        return columns.reshape(3 * machine.size, 3)

    def grown(self, t: Array) -> Array:
        """Return the share (T,) of the sizes that is present at times t (T,) [s] since the start of the recording.

        It is t / 600 s, or (1 - exp(-slowing t)) / (1 - exp(-slowing 600 s)), and exceeds 1 after ten minutes.
        """
        if not self.slowing:
            return np.asarray(t / STATED_TIME)
        return np.asarray(np.expm1(-self.slowing * t) / np.expm1(-self.slowing * STATED_TIME))
