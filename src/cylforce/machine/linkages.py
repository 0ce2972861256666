"""Linkages between cylinders and joints: length, d(length)/d(angle), nearness of a dead point (PHYSICS section 2).

A pin is (body, local): body 0 is the chassis, body j the j-th link; `local` is x + i z in that body's frame. A linkage
may reach over several joints (a loader's tilt cylinder), so every gradient has one entry per joint.
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from cylforce.machine.chain import Complex, Point, Pose, point
from cylforce.words.estimate import Array

Pin = tuple[int, complex]


class Stretch(NamedTuple):
    """Cylinder length (...,) [m], its gradient (..., N) [m/rad], and `transmission` (...,): 0 at a dead point where the
    force no longer shows the load (the lever is infinite), 1 far from it."""

    length: Array
    gradient: Array
    transmission: Array


class Linkage(Protocol):
    """Anything that gives a cylinder's length and its gradient at a pose."""

    def stretch(self, at: Pose) -> Stretch:
        """Length, gradient and transmission at a pose; NaN where the linkage cannot be closed."""
        ...

    @property
    def pins(self) -> tuple[Pin, ...]:
        """The pins that hold the linkage."""
        ...


@dataclass(frozen=True, slots=True)
class Triangle:
    """A cylinder straight between two pins: with one joint between them ell^2 = L2^2 + f^2 - 2 L2 f cos t'."""

    foot: Pin
    eye: Pin

    def stretch(self, at: Pose) -> Stretch:
        """Distance of the two pins and its gradient."""
        return _span(point(at, *self.eye), point(at, *self.foot), None)

    @property
    def pins(self) -> tuple[Pin, ...]:
        """Foot and eye."""
        return (self.foot, self.eye)


@dataclass(frozen=True, slots=True)
class FourBar:
    """A cylinder that drives a joint through a rocker and a link (bucket linkage, dogbone, Z-bar).

    The rocker turns about `rocker_pin`; the link joins its end to `link_pin` on the driven body; the eye of the
    cylinder sits on the rocker at `eye` times the vector from rocker pin to rocker end (1: at the common pin). `side`
    = +1 when the rocker's end lies to the left of the direction rocker pin -> link pin, -1 to the right."""

    foot: Pin
    rocker_pin: Pin
    link_pin: Pin
    rocker_length: float
    link_length: float
    side: int
    eye: complex = 1.0 + 0.0j

    def stretch(self, at: Pose) -> Stretch:
        """Length of the cylinder; the rocker's end is the intersection of two circles, its motion follows from both."""
        rocker, link = point(at, *self.rocker_pin), point(at, *self.link_pin)
        base = link.place - rocker.place
        arm = self._arm(base)
        bar = arm - base  # link pin -> rocker end
        sine = _cross(arm, bar) / (self.rocker_length * self.link_length)
        # both lengths are constant: end' = rocker' + i arm spin, and bar stays perpendicular to end' - link'
        with np.errstate(divide="ignore", invalid="ignore"):
            spin = _dot(bar[..., None], link.gradient - rocker.gradient) / _cross(arm, bar)[..., None]
        eye = Point(
            rocker.place + self.eye * arm,
            rocker.gradient + 1j * self.eye * arm[..., None] * spin,
        )
        return _span(eye, point(at, *self.foot), np.abs(sine))

    def _arm(self, base: Complex) -> Complex:
        """Rocker pin -> rocker end, from rocker pin -> link pin; NaN where the two circles do not meet."""
        with np.errstate(divide="ignore", invalid="ignore"):
            span = np.abs(base)
            along = (span**2 + self.rocker_length**2 - self.link_length**2) / (2.0 * span)
            height = np.sqrt(np.maximum(self.rocker_length**2 - along**2, 0.0))
            meet = np.abs(along) <= self.rocker_length
            return np.asarray(np.where(meet, base / span * (along + 1j * self.side * height), np.nan))

    @property
    def pins(self) -> tuple[Pin, ...]:
        """Foot, rocker pin, link pin."""
        return (self.foot, self.rocker_pin, self.link_pin)


def _span(eye: Point, foot: Point, transmission: Array | None) -> Stretch:
    line = eye.place - foot.place
    length = np.abs(line)
    gradient = _dot(line[..., None], eye.gradient - foot.gradient) / length[..., None]
    return Stretch(length, gradient, np.ones_like(length) if transmission is None else transmission)


def _dot(a: Complex, b: Complex) -> Array:
    product: Array = (np.conj(a) * b).real
    return product


def _cross(a: Complex, b: Complex) -> Array:
    product: Array = (np.conj(a) * b).imag
    return product
