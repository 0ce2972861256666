"""Friction of a joint's pin, which grows with the force that presses pin and bush together."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.mechanics.bodies import bodies
from cylforce.mechanics.chain import Complex, Pose
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array

STEP = 1e-4  # m, displacement of the finite difference below; chosen: rounding and truncation both negligible


@dataclass(frozen=True, slots=True)
class PinFriction:
    """Torque r |P| sgn(w) at one joint, against its rate w.

    r = mu R is the coefficient of friction times the pin's radius, P the radial force of the pin. P carries the weight
    of the links beyond, less the force of the cylinders that cross the joint: P = m s - sum_c F_c grad(ell_c).
    grad(ell_c) is the change of a cylinder's length as these links shift sideways (virtual work). Load-dependent
    friction of a cylinder has the cylinder's lever, pin friction has not.
    """

    rounding: float = 0.005  # rad/s, rate scale of the smooth sgn(w); chosen: some 10 mm/s of a cylinder

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="pin_friction",
            unit="m",
            low=0.001,  # mu 0.05, greased, on a pin of 40 mm
            high=0.03,  # mu 0.5, dry and worn, on a pin of 120 mm
            place=Place.LINK,
            shows="in motion of that joint, reversing with it, more where pin and cylinder press hard",
            confirm="grease the pin, then the same strokes again",
            sign=1,
            form=0.1,  # chosen: bushes of both ends wear differently
        )

    def torque(self, machine: Machine, moving: Motion, t: Array, where: int) -> Array:
        """Return the additional torques (T, N) [N m] of the cylinders per metre of r.

        They are |P| sgn(w) at joint `where`, zero at the others. sgn(w) is rounded as tanh(w / rounding).
        """
        turning = np.diff(moving.qd, axis=-1, prepend=0.0)[:, where]
        pressed = np.abs(bodies(machine, moving).weight(where) - _pushed(machine, moving, where))
        found = np.zeros_like(moving.a)
        found[:, where] = pressed * np.tanh(turning / self.rounding)
        return found


def _pushed(machine: Machine, moving: Motion, joint: int) -> Complex:
    """Return the force (T,) [N], forwards + i upwards, of the cylinders on the links from `joint` outwards.

    Only cylinders that act on this joint are counted. By virtual work: force times the change of the cylinder's length
    by a displacement of these links, per metre.
    """
    at = machine.pose(np.diff(moving.a, axis=-1, prepend=0.0))
    outer = np.arange(machine.size + 1) > joint  # body 0 is the chassis
    force = np.zeros(len(moving.a), dtype=np.complex128)
    for c, cylinder in enumerate(machine.cylinders):
        if joint in machine.spans[c]:
            for way in (1.0, 1j):
                ahead, behind = (
                    cylinder.linkage.stretch(Pose(at.turn, at.origin + sign * STEP * way * outer)).length
                    for sign in (1.0, -1.0)
                )
                force += moving.force[:, c] * way * (ahead - behind) / (2.0 * STEP)
    return np.asarray(force * np.exp(1j * (moving.q[:, 0] - moving.a[:, 0])))
