"""How the machine moves: everything that columns and torques are computed from, at one instant or along a recording."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cylforce.mechanics.machine import Geometry, Machine
from cylforce.signals.estimate import Array
from cylforce.signals.units import STANDARD_GRAVITY

UNKNOWN = np.zeros(0)


class Motion(NamedTuple):
    """N links, C cylinders; leading axes are samples.

    `a` (..., N): link angles from the chassis plane [rad]; `q` = a + pitch: from the true horizontal; `qd` (..., N)
    [rad/s]; `g` (...,): in-plane gravity g cos(roll) [m/s^2]; `slew` (...,): house rate [rad/s]; `length` (..., C)
    [m], `lever` (..., C, N) [m/rad], `transmission` (..., C); `speed` (..., C): d(length)/dt [m/s]; `force` (..., C):
    measured cylinder forces [N], NaN where not measured; `force_rate` (..., C): their derivative [N/s], where one
    is known."""

    a: Array
    q: Array
    qd: Array
    g: Array
    slew: Array
    length: Array
    lever: Array
    transmission: Array
    speed: Array
    force: Array
    force_rate: Array = UNKNOWN


class Attitude(NamedTuple):
    """The chassis: `pitch`, `roll` [rad], `pitch_rate` (a gyro's; never the derivative of the tilt) and `slew`
    [rad/s]."""

    pitch: ArrayLike = 0.0
    roll: ArrayLike = 0.0
    pitch_rate: ArrayLike = 0.0
    slew: ArrayLike = 0.0


LEVEL = Attitude()


def motion(
    machine: Machine,
    theta: ArrayLike,
    thetad: ArrayLike,
    force: ArrayLike,
    attitude: Attitude = LEVEL,
    geometry: Geometry | None = None,
) -> Motion:
    """Motion from joint angles and rates (..., N) and cylinder forces (..., C); `geometry` at these angles, if it is
    known already."""
    angles, rates = np.asarray(theta, dtype=np.float64), np.asarray(thetad, dtype=np.float64)
    geometry = machine.geometry(angles) if geometry is None else geometry
    a = angles.cumsum(axis=-1)
    pushed = np.asarray(force, dtype=np.float64)
    each = np.zeros(a.shape[:-1])  # what one number says of all samples
    return Motion(
        a=a,
        q=a + np.asarray(attitude.pitch)[..., None],
        qd=rates.cumsum(axis=-1) + np.asarray(attitude.pitch_rate)[..., None],
        g=STANDARD_GRAVITY * np.cos(np.asarray(attitude.roll, dtype=np.float64)) + each,
        slew=np.asarray(attitude.slew, dtype=np.float64) + each,
        length=geometry.length,
        lever=geometry.lever,
        transmission=geometry.transmission,
        speed=(geometry.lever @ rates[..., None])[..., 0],
        force=pushed,
        force_rate=np.zeros_like(pushed),
    )


def joint_torque(moving: Motion) -> Array:
    """tau_j = sum_c F_c d(ell_c)/d(theta_j) (..., N) [N m], by virtual work, for any linkage."""
    return np.asarray((moving.force[..., None, :] @ moving.lever)[..., 0, :])
