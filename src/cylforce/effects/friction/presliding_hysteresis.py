"""Friction that builds up over a short distance after each reversal (Dahl, 1968)."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, RunToRun, ShapeRange
from cylforce.signals.estimate import Array
from cylforce.signals.recurrence import clipped, followed


@dataclass(frozen=True, slots=True)
class PreslidingHysteresis:
    """Difference between Dahl's friction f z and Coulomb friction f sgn(v): dz/dt = v / way (1 - z sgn(v)).

    After a reversal z, between -1 and 1, reaches its new value within a few times `way` [m].
    """

    way: float = 0.001  # m, distance after a reversal in which 63 % of the way of z to its new value is covered
    slack: float = 0.0002  # m, hysteresis against sensor noise: smaller movements to and fro do not change z; chosen
    rounding: float = 0.0005  # m/s, speed scale of the smooth sgn(v)

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="presliding_hysteresis",
            unit="N",
            low=300.0,
            high=1e4,
            place=Place.CYLINDER,
            shows="within millimetres after a reversal, gone after them",
            confirm="many short strokes of 2 to 20 mm both ways",
            sign=1,
            form=0.2,  # chosen: the true shape of the build-up differs from machine to machine
            varies=RunToRun.CREEP,
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Range of `way`: seals bend by 0.2 to 8 mm before they slide."""
        return (ShapeRange("way", 0.0002, 0.008, log=True),)

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """Return the force (T,) [N] per newton of f: z - sgn(v), sgn(v) rounded as tanh(v / rounding).

        z is integrated exactly over the movement beyond the `slack`, from z = 0 before the first sample.

        speed: (T,) of the cylinder [m/s], positive: it extends
        t:     (T,) time [s]
        """
        steps = speed * np.gradient(t)
        moved = steps - np.diff(clipped(steps, self.slack), prepend=0.0)
        bent = followed(np.copysign(1.0, moved), np.exp(-np.abs(moved) / self.way))
        return np.asarray(bent - np.tanh(speed / self.rounding))
