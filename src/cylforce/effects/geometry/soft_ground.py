"""Soft ground under tracks or wheels: the machine rocks under the moment of its own arm."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.bodies import bodies, rate
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class SoftGround:
    """Soft ground: the machine pitches forward by psi = size [rad/(N m)] times the overturning moment of the arm's
    weight.

    The moment is about the middle of the tracks, `height` below the first pin. No sensor measures psi: there is no tilt
    sensor, or it averages over longer than a stroke. All links turn by -psi and their first pin moves. Every joint
    needs -(M_j psi'' + K_j psi) more. M_j [kg m^2] is the torque of joint j per rad/s^2 of a rotation of all links
    about the middle of the tracks, K_j [N m/rad] that per radian. The mean of psi counts, too, as on a machine without
    a tilt sensor.

    Two tracks of 0.6 m by 3.5 m on ground of 2 to 50 MN/m^3 turn by 5e-9 to 1e-7 rad/(N m), on bog by ten times that.
    """

    height: float = 2.0  # m, of the first pin above the ground

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="soft_ground",
            unit="rad/(N m)",
            low=1e-8,
            high=1e-6,
            place=Place.MACHINE,
            shows="in all joints alike, with the reach of the arm and with its starts and stops",
            confirm="the same moves on concrete; or a level on the house, arm in and arm out",
            sign=1,
            form=0.2,  # chosen: soil gives more at its edges, and creeps
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Height of a first pin: mini excavator 0.7 m, machine of 50 t 3 m."""
        return (ShapeRange("height", 0.7, 3.0),)

    def torque(self, machine: Machine, moving: Motion, t: Array, where: int) -> Array:
        """Return the torques (T, N) [N m] of the cylinders per rad/(N m) of size: -(M_j m'' + K_j m).

        m is the overturning moment (T,) [N m] of the arm's weight about the middle of the tracks, by the data sheet's
        masses without load, and m'' its second time derivative: psi = size m. Its first derivative m' neglects the
        change of the specific force.

        t:     (T,) time [s]
        where: not used
        """
        arm = bodies(machine, moving)
        middle = np.exp(1j * (moving.q[:, 0] - moving.a[:, 0])) * -complex(machine.slew_axis, self.height)
        reach, outwards = arm.centres.real - middle.real[:, None], arm.velocity.real
        moment = arm.specific.imag * (reach @ arm.masses)
        quickened = rate(arm.specific.imag * (outwards @ arm.masses), t)
        needed = arm.inertia(0, middle) * quickened[:, None] + arm.lowering(0, middle) * moment[:, None]
        return np.asarray(-needed)
