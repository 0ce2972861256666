"""A link or its oil that gives like a spring and rings after every jerk."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.bodies import bodies, resonance
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class RingingCompliance:
    """Spring of compliance c [rad/(N m)] between a joint and the links beyond, which the joint's sensor does not
    measure.

    The links turn by d beyond the measured angle, d'' + 2 D w d' + w^2 d = -c w^2 tau. The natural frequency w / 2 pi
    is `frequency`, the damping ratio D is `damping`, and tau is the torque that holds and moves these links. Every
    joint j needs M_j d'' + K_j d more: M_j is the inertia of these links about the joint, K_j the change of their
    weight's torque per radian.

    With c = 1 / (M w^2) and without weight this is the exact answer of two masses on a spring,
    -s^2 / (s^2 + 2 D w s + w^2) tau; a load in the bucket makes c w^2 larger. tau is that of the data sheet's masses.
    """

    frequency: float = 2.0  # Hz, natural frequency
    damping: float = 0.1  # damping ratio

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="ringing_compliance",
            unit="rad/(N m)",
            low=4e-8,
            high=8e-6,
            place=Place.LINK,
            shows="as a decaying oscillation after starts and stops, and under load with the posture",
            confirm="stop the joint sharply and count the swings of its pressure",
            sign=1,
            form=0.2,  # chosen: its frequency falls as the arm reaches out
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Natural frequency: oil columns and arms of 1 to 50 t machines, 0.7 to 8 Hz. Damping ratio: bare steel 0.02,
        hardly an overshoot 0.6."""
        return ShapeRange("frequency", 0.7, 8.0, log=True), ShapeRange("damping", 0.02, 0.6, log=True)

    def torque(self, machine: Machine, moving: Motion, t: Array, where: int) -> Array:
        """Return the torques (T, N) [N m] of the cylinders per rad/(N m) of c: -(M_j W'' + K_j W).

        W is the spring's response to tau, w^2 / (s^2 + 2 D w s + w^2) tau [N m], and W'' its second time derivative.

        t:     (T,) time, evenly spaced [s]
        where: number of the joint with the spring
        """
        arm = bodies(machine, moving)
        bent, accelerated = resonance(arm.torque(t, where), t, self.frequency, self.damping)
        pivot = arm.pins[:, where]
        needed = arm.inertia(where, pivot) * accelerated[:, None] + arm.lowering(where, pivot) * bent[:, None]
        return np.asarray(-needed)
