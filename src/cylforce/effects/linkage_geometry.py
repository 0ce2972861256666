"""A pin or bar of a linkage that is not where the drawing has it."""

from dataclasses import dataclass, fields, replace
from typing import Any

from cylforce.machine.candidate import About, Place
from cylforce.machine.linkages import Linkage
from cylforce.machine.machine import Machine


@dataclass(frozen=True, slots=True)
class LinkageGeometry:
    """One measure of the linkage that drives a joint, the `measure`-th of its pins' coordinates and bars' lengths, is
    larger by size than the drawing says."""

    measure: int = 0

    @property
    def about(self) -> About:
        """What it says of itself."""
        return About(
            "linkage_geometry",
            "m",
            0.003,
            0.04,
            Place.LINK,
            "with the posture, in proportion to the cylinder's force",
            "survey the pins of that linkage",
        )

    def altered(self, machine: Machine, where: int, size: float) -> Machine:
        """The machine with that measure changed, where the joint's linkage has it."""
        driving = [c for c, span in enumerate(machine.spans) if span == (where,)]
        if not driving:
            return machine
        c = driving[0]
        linkage = _moved(machine.cylinders[c].linkage, self.measure, size)
        if linkage is None:
            return machine
        cylinders = list(machine.cylinders)
        cylinders[c] = replace(cylinders[c], linkage=linkage)
        return replace(machine, cylinders=tuple(cylinders))


def _moved(linkage: Linkage, measure: int, size: float) -> Linkage | None:
    """The linkage with one measure changed; None where it has no such measure."""
    holder: Any = linkage
    changes: list[tuple[str, Any]] = []
    for name in (f.name for f in fields(holder)):
        value = getattr(holder, name)
        if isinstance(value, tuple):
            body, local = value
            changes += [(name, (body, local + step)) for step in (size, 1j * size)]
        elif isinstance(value, float):
            changes.append((name, value + size))
    if measure >= len(changes):
        return None
    found: Linkage = replace(holder, **dict([changes[measure]]))
    return found
