"""Mud that sticks to a link and grows while the machine works."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

USUAL = 600.0  # s after which the mass is told


@dataclass(frozen=True, slots=True)
class Mud:
    """Mud on a link, none at the start of the recording and `size` [kg] after ten minutes: growing evenly, or, with
    `slowing`, ever more slowly as the places where it sticks are filled, 1 - exp(-slowing t)."""

    slowing: float = 0.0  # 1/s, inverse of the time in which the places are filled; 0: it grows evenly

    @property
    def about(self) -> About:
        """Name, unit, plausible range and place of the effect, how it shows and how to confirm it."""
        return About(
            "mud",
            "kg",
            30.0,
            1000.0,
            Place.LINK,
            "like a mass on the link, more and more as the recording goes on",
            "clean bucket and stick, then the same poses again",
            1,
            form=0.1,  # chosen: it does not grow evenly
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """From even growth to places that are filled within a minute."""
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
        """Change (3N, 3) of (J, X, Z) of all links by a unit mass at the centre of gravity of link `where`, and by its
        two first moments about that point."""
        link, columns = machine.links[where], np.zeros((machine.size, 3, 3))
        for i in range(where):
            columns[i, 0, 0], columns[i, 1, 0] = machine.links[i].length ** 2, machine.links[i].length
        columns[where, :, 0] = link.cx**2 + link.cz**2, link.cx, link.cz
        columns[where, :, 1], columns[where, :, 2] = (2.0 * link.cx, 1.0, 0.0), (2.0 * link.cz, 0.0, 1.0)
        return columns.reshape(3 * machine.size, 3)

    def grown(self, t: Array) -> Array:
        """Share of that mass at times t (T,) [s]: t / 600 s, or
        (1 - exp(-slowing t)) / (1 - exp(-slowing 600 s))."""
        if not self.slowing:
            return np.asarray(t / USUAL)
        return np.asarray(np.expm1(-self.slowing * t) / np.expm1(-self.slowing * USUAL))
