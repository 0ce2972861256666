"""Hoses across a joint, which bend like a spring."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class HoseSpring:
    """Hoses across a joint that the cylinders must bend: torque k x, x the angle from where the hoses are free of
    torque.

    With `cubic` it is k x (x / h)^2, h half the joint's range: a loop that is tight only near its ends. x is zero at
    low + rest (high - low) of the joint's range.

    A loop of length L and bending stiffness E I has k = E I / L (Euler and Bernoulli): tens of N m/rad for a hose of
    one inch with wire braid, of which two to ten cross a joint.
    """

    rest: float = 0.5  # share of the joint's range at which the hoses are at rest
    cubic: bool = False  # whether the torque grows with the third power of the angle, not in proportion to it

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="hose_spring",
            unit="N m/rad",
            low=50.0,
            high=3e3,
            place=Place.LINK,
            shows="with that joint's angle alone, at rest too, whatever the posture of the others",
            confirm="the same joint angles with the link before it level and upright; look for tight hoses",
            sign=1,
            form=0.1,  # chosen: a loop of hose is no exact spring
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Range of `rest`: anywhere in the range of the joint."""
        return (ShapeRange("rest", 0.0, 1.0),)

    def torque(self, machine: Machine, moving: Motion, t: Array, where: int) -> Array:
        """Return the additional torques (T, N) [N m] of the cylinders per N m/rad of k.

        They are x [rad], or x (x / h)^2, at joint `where`, zero at the others.
        """
        link = machine.links[where]
        half = 0.5 * (link.angle_high - link.angle_low)
        x = np.diff(moving.a, axis=-1, prepend=0.0)[:, where] - link.angle_low - 2.0 * half * self.rest
        found = np.zeros_like(moving.a)
        found[:, where] = x * (x / half) ** 2 if self.cubic else x
        return found
