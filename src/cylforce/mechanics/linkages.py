"""Linkages between cylinders and joints: length, d(length)/d(angle), nearness of a dead point
(mechanics/README.md, section 2).

A pin is (body, local): body 0 is the chassis, body j the j-th link; `local` is x + i z in that body's frame. A linkage
may reach over several joints (a loader's tilt cylinder), so every gradient has one entry per joint.
"""

from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import NamedTuple, Protocol

import numpy as np

from cylforce.mechanics.chain import Complex, Pin, Point, Pose, fixed, points
from cylforce.signals.estimate import Array
from cylforce.signals.quick import once


class Stretch(NamedTuple):
    """Cylinder length (...,) [m], its gradient (..., N) [m/rad], and `transmission` (...,): sine of the angle between
    rocker and link, 0 at the dead point where the cylinder force no longer depends on the load (infinite lever), 1 for
    a cylinder without a linkage."""

    length: Array
    gradient: Array
    transmission: Array


class Eye(NamedTuple):
    """The cylinder's rod end (eye): `place` (...,) [m], `gradient` (..., N) [m/rad], `transmission` (...,)."""

    place: Complex
    gradient: Complex
    transmission: Array | float


class Linkage(Protocol):
    """A linkage between a cylinder and the joints: gives the place of the cylinder's rod end (eye)."""

    @property
    def pins(self) -> tuple[Pin, ...]:
        """The K pins that hold cylinder and linkage, the cylinder's foot first."""
        ...

    def driven(self, pins: Point) -> Eye:
        """The eye from the places (..., K) of the pins; NaN where the linkage cannot be closed."""
        ...

    def places(self, at: Pose) -> dict[str, Complex]:
        """Where everything is that a linkage turns about, (...,) [m] by name, at a pose, for a drawing."""
        ...

    def stretch(self, at: Pose) -> Stretch:
        """Length, gradient and transmission at a pose; NaN where the linkage cannot be closed."""
        found = Linkages((self,)).stretch(at)
        return Stretch(found.length[..., 0], found.gradient[..., 0, :], found.transmission[..., 0])


@dataclass(frozen=True)
class Linkages:
    """The linkages of C cylinders, evaluated together."""

    each: tuple[Linkage, ...]

    @once
    def _pins(self) -> tuple[Pin, ...]:
        return tuple(pin for linkage in self.each for pin in linkage.pins)

    @once
    def _own(self) -> tuple[slice, ...]:
        """For each linkage the slice of its pins among all pins."""
        ends = accumulate((len(linkage.pins) for linkage in self.each), initial=0)
        return tuple(slice(*ends) for ends in pairwise(ends))

    @once
    def _feet(self) -> list[int]:
        return [own.start for own in self._own]

    def stretch(self, at: Pose) -> Stretch:
        """Lengths (..., C), gradients (..., C, N) and transmissions (..., C) at a pose."""
        pins = points(at, fixed(self._pins, at.turn.shape[-1] - 1))
        with np.errstate(divide="ignore", invalid="ignore"):  # infinite or NaN at and beyond a dead point
            eye, transmission = self._driven(pins)
            line = eye.place - pins.place[..., self._feet]
            length = np.abs(line)
            gradient = _dot(line[..., None], eye.gradient - pins.gradient[..., self._feet, :]) / length[..., None]
        return Stretch(length, gradient, transmission)

    def _driven(self, pins: Point) -> tuple[Point, Array]:
        """Eyes (..., C) and transmissions (..., C)."""
        shape, joints = (*pins.place.shape[:-1], len(self.each)), pins.gradient.shape[-1]
        eye, transmission = Point(np.empty(shape, complex), np.empty((*shape, joints), complex)), np.empty(shape)
        for c, (linkage, own) in enumerate(zip(self.each, self._own, strict=True)):
            found = linkage.driven(Point(pins.place[..., own], pins.gradient[..., own, :]))
            eye.place[..., c], eye.gradient[..., c, :], transmission[..., c] = found
        return eye, transmission


@dataclass(frozen=True, slots=True)
class Triangle(Linkage):
    """A cylinder directly between two pins. With one joint between them ell^2 = L2^2 + f^2 - 2 L2 f cos t', with L2 and
    f the distances of the pins from the joint and t' the angle between them (mechanics/README.md, section 2)."""

    foot: Pin
    eye: Pin

    @property
    def pins(self) -> tuple[Pin, ...]:
        """Foot and eye."""
        return (self.foot, self.eye)

    def driven(self, pins: Point) -> Eye:
        """The second pin."""
        return Eye(pins.place[..., 1], pins.gradient[..., 1, :], 1.0)

    def places(self, at: Pose) -> dict[str, Complex]:
        """Foot and eye."""
        place = points(at, fixed(self.pins, at.turn.shape[-1] - 1)).place
        return {"foot": place[..., 0], "eye": place[..., 1]}


@dataclass(frozen=True, slots=True)
class FourBar(Linkage):
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

    @property
    def pins(self) -> tuple[Pin, ...]:
        """Foot, rocker pin, link pin."""
        return (self.foot, self.rocker_pin, self.link_pin)

    def driven(self, pins: Point) -> Eye:
        """The rocker's end is the intersection of two circles, its motion follows from both."""
        arm, spin, sine = self._turned(pins)
        eye = self.eye * arm
        gradient = pins.gradient[..., 1, :] + 1j * eye[..., None] * spin
        place = pins.place[..., 1] + eye
        return Eye(place, gradient, np.abs(sine) / (self.rocker_length * self.link_length))

    def places(self, at: Pose) -> dict[str, Complex]:
        """Foot, rocker pin, link pin, rocker end, and the cylinder's eye where it is not the rocker's end."""
        place = points(at, fixed(self.pins, at.turn.shape[-1] - 1)).place
        arm = self.arm(place[..., 2] - place[..., 1])
        found = {"foot": place[..., 0], "rocker pin": place[..., 1], "link pin": place[..., 2]}
        found["rocker end"] = place[..., 1] + arm
        return found if self.eye == 1.0 else found | {"eye": place[..., 1] + self.eye * arm}

    def _turned(self, pins: Point) -> tuple[Complex, Array, Array]:
        """Vector from rocker pin to rocker end (...,) [m], its rotation per joint angle (..., N), and the cross product
        of rocker and link (...,) [m^2]."""
        rocker, link = pins.place[..., 1], pins.place[..., 2]
        apart = pins.gradient[..., 2, :] - pins.gradient[..., 1, :]
        arm = self.arm(link - rocker)
        bar = arm - (link - rocker)  # link pin -> rocker end
        sine = _cross(arm, bar)
        # both lengths are constant: end' = rocker' + i arm spin, and bar stays perpendicular to end' - link'
        return arm, _dot(bar[..., None], apart) / sine[..., None], sine

    def arm(self, base: Complex) -> Complex:
        """Vector from rocker pin to rocker end, on the given `side` of the vector `base` from rocker pin to link pin;
        NaN where the circles of rocker and bar do not meet."""
        span = np.abs(base)
        along = (span * span + (self.rocker_length**2 - self.link_length**2)) / (2.0 * span)
        height = np.sqrt(self.rocker_length**2 - along * along)
        return np.asarray(base / span * (along + 1j * self.side * height))


def _dot(a: Complex, b: Complex) -> Array:
    product: Array = (np.conj(a) * b).real
    return product


def _cross(a: Complex, b: Complex) -> Array:
    product: Array = (np.conj(a) * b).imag
    return product
