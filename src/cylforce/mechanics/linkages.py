"""Linkages between cylinders and joints: length, d(length)/d(angle), nearness of a dead point.

The equations are in mechanics/README.md, section 2. A pin is (body, local): body 0 is the chassis, body j the j-th
link; `local` is x + i z in that body's frame. A linkage may reach over several joints (a loader's tilt cylinder), so
every gradient has one entry per joint.
"""

from cmath import exp
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise
from math import nan, sqrt
from typing import NamedTuple, Protocol

import numpy as np

from cylforce.mechanics.chain import Complex, Pin, Point, Pose, fixed, points
from cylforce.signals.estimate import Array


class Stretch(NamedTuple):
    """Length of a cylinder and its derivatives; of C cylinders each shape has one more axis of C (`Linkages.stretch`).

    length: (...,) from foot to eye [m]
    gradient: (..., N) d(length)/d(angle) by each of the N joint angles [m/rad]
    transmission: (...,) sine of the angle between rocker and link. 0 at the dead point, where the lever is infinite and
        the cylinder force no longer depends on the load; 1 for a cylinder without a linkage.
    """

    length: Array
    gradient: Array
    transmission: Array


class Eye(NamedTuple):
    """The cylinder's rod end (eye).

    place: (...,) x + i z in chassis axes [m]
    gradient: (..., N) its derivatives by the joint angles [m/rad]
    transmission: (...,) as in `Stretch`
    """

    place: Complex
    gradient: Complex
    transmission: Array | float


class Linkage(Protocol):
    """A linkage between a cylinder and the joints, which gives the place of the cylinder's rod end (eye)."""

    @property
    def pins(self) -> tuple[Pin, ...]:
        """Return the K pins that hold cylinder and linkage, the cylinder's foot first."""
        ...

    def driven(self, pins: Point) -> Eye:
        """Return place, gradient and transmission of the eye; NaN where the linkage cannot be closed.

        pins: places (..., K) [m] of the K pins, in the order of `pins`, and their gradients (..., K, N) [m/rad]
        """
        ...

    def places(self, at: Pose) -> dict[str, Complex]:
        """Return the places (...,) [m] of all pins of the linkage at a pose, by name, for a drawing."""
        ...

    def eye_of(self, places: Sequence[complex], moved: Sequence[complex]) -> tuple[complex, complex]:
        """Return the eye's place [m] and its derivative by one joint angle [m/rad], as `driven`, for one pose.

        NaN where the linkage cannot be closed. Plain numbers x + i z, because arrays of one element are slow.

        places: of the K pins, all in the axes of one body [m]
        moved:  derivatives of these places by the joint angle [m/rad]
        """
        ...

    def stretch(self, at: Pose) -> Stretch:
        """Return the cylinder's length (...,) [m], gradient (..., N) [m/rad] and transmission (...,) at a pose.

        NaN where the linkage cannot be closed.
        """
        stretch = Linkages((self,)).stretch(at)
        return Stretch(stretch.length[..., 0], stretch.gradient[..., 0, :], stretch.transmission[..., 0])

    def over_one_joint(self, joint: complex, angle: float) -> tuple[float, float]:
        """Return length [m] and d(length)/d(angle) [m/rad] of a cylinder that acts on one joint only, at one angle.

        NaN where the linkage cannot be closed. The angles of the other joints have no influence.

        joint: place x + i z of the joint's pin in the frame of the body before it [m]
        angle: of the joint [rad]
        """
        turn, before = exp(1j * angle), min(body for body, _ in self.pins)
        arms = [turn * local if body > before else 0j for body, local in self.pins]
        places = [joint + arm if body > before else local for (body, local), arm in zip(self.pins, arms, strict=True)]
        moved = [1j * arm for arm in arms]
        eye, eye_moved = self.eye_of(places, moved)
        line = eye - places[0]
        return abs(line), (line.conjugate() * (eye_moved - moved[0])).real / abs(line)


@dataclass(frozen=True)
class Linkages:
    """The linkages of C cylinders, evaluated together.

    linkages: one linkage per cylinder
    """

    linkages: tuple[Linkage, ...]

    @cached_property
    def _pins(self) -> tuple[Pin, ...]:
        """Return the pins of all linkages, one after the other."""
        return tuple(pin for linkage in self.linkages for pin in linkage.pins)

    @cached_property
    def _pins_of_linkage(self) -> tuple[slice, ...]:
        """Return for each linkage the slice of its pins among all pins."""
        ends = accumulate((len(linkage.pins) for linkage in self.linkages), initial=0)
        return tuple(slice(*ends) for ends in pairwise(ends))

    @cached_property
    def _feet(self) -> list[int]:
        """Return the number of each cylinder's foot among all pins."""
        return [part.start for part in self._pins_of_linkage]

    def stretch(self, at: Pose) -> Stretch:
        """Return lengths (..., C) [m], gradients (..., C, N) [m/rad] and transmissions (..., C) at a pose.

        NaN where a linkage cannot be closed.
        """
        pins = points(at, fixed(self._pins, at.turn.shape[-1] - 1))
        with np.errstate(divide="ignore", invalid="ignore"):  # infinite or NaN at and beyond a dead point
            eye, transmission = self._driven(pins)
            line = eye.place - pins.place[..., self._feet]
            length = np.abs(line)
            gradient = _dot(line[..., None], eye.gradient - pins.gradient[..., self._feet, :]) / length[..., None]
        return Stretch(length, gradient, transmission)

    def _driven(self, pins: Point) -> tuple[Point, Array]:
        """Return the eyes (rod ends) and the transmissions (..., C) of all linkages.

        Eyes are places (..., C), x + i z in chassis axes from the first pin [m], and gradients (..., C, N) [m/rad]. A
        transmission is a sine, as in `Stretch`; 1 without a linkage. Where a linkage cannot be closed, its three values
        are NaN; at a dead point only its gradient is infinite or NaN.

        pins: of all linkages, one after the other: places (..., K) [m] and gradients (..., K, N) [m/rad]
        """
        shape, joints = (*pins.place.shape[:-1], len(self.linkages)), pins.gradient.shape[-1]
        eye, transmission = Point(np.empty(shape, complex), np.empty((*shape, joints), complex)), np.empty(shape)
        for c, (linkage, part) in enumerate(zip(self.linkages, self._pins_of_linkage, strict=True)):
            rod_end = linkage.driven(Point(pins.place[..., part], pins.gradient[..., part, :]))
            eye.place[..., c], eye.gradient[..., c, :] = rod_end.place, rod_end.gradient
            transmission[..., c] = rod_end.transmission
        return eye, transmission


@dataclass(frozen=True, slots=True)
class Triangle(Linkage):
    """A cylinder directly between two pins.

    With one joint between them ell^2 = L2^2 + f^2 - 2 L2 f cos t', with L2 and f the distances of the pins from the
    joint and t' the angle between them (mechanics/README.md, section 2).

    foot: pin of the cylinder's housing
    eye: pin of its rod
    """

    foot: Pin
    eye: Pin

    @property
    def pins(self) -> tuple[Pin, ...]:
        """Return foot and eye."""
        return (self.foot, self.eye)

    def driven(self, pins: Point) -> Eye:
        """Return the second of the two pins as the eye, with a transmission of 1."""
        return Eye(pins.place[..., 1], pins.gradient[..., 1, :], 1.0)

    def eye_of(self, places: Sequence[complex], moved: Sequence[complex]) -> tuple[complex, complex]:
        """Return the place of the second of the two pins [m] and its derivative [m/rad]: it is the eye."""
        return places[1], moved[1]

    def places(self, at: Pose) -> dict[str, Complex]:
        """Return the places (...,) [m] of foot and eye, by name."""
        place = points(at, fixed(self.pins, at.turn.shape[-1] - 1)).place
        return {"foot": place[..., 0], "eye": place[..., 1]}


@dataclass(frozen=True, slots=True)
class FourBar(Linkage):
    """A cylinder that drives a joint through a rocker and a link (bucket linkage, dogbone, Z-bar).

    foot: pin of the cylinder's housing
    rocker_pin: pin about which the rocker turns
    link_pin: pin of the link on the driven body; the link joins it to the rocker's end
    rocker_length: distance of the two pins of the rocker [m]
    link_length: distance of the two pins of the link [m]
    side: +1 when the rocker's end lies left of the direction rocker pin -> link pin, -1 right of it
    eye: place of the cylinder's eye on the rocker: the vector from rocker pin to eye divided by that from rocker pin to
        rocker end, both x + i z; 1: at the rocker's end
    """

    foot: Pin
    rocker_pin: Pin
    link_pin: Pin
    rocker_length: float
    link_length: float
    side: int
    eye: complex = 1.0 + 0.0j

    @property
    def pins(self) -> tuple[Pin, ...]:
        """Return foot, rocker pin and link pin."""
        return (self.foot, self.rocker_pin, self.link_pin)

    def driven(self, pins: Point) -> Eye:
        """Return the eye: the rocker's end is the intersection of two circles, the eye is fixed to the rocker.

        NaN where the circles do not meet; the gradient is infinite or NaN where rocker and link are in line.

        pins: places (..., 3) [m] of foot, rocker pin and link pin, and their gradients (..., 3, N) [m/rad]
        """
        arm, spin, cross = self._turned(pins)
        eye = self.eye * arm
        gradient = pins.gradient[..., 1, :] + 1j * eye[..., None] * spin
        place = pins.place[..., 1] + eye
        return Eye(place, gradient, np.abs(cross) / (self.rocker_length * self.link_length))

    def eye_of(self, places: Sequence[complex], moved: Sequence[complex]) -> tuple[complex, complex]:
        """Return the eye's place [m] and its derivative by one joint angle [m/rad], as `driven`, for one pose.

        NaN where the linkage cannot be closed, and where rocker and link are in line.

        places: of foot, rocker pin and link pin, all in the axes of one body [m]
        moved:  derivatives of these places by the joint angle [m/rad]
        """
        base, apart = places[2] - places[1], moved[2] - moved[1]
        span = abs(base)
        along = (span * span + (self.rocker_length**2 - self.link_length**2)) / (2.0 * span)
        square = self.rocker_length**2 - along * along
        if not square > 0.0:  # the circles do not meet, or touch at a dead point
            return complex(nan, nan), complex(nan, nan)
        arm = base / span * (along + 1j * self.side * sqrt(square))
        bar = arm - base
        spin = (bar.conjugate() * apart).real / (arm.conjugate() * bar).imag
        return places[1] + self.eye * arm, moved[1] + 1j * self.eye * arm * spin

    def places(self, at: Pose) -> dict[str, Complex]:
        """Return the places (...,) [m] of foot, rocker pin, link pin, rocker end, by name.

        The cylinder's eye is among them where it is not the rocker's end.
        """
        place = points(at, fixed(self.pins, at.turn.shape[-1] - 1)).place
        arm = self.arm(place[..., 2] - place[..., 1])
        places = {"foot": place[..., 0], "rocker pin": place[..., 1], "link pin": place[..., 2]}
        places["rocker end"] = place[..., 1] + arm
        return places if self.eye == 1.0 else places | {"eye": place[..., 1] + self.eye * arm}

    def _turned(self, pins: Point) -> tuple[Complex, Array, Array]:
        """Return the rocker's vector from pin to end, its rotation by joint angle, and a cross product.

        The vector is x + i z (...,) [m]. The rotation (..., N) is the rocker's angle per angle of each joint [rad/rad],
        infinite or NaN at a dead point. The cross product (...,) [m^2] is that of rocker and link: 0 at a dead point.

        pins: of foot, rocker pin and link pin, see `driven`
        """
        rocker, link = pins.place[..., 1], pins.place[..., 2]
        apart = pins.gradient[..., 2, :] - pins.gradient[..., 1, :]
        arm = self.arm(link - rocker)
        bar = arm - (link - rocker)  # link pin -> rocker end
        cross = _cross(arm, bar)
        # both lengths are constant: end' = rocker' + i arm spin, and bar is perpendicular to end' - link'
        return arm, _dot(bar[..., None], apart) / cross[..., None], cross

    def arm(self, base: Complex) -> Complex:
        """Return the vector from rocker pin to rocker end, on the given `side` of `base`; NaN where the circles do not
        meet.

        base: vector from rocker pin to link pin (...,) [m]
        """
        # along base: (base^2 + rocker^2 - link^2) / (2 base); across it: Pythagoras
        span = np.abs(base)
        along = (span * span + (self.rocker_length**2 - self.link_length**2)) / (2.0 * span)
        height = np.sqrt(self.rocker_length**2 - along * along)
        return np.asarray(base / span * (along + 1j * self.side * height))


def _dot(a: Complex, b: Complex) -> Array:
    """Return the scalar product of two vectors x + i z."""
    product: Array = (np.conj(a) * b).real
    return product


def _cross(a: Complex, b: Complex) -> Array:
    """Return the cross product a_x b_z - a_z b_x of two vectors x + i z."""
    product: Array = (np.conj(a) * b).imag
    return product
