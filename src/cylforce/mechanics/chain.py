"""The chain of links as plane geometry in complex numbers: x forward is the real axis, z up the imaginary one.

A turn by the angle q is the factor exp(i q); the derivative of a point with respect to the angle of a joint is i times
the vector from that joint's pin to the point. Every function broadcasts over leading axes.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cylforce.signals.estimate import Array

Complex = NDArray[np.complex128]
Pin = tuple[int, complex]


class Pose(NamedTuple):
    """Where the bodies are, seen from the chassis: body 0 is the chassis, body j the j-th link.

    `turn` (..., N+1): exp(i a_j); `origin` (..., N+1): each body's origin, its inner pin (the chassis': the first pin).
    """

    turn: Complex
    origin: Complex


class Point(NamedTuple):
    """A point `place` (...,) [m] and its derivatives `gradient` (..., N) [m/rad] with respect to the joint angles."""

    place: Complex
    gradient: Complex


class Pins(NamedTuple):
    """K points fixed to bodies: `body` (K,) and place `local` (K,) [m] in its frame; `moved` (K, N): i for the joints
    that move them, 0 for those beyond their bodies."""

    body: NDArray[np.intp]
    local: Complex
    moved: Complex


@lru_cache
def fixed(pins: tuple[Pin, ...], joints: int) -> Pins:
    """Pins of a chain of N = `joints` links."""
    body = np.array([body for body, _ in pins], dtype=np.intp)
    moved = np.where(np.arange(joints) < body[:, None], 1j, 0.0)
    return Pins(body, np.array([local for _, local in pins], dtype=np.complex128), moved)


def pose(lengths: Array, theta: ArrayLike) -> Pose:
    """Pose of a chain with pin-to-pin `lengths` (N,) [m] at joint angles `theta` (..., N) [rad]."""
    angles = np.asarray(theta, dtype=np.float64).cumsum(axis=-1)
    shape = (*angles.shape[:-1], angles.shape[-1] + 1)
    # samples next to each other: along a recording twice as fast as a body's few numbers next to each other
    turn, origin = np.ones(shape, dtype=np.complex128, order="F"), np.zeros(shape, dtype=np.complex128, order="F")
    np.exp(1j * angles, out=turn[..., 1:])
    np.cumsum(lengths[:-1] * turn[..., 1:-1], axis=-1, out=origin[..., 2:])
    return Pose(turn, origin)


def points(at: Pose, pins: Pins) -> Point:
    """All pins: `place` (..., K) and `gradient` (..., K, N)."""
    place = at.origin[..., pins.body] + at.turn[..., pins.body] * pins.local
    return Point(place, pins.moved * (place[..., None] - at.origin[..., None, 1:]))


def point(at: Pose, body: int, local: complex) -> Point:
    """The point `local` [m] of a body (0: chassis) and its derivatives; zero for joints beyond that body."""
    found = points(at, fixed(((body, local),), at.turn.shape[-1] - 1))
    return Point(found.place[..., 0], found.gradient[..., 0, :])
