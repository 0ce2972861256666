"""Force of the outside world on the tool: r = -(dP/dq)^T F (mechanics/README.md, section 8). As a fault: the tool is in
contact with the soil while the model assumes it in the air."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.effect import Halves, Parameter
from cylforce.effects.fault import SHAPES, About, Place, TimeCourse
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class TipForce:
    """A force (x truly horizontal forward, z truly vertical up) at the tooth line and a moment on the last link.

    Both are those of the outside world on the tool; the moment is positive from x towards z.
    """

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """Return the three parameters: force x, z [N] and moment [N m]."""
        return (Parameter("tip.x", "N"), Parameter("tip.z", "N"), Parameter("tip.moment", "N m"))

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Return the static columns (..., N, 3) [N m]: the joint torques that the cylinders supply against x, z and the
        moment, per newton of x, newton of z and newton metre.
        """
        # in axes of the true horizontal; the vector from joint j to the tool is the sum of the arms from j outwards
        beyond = (np.exp(1j * moving.q) * machine.arms) @ machine.sum_outward.T
        columns = np.empty((*beyond.shape, 3))
        columns[..., 0], columns[..., 1], columns[..., 2] = beyond.imag, -beyond.real, -1.0
        return Halves(None, columns)

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="soil_contact",
            unit="N",
            low=3e3,
            high=1e5,
            place=Place.TOOL,
            shows="for some seconds at a time, in all joints as one force at the teeth",
            confirm="the same moves higher above the ground",
            axes=2 * SHAPES,
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns whose sizes change during the incident (see `fault.INCIDENTAL`)."""
        return tuple(f"tip.{axis}.{k}" for k in range(SHAPES) for axis in "xz")

    @property
    def course(self) -> TimeCourse:
        """Course of the sizes over time."""
        return TimeCourse.WINDOWS


def tip_torque(machine: Machine, moving: Motion, force: Array) -> Array:
    """Return the joint torques (T, N) [N m] that the cylinders supply against a force on the teeth.

    force: (T, 2) [N] of the outside world on the tool, x truly horizontal forward, z truly vertical up
    """
    return np.asarray((TipForce().halves(machine, moving).static[..., :2] @ force[..., None])[..., 0])
