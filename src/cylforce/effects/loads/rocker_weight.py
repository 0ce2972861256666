"""Weight of the bars of a four-bar linkage: rocker, connecting link and rod end, which belong to no link of the arm."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cylforce.effects.effect import Halves, Parameter
from cylforce.mechanics.linkages import FourBar
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.mechanics.riders import (
    LinkMotion,
    Number,
    Vector,
    gravity_factor,
    link_motion,
    rocker_points,
    unit_mass_torque,
)


@dataclass(frozen=True, slots=True)
class RockerWeight:
    """Bars of a linkage with first moment w about the rocker's pin.

    Their weight and inertia are those of a mass w/s at the rocker's end less the same mass at its pin, s the rocker's
    length. The terms that turn with the body that holds the pin are in that link's parameters. Without a column of
    their own, bars are absorbed by these only in the mean (mechanics/README.md, section 3, limit), with an error on
    another slope. While the rocker does not turn relative to that body, its column is a linear combination of the
    link's.
    """

    # length and lever: another linkage shows in them
    depends_on: ClassVar[tuple[str, ...]] = ("a", "q", "qd", "g", "slew", "length", "lever")

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """Return the parameters: the first moment w [kg m] of the bars of each of the K four-bar linkages."""
        return tuple(Parameter(f"{name}.rocker", "kg m") for name in machine.four_bars)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Return the momentum [N m s] and static columns [N m] (..., N, K) per kg m of w of K four-bar linkages.

        They are in joint torques, and zero where a linkage cannot be closed.
        """
        at, up = link_motion(machine, moving), gravity_factor(moving)
        with np.errstate(divide="ignore", invalid="ignore"):
            columns = [_column(machine, moving, at, up, bar) for bar in machine.four_bars.values()]
        found = np.array(columns)  # (K, 2, N, ...)
        found = np.where(np.isfinite(found), found, 0.0)
        return Halves(*found.transpose(1, *range(3, found.ndim), 2, 0))


def _column(machine: Machine, moving: Motion, at: LinkMotion, up: Vector, bar: FourBar) -> list[list[Number]]:
    """Return the momentum and static column of one linkage, both by joints (N), each a number or an array (...).

    They are [N m s] and [N m] per kg m of the bars' first moment w.

    at: motion of the links
    up: gravity and acceleration that act on a mass (`gravity_factor`)
    """
    turning = float(moving.slew) ** 2 if moving.q.ndim == 1 else moving.slew**2
    columns = [unit_mass_torque(point, up, turning, machine.slew_axis) for point in rocker_points(at, bar)]
    pin, end = columns
    return [[(b - a) / bar.rocker_length for a, b in zip(*half, strict=True)] for half in zip(pin, end, strict=True)]
