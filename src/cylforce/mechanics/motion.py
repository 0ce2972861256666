"""Motion of the machine, at one instant or along a recording: the inputs of columns and torques."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cylforce.mechanics.chain import Complex
from cylforce.mechanics.machine import Geometry, Machine
from cylforce.signals.estimate import Array

UNKNOWN = np.zeros(0)  # a force rate that was not given


class Motion(NamedTuple):
    """Motion of N links and C cylinders; leading axes are samples.

    a: (..., N) absolute link angles from the chassis plane [rad]
    q: (..., N) a + pitch, link angles from the true horizontal [rad]
    qd: (..., N) rate of q [rad/s]
    g: (...,) specific force of the first pin within the arm's plane, s_z + i s_x in true vertical and horizontal
        [m/s^2]; the real number g cos(roll) while the base stands or its acceleration is not measured
    slew: (...,) turning rate of the house [rad/s]
    length: (..., C) cylinder lengths [m]
    lever: (..., C, N) d(length)/d(angle) [m/rad]
    transmission: (..., C) see `Geometry`
    speed: (..., C) d(length)/dt [m/s], positive: the cylinder extends
    force: (..., C) measured cylinder forces [N], positive: the cylinder pushes
    force_rate: (..., C) time derivative of `force` [N/s]; zeros from `motion`, which does not compute it; UNKNOWN,
        which is empty, where it was not given
    """

    a: Array
    q: Array
    qd: Array
    g: Array | Complex
    slew: Array
    length: Array
    lever: Array
    transmission: Array
    speed: Array
    force: Array
    force_rate: Array = UNKNOWN


class Attitude(NamedTuple):
    """Attitude of the chassis.

    pitch: (...,) of the house, positive: nose up [rad]
    roll: (...,) [rad]
    pitch_rate: (...,) from a gyro [rad/s], never the derivative of the tilt angle (mechanics/README.md, section 1)
    slew: (...,) turning rate of the house [rad/s]
    specific: (...,) specific force of the first pin within the arm's plane, s_x + i s_z in the house's axes [m/s^2];
        None: not measured
    """

    pitch: ArrayLike = 0.0
    roll: ArrayLike = 0.0
    pitch_rate: ArrayLike = 0.0
    slew: ArrayLike = 0.0
    specific: Complex | None = None


LEVEL = Attitude()


def motion(
    machine: Machine,
    theta: ArrayLike,
    thetad: ArrayLike,
    force: ArrayLike,
    attitude: Attitude = LEVEL,
    geometry: Geometry | None = None,
) -> Motion:
    """Return the motion from joint angles, joint rates and cylinder forces, with a force rate of zero.

    theta: joint angles (..., N) [rad]
    thetad: joint rates (..., N) [rad/s]
    force: cylinder forces (..., C) [N]
    attitude: attitude of the chassis
    geometry: cylinder geometry at `theta`, if it is computed already
    """
    angles, rates = np.asarray(theta, dtype=np.float64), np.asarray(thetad, dtype=np.float64)
    geometry = machine.geometry(angles) if geometry is None else geometry
    a = angles.cumsum(axis=-1)
    forces = np.asarray(force, dtype=np.float64)
    per_sample = np.zeros(a.shape[:-1])  # added to a single number, it gives the shape of the samples
    return Motion(
        a=a,
        q=a + np.asarray(attitude.pitch)[..., None],
        qd=rates.cumsum(axis=-1) + np.asarray(attitude.pitch_rate)[..., None],
        g=_gravity(machine, attitude) + per_sample,
        slew=np.asarray(attitude.slew, dtype=np.float64) + per_sample,
        length=geometry.length,
        lever=geometry.lever,
        transmission=geometry.transmission,
        speed=(geometry.lever @ rates[..., None])[..., 0],
        force=forces,
        force_rate=np.zeros_like(forces),
    )


def _gravity(machine: Machine, attitude: Attitude) -> Array | Complex:
    """Return `Motion.g` (...,) [m/s^2]: i conj(s) exp(-i pitch) of the measured specific force s = s_x + i s_z.

    Where no specific force is measured the chassis is taken as at rest: g cos(roll).
    """
    if attitude.specific is None:
        return np.asarray(machine.gravity * np.cos(np.asarray(attitude.roll, dtype=np.float64)))
    return np.asarray(1j * np.conj(attitude.specific) * np.exp(-1j * np.asarray(attitude.pitch)))


def joint_torque(moving: Motion) -> Array:
    """Return the joint torques tau_j = sum_c F_c d(ell_c)/d(theta_j) (..., N) [N m], by virtual work, for any linkage.

    See mechanics/README.md, section 2.
    """
    return np.asarray((moving.force[..., None, :] @ moving.lever)[..., 0, :])
