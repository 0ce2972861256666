"""A pin or bar of a linkage that differs from the drawing."""

from dataclasses import dataclass, fields, replace
from typing import Any

from cylforce.effects.fault import About, Place
from cylforce.mechanics.linkages import Linkage
from cylforce.mechanics.machine import Machine


@dataclass(frozen=True, slots=True)
class LinkageGeometry:
    """Pin or bar of the linkage that drives a joint, different from the drawing by size [m].

    part:   number of the pin or bar, from 0: foot and eye of a triangle; foot, rocker pin, link pin, rocker and link of
            a four-bar. A pin is displaced along the x axis of the body that holds it, a bar is longer.
    across: whether a pin is displaced along the z axis instead
    """

    part: int = 0
    across: bool = False

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="linkage_geometry",
            unit="m",
            low=0.003,
            high=0.04,
            place=Place.LINK,
            shows="with the posture, in proportion to the cylinder's force",
            confirm="survey the pins of that linkage",
            axes=2,
        )

    def altered(self, machine: Machine, where: int, size: float) -> Machine:
        """Return the machine with the pin or bar of the linkage at joint `where` changed by `size` [m].

        It is the linkage of the first cylinder that acts on this joint alone. The same object when there is no such
        cylinder, pin or bar.
        """
        driving = [c for c, span in enumerate(machine.spans) if span == (where,)]
        if not driving:
            return machine
        c = driving[0]
        linkage = _moved(machine.cylinders[c].linkage, self.part, 1j * size if self.across else size)
        if linkage is None:
            return machine
        cylinders = list(machine.cylinders)
        cylinders[c] = replace(cylinders[c], linkage=linkage)
        return replace(machine, cylinders=tuple(cylinders))


def _moved(linkage: Linkage, part: int, step: complex) -> Linkage | None:
    """Return the linkage with one part changed: a pin displaced by `step` = x + i z [m], a bar longer by a real `step`
    [m]; None where the linkage has no such part, and for a bar with a `step` that is not real.

    part: number of the pin or bar, see `LinkageGeometry`
    """
    holder: Any = linkage
    parts = [(f.name, value) for f in fields(holder) if isinstance(value := getattr(holder, f.name), tuple | float)]
    if part >= len(parts) or (isinstance(parts[part][1], float) and step.imag):
        return None
    name, value = parts[part]
    new = value + step.real if isinstance(value, float) else (value[0], value[1] + step)
    found: Linkage = replace(holder, **{name: new})
    return found
