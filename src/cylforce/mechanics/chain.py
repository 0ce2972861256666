"""The chain of links as plane geometry in complex numbers: the real axis is x (forward), the imaginary axis z (up).

A rotation by the angle q is the factor exp(i q); the derivative of a point with respect to a joint angle is i times the
vector from that joint's pin to the point. Every function broadcasts over leading axes.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cylforce.signals.estimate import Array

Complex = NDArray[np.complex128]
Pin = tuple[int, complex]


class Pose(NamedTuple):
    """Orientation and place of all bodies in chassis axes: body 0 is the chassis, body j the j-th link.

    `turn` (..., N+1): exp(i a_j), a_j the body's absolute angle; `origin` (..., N+1) [m]: each link's inner pin (body
    0: the first pin)."""

    turn: Complex
    origin: Complex


class Point(NamedTuple):
    """A point `place` (...,) [m] and its derivatives `gradient` (..., N) [m/rad] with respect to the joint angles."""

    place: Complex
    gradient: Complex


class Pins(NamedTuple):
    """K points fixed to bodies: number of the `body` (K,) and place `local` (K,) [m] in that body's frame; `moved`
    (K, N): i for the joints that move the point, 0 for the joints farther out."""

    body: NDArray[np.intp]
    local: Complex
    moved: Complex


@lru_cache
def fixed(pins: tuple[Pin, ...], joints: int) -> Pins:
    """`pins` as arrays, for a chain of N = `joints` links."""
    body = np.array([body for body, _ in pins], dtype=np.intp)
    moved = np.where(np.arange(joints) < body[:, None], 1j, 0.0)
    return Pins(body, np.array([local for _, local in pins], dtype=np.complex128), moved)


def pose(lengths: Array, theta: ArrayLike) -> Pose:
    """Pose of a chain with pin-to-pin `lengths` (N,) [m] at joint angles `theta` (..., N) [rad]."""
    angles = np.asarray(theta, dtype=np.float64).cumsum(axis=-1)
    shape = (*angles.shape[:-1], angles.shape[-1] + 1)
    # order F puts the samples of one body next to each other in memory: twice as fast along a recording
    turn, origin = np.ones(shape, dtype=np.complex128, order="F"), np.zeros(shape, dtype=np.complex128, order="F")
    np.exp(1j * angles, out=turn[..., 1:])
    np.cumsum(lengths[:-1] * turn[..., 1:-1], axis=-1, out=origin[..., 2:])
    return Pose(turn, origin)


def points(at: Pose, pins: Pins) -> Point:
    """Places (..., K) [m] and gradients (..., K, N) [m/rad] of all pins at a pose."""
    place = at.origin[..., pins.body] + at.turn[..., pins.body] * pins.local
    return Point(place, pins.moved * (place[..., None] - at.origin[..., None, 1:]))


def point(at: Pose, body: int, local: complex) -> Point:
    """The point `local` [m] in the frame of a body (0: chassis): place (...,) and gradient (..., N), zero for joints
    beyond that body."""
    found = points(at, fixed(((body, local),), at.turn.shape[-1] - 1))
    return Point(found.place[..., 0], found.gradient[..., 0, :])
