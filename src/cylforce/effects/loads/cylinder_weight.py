"""Weight of the cylinders themselves: barrel and rod, which turn with no link of the arm."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cylforce.effects.effect import Halves, Parameter
from cylforce.mechanics.machine import Cylinder, Machine
from cylforce.mechanics.motion import Motion
from cylforce.mechanics.riders import (
    LinkMotion,
    Number,
    Vector,
    body_point,
    eye_point,
    gravity_factor,
    link_motion,
    point_on_line,
    unit_mass_torque,
)


@dataclass(frozen=True, slots=True)
class CylinderWeight:
    """First moment w of a cylinder: the barrel's about the foot less the rod's about the eye.

    Along the cylinder's line u, from foot to eye, the barrel lies at foot + s u and the rod at eye - s' u. The terms
    that do not turn with u are in the parameters of the links that hold foot and eye; w u remains. Its weight and
    inertia are those of a mass w/s in the middle s of the shortest cylinder less the same mass at the foot. Inertia in
    proportion to the square of the cylinder's own turning is neglected: a few thousandths of the link's. A cylinder on
    the chassis has no such parameter: its torque depends on one angle, as the link's does, whose parameter includes it.
    """

    depends_on: ClassVar[tuple[str, ...]] = ("a", "q", "qd", "g", "slew", "length", "lever")

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """Return the parameters: the first moment w [kg m] of each of the K cylinders whose foot is on a link."""
        return tuple(Parameter(f"{c.name}.cylinder", "kg m") for c in machine.carried)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Return the momentum [N m s] and static columns [N m] (..., N, K) per kg m of w of K cylinders.

        They are in joint torques, and zero where a linkage cannot be closed.
        """
        at, up = link_motion(machine, moving), gravity_factor(moving)
        with np.errstate(divide="ignore", invalid="ignore"):
            columns = [_column(machine, moving, at, up, cylinder) for cylinder in machine.carried]
        found = np.array(columns)  # (K, 2, N, ...)
        found = np.where(np.isfinite(found), found, 0.0)
        return Halves(*found.transpose(1, *range(3, found.ndim), 2, 0))


def _column(machine: Machine, moving: Motion, at: LinkMotion, up: Vector, cylinder: Cylinder) -> list[list[Number]]:
    """Return the momentum and static column of one cylinder, both by joints (N), each a number or an array (...).

    They are [N m s] and [N m] per kg m of the cylinder's first moment w.

    at: motion of the links
    up: gravity and acceleration that act on a mass (`gravity_factor`)
    """
    turning = float(moving.slew) ** 2 if moving.q.ndim == 1 else moving.slew**2
    foot, middle = body_point(at, cylinder.linkage.pins[0]), cylinder.length_low / 2.0
    ends = (foot, point_on_line(foot, eye_point(at, cylinder.linkage), middle))
    near, far = (unit_mass_torque(end, up, turning, machine.slew_axis) for end in ends)
    return [[(b - a) / middle for a, b in zip(*half, strict=True)] for half in zip(near, far, strict=True)]
