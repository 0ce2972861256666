"""The chain of links as plane geometry in complex numbers: x forward is the real axis, z up the imaginary one.

A turn by the angle q is the factor exp(i q); the derivative of a point with respect to the angle of a joint is i times
the vector from that joint's pin to the point. Every function broadcasts over leading axes.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cylforce.words.estimate import Array

Complex = NDArray[np.complex128]


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


def pose(lengths: Array, theta: ArrayLike) -> Pose:
    """Pose of a chain with pin-to-pin `lengths` (N,) [m] at joint angles `theta` (..., N) [rad]."""
    angles = np.asarray(theta, dtype=np.float64)
    links = np.exp(1j * np.cumsum(angles, axis=-1))
    ends = np.cumsum(lengths * links, axis=-1)
    zero = np.zeros((*angles.shape[:-1], 1), dtype=np.complex128)
    return Pose(
        turn=np.concatenate([zero + 1.0, links], axis=-1),
        origin=np.concatenate([zero, zero, ends[..., :-1]], axis=-1),
    )


def point(at: Pose, body: int, local: complex) -> Point:
    """The point `local` [m] of a body (0: chassis) and its derivatives; zero for joints beyond that body."""
    place = at.origin[..., body] + at.turn[..., body] * local
    gradient = np.zeros((*place.shape, at.turn.shape[-1] - 1), dtype=np.complex128)
    gradient[..., :body] = 1j * (place[..., None] - at.origin[..., 1 : body + 1])
    return Point(place, gradient)
