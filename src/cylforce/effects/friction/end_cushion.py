"""Cushions at the ends of a cylinder's stroke."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array

STATED_SPEED = 0.1  # m/s, speed at which the size f is stated


@dataclass(frozen=True, slots=True)
class EndCushion:
    """Cushion that throttles the outflow of oil near an end of the stroke: force f s (v / 0.1 m/s)^2 against motion
    into it, which the cylinder must supply in addition, in the direction of the motion.

    s is the share of the cushion's `length` that the piston has entered, because its taper closes the outflow
    gradually. The square is turbulent flow through the remaining gap. Out of the end a check valve admits the oil: no
    force. The pressure sensor in the line does not measure the trapped oil.
    """

    length: float = 0.05  # m, of the cushion along the stroke
    end: int = 0  # end with a cushion; 1: where the cylinder is extended, -1: where it is retracted, 0: both

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="end_cushion",
            unit="N",
            low=500.0,
            high=1e5,
            place=Place.CYLINDER,
            shows="in motion into the last centimetres of a stroke only",
            confirm="strokes into both ends at two speeds, and out of them",
            sign=1,
            form=0.2,  # chosen: taper and gap differ from machine to machine
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Range of `length`: cushions of cylinders from 40 to 200 mm bore, 20 to 200 mm."""
        return (ShapeRange("length", 0.02, 0.2, log=True),)

    def torque(self, machine: Machine, moving: Motion, t: Array, where: int) -> Array:
        """Return the torques (T, N) [N m] that cylinder `where` supplies in addition, per newton of f.

        f is the force at 0.1 m/s and full depth.
        """
        cylinder, length = machine.cylinders[where], moving.length[:, where]
        gaps = {1: cylinder.length_high - length, -1: length - cylinder.length_low}
        depth = {end: np.clip(1.0 - gap / self.length, 0.0, 1.0) for end, gap in gaps.items()}
        speed = moving.speed[:, where] / STATED_SPEED
        into = {end: end * depth[end] * np.maximum(end * speed, 0.0) ** 2 for end in gaps if self.end in (0, end)}
        return np.asarray(sum(into.values())[:, None] * moving.lever[:, where, :])
