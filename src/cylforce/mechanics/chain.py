"""The chain of links as plane geometry in complex numbers: real axis x (forward), imaginary axis z (up).

A rotation by the angle q is the factor exp(i q). The derivative of a point by a joint angle is i times the vector from
that joint's pin to the point. Every function broadcasts over leading axes.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cylforce.signals.estimate import Array

Complex = NDArray[np.complex128]
Pin = tuple[int, complex]  # number of the body (0: the chassis) and place x + i z in its frame [m]


class Pose(NamedTuple):
    """Orientation and place of all bodies in chassis axes: body 0 is the chassis, body j the j-th link.

    turn: (..., N+1) exp(i a_j), with a_j the body's angle from the chassis, the sum of the joint angles up to it [rad]
    origin: (..., N+1) place x + i z of each link's inner pin [m]; the first pin is the origin 0, also of body 0
    """

    turn: Complex
    origin: Complex


class Point(NamedTuple):
    """A point and its derivatives by the joint angles.

    place: (...,) x + i z in chassis axes, from the first pin [m]
    gradient: (..., N) derivative of the place by each of the N joint angles, x + i z [m/rad]
    """

    place: Complex
    gradient: Complex


class Pins(NamedTuple):
    """K points that are fixed to bodies.

    body: (K,) number of the body; 0: the chassis
    local: (K,) place x + i z in that body's frame [m]
    moved: (K, N) i for the joints that move the point, 0 for the joints farther out
    """

    body: NDArray[np.intp]
    local: Complex
    moved: Complex


@lru_cache
def fixed(pins: tuple[Pin, ...], joints: int) -> Pins:
    """Return K pins as arrays, for a chain of N = `joints` links.

    pins: number of the body (0: the chassis) and place x + i z in its frame [m] of each pin
    """
    body = np.array([body for body, _ in pins], dtype=np.intp)
    moved = np.where(np.arange(joints) < body[:, None], 1j, 0.0)
    return Pins(body, np.array([local for _, local in pins], dtype=np.complex128), moved)


def pose(lengths: Array, theta: ArrayLike) -> Pose:
    """Return the pose of a chain with pin-to-pin lengths (N,) [m] at joint angles theta (..., N) [rad].

    The length of the last link is not used.
    """
    angles = np.asarray(theta, dtype=np.float64).cumsum(axis=-1)
    shape = (*angles.shape[:-1], angles.shape[-1] + 1)
    # order F puts the samples of one body next to each other in memory: twice as fast along a recording
    turn, origin = np.ones(shape, dtype=np.complex128, order="F"), np.zeros(shape, dtype=np.complex128, order="F")
    np.exp(1j * angles, out=turn[..., 1:])
    np.cumsum(lengths[:-1] * turn[..., 1:-1], axis=-1, out=origin[..., 2:])
    return Pose(turn, origin)


def points(at: Pose, pins: Pins) -> Point:
    """Return places (..., K) [m] and gradients (..., K, N) [m/rad] of all pins at a pose, x + i z in chassis axes."""
    place = at.origin[..., pins.body] + at.turn[..., pins.body] * pins.local
    return Point(place, pins.moved * (place[..., None] - at.origin[..., None, 1:]))


def point(at: Pose, body: int, local: complex) -> Point:
    """Return place (...,) [m] and gradient (..., N) [m/rad] of one point that is fixed to a body.

    The gradient is zero for joints beyond that body.

    body: number of the body; 0: chassis
    local: place x + i z in the body's frame [m]
    """
    alone = points(at, fixed(((body, local),), at.turn.shape[-1] - 1))
    return Point(alone.place[..., 0], alone.gradient[..., 0, :])
