"""Points that move with the arm: places, velocities, and their derivatives by the joint angles.

Values are kept joint by joint in lists: of arrays along a recording, of Python numbers at one instant. Python numbers
are several times faster than arrays of three elements.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.mechanics.chain import Pin
from cylforce.mechanics.linkages import FourBar, Linkage
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array

Number = float | Array
Vector = complex | NDArray[Any]


class MovingPoint(NamedTuple):
    """A point of the arm along a motion, x + i z in chassis axes.

    place: (...,) from the first pin [m]
    velocity: (...,) relative to the first pin, including that by the pitch rate of the house [m/s]
    gradient: for each of N joints the derivative of the place by the joint's angle (...,) [m/rad]
    rate: for each of N joints the time derivative of `gradient` (...,) [m/(rad s)]
    """

    place: Vector
    velocity: Vector
    gradient: list[Vector]
    rate: list[Vector]


class LinkMotion(NamedTuple):
    """Motion of the N links, x + i z in chassis axes.

    place: for each link the place of its inner pin, from the first pin (...,) [m]
    velocity: for each link the velocity of its inner pin, relative to the first pin (...,) [m/s]
    turn: for each link its direction exp(i a) (...,), a the angle from the chassis
    qd: for each link its absolute rate, with the pitch rate of the house (...,) [rad/s]
    rockers: pin and end of the rockers that were computed so far, by four-bar; `rocker_points` adds to it
    """

    place: list[Vector]
    velocity: list[Vector]
    turn: list[Vector]
    qd: list[Number]
    rockers: dict[FourBar, tuple[MovingPoint, MovingPoint]]


_last: tuple[Machine, Motion, LinkMotion] | None = None  # result for the last motion: several effects need it in turn


def link_motion(machine: Machine, moving: Motion) -> LinkMotion:
    """Return the motion of all links; that of the last call where machine and motion are the same objects."""
    global _last  # noqa: PLW0603 - a cache of one result, not a state
    if _last is not None:
        last_machine, last_motion, links = _last
        if last_motion is moving and last_machine is machine:
            return links
    links = _link_motion(machine, moving)
    _last = (machine, moving, links)
    return links


def _link_motion(machine: Machine, moving: Motion) -> LinkMotion:
    """Return the motion of all links, from the first pin outwards, without the cache."""
    turned = np.exp(1j * moving.a)
    turn: list[Vector] = _joints(turned)
    qd: list[Number] = _joints(moving.qd)
    place, velocity = [0.0 * turn[0]], [0.0 * turn[0]]
    for length, e, rate in zip(machine.lengths[:-1].tolist(), turn, qd, strict=False):
        place.append(place[-1] + length * e)
        velocity.append(velocity[-1] + 1j * length * e * rate)
    return LinkMotion(place=place, velocity=velocity, turn=turn, qd=qd, rockers={})


def _joints(values: NDArray[Any]) -> list[Any]:
    """Return the N columns of values (..., N) as a list: arrays (...), of a single instant Python numbers."""
    return values.tolist() if values.ndim == 1 else list(np.moveaxis(values, -1, 0))


def body_point(at: LinkMotion, pin: Pin) -> MovingPoint:
    """Return the motion of a point that is fixed to a body; a point of the chassis is taken as at rest.

    at: motion of the links
    pin: number of the body (0: the chassis) and place x + i z in its frame [m]
    """
    (body, local), still = pin, 0.0 * at.turn[0]
    place: Vector = local + still
    velocity: Vector = still
    if body:
        arm = local * at.turn[body - 1]
        place, velocity = at.place[body - 1] + arm, at.velocity[body - 1] + 1j * arm * at.qd[body - 1]
    beyond = [still] * (len(at.turn) - body)
    gradient = [1j * (place - p) for p in at.place[:body]]
    return MovingPoint(place, velocity, gradient + beyond, [1j * (velocity - v) for v in at.velocity[:body]] + beyond)


def rocker_points(at: LinkMotion, bars: FourBar) -> tuple[MovingPoint, MovingPoint]:
    """Return the motion of two points: the pin of a four-bar's rocker, and the rocker's end. NaN where the linkage
    cannot be closed.

    The link keeps its length, so that bar . base' = cross spin, with bar the vector from the link's pin to the rocker's
    end, base from the rocker's pin to the link's, arm from the rocker's pin to its end, cross = arm x bar [m^2], and
    spin the derivative of the rocker's angle by a joint's.

    at: motion of the links
    """
    if bars not in at.rockers:
        at.rockers[bars] = _rocker_points(at, bars)
    return at.rockers[bars]


def _rocker_points(at: LinkMotion, bars: FourBar) -> tuple[MovingPoint, MovingPoint]:
    """Return pin and end of a four-bar's rocker, without the cache."""
    pin, link = body_point(at, bars.rocker_pin), body_point(at, bars.link_pin)
    base, gradient, rate = link.place - pin.place, _less(link.gradient, pin.gradient), _less(link.rate, pin.rate)
    arm = _arm(bars, base)
    bar = arm - base  # link pin -> rocker end
    inverse = _inverse(_cross(arm, bar))
    both = min(bars.rocker_pin[0], bars.link_pin[0])  # the joints that turn the whole linkage
    spin = [1.0] * both + [_dot(bar, g) * inverse for g in gradient[both:]]  # bar . base'_j / (arm x bar)
    # d(arm)/dt = i arm sum_j spin_j d(theta_j)/dt, the joint rates being differences of the links' rates
    velocity = 1j * arm * sum(s * w for s, w in zip(spin, [at.qd[0], *_less(at.qd[1:], at.qd)], strict=True))
    bar_velocity = velocity - link.velocity + pin.velocity
    cross_rate = _cross(velocity, bar) + _cross(arm, bar_velocity)  # d(arm x bar)/dt
    swinging = zip(spin[both:], gradient[both:], rate[both:], strict=True)
    # d(spin_j)/dt by the quotient rule
    spin_rate = [0.0] * both + [
        (_dot(bar_velocity, g) + _dot(bar, h) - cross_rate * s) * inverse for s, g, h in swinging
    ]
    end = MovingPoint(
        pin.place + arm,
        pin.velocity + velocity,
        [g + 1j * arm * s for g, s in zip(pin.gradient, spin, strict=True)],
        [h + 1j * (velocity * s + arm * z) for h, s, z in zip(pin.rate, spin, spin_rate, strict=True)],
    )
    return pin, end


def eye_point(at: LinkMotion, linkage: Linkage) -> MovingPoint:
    """Return the motion of the rod end (eye) of a cylinder; NaN where its linkage cannot be closed.

    at: motion of the links
    """
    if not isinstance(linkage, FourBar):
        return body_point(at, linkage.pins[1])
    pin, end = rocker_points(at, linkage)

    def between(start: Vector, far: Vector) -> Vector:
        """Return the vector at the eye's share of the way from `start` to `far`."""
        return start + linkage.eye * (far - start)

    return MovingPoint(
        between(pin.place, end.place),
        between(pin.velocity, end.velocity),
        [between(*pair) for pair in zip(pin.gradient, end.gradient, strict=True)],
        [between(*pair) for pair in zip(pin.rate, end.rate, strict=True)],
    )


def point_on_line(foot: MovingPoint, end: MovingPoint, distance: float) -> MovingPoint:
    """Return the motion of the point on the line from `foot` to `end`, at a fixed distance [m] from the foot."""
    line, line_velocity = end.place - foot.place, end.velocity - foot.velocity
    inverse = _inverse(_size(line))
    along = line * inverse  # unit vector u of the line
    across, turning = 1j * along, _dot(1j * along, line_velocity) * inverse  # i u; d(angle of the line)/dt
    growth = _dot(along, line_velocity) * inverse  # d(length)/dt over the length
    swings = [_dot(across, b - a) * inverse for a, b in zip(foot.gradient, end.gradient, strict=True)]  # by theta_j
    slopes = zip(foot.gradient, end.gradient, foot.rate, end.rate, swings, strict=True)
    swing_rates = [
        (_dot(across, d - c) - turning * _dot(along, b - a)) * inverse - growth * s for a, b, c, d, s in slopes
    ]
    return MovingPoint(
        foot.place + distance * along,
        foot.velocity + distance * turning * across,
        [a + distance * s * across for a, s in zip(foot.gradient, swings, strict=True)],
        [
            h + distance * (z * across - turning * s * along)
            for h, s, z in zip(foot.rate, swings, swing_rates, strict=True)
        ],
    )


def gravity_factor(moving: Motion) -> Vector:
    """Return gravity as a complex factor (...) [m/s^2]: Im(factor * vector) is g times the vector's true rise.

    The vector is x + i z in chassis axes. Where the acceleration of the base is measured, Im(factor * vector) is the
    scalar product of the specific force of the first pin and the vector.
    """
    factor = moving.g * np.exp(1j * (moving.q[..., 0] - moving.a[..., 0]))
    return complex(factor) if moving.q.ndim == 1 else np.asarray(factor)


def unit_mass_torque(
    at: MovingPoint, up: Vector, slew_squared: Number, axis: float
) -> tuple[list[Number], list[Number]]:
    """Return two lists for a point mass of 1 kg, one value (...) per joint j: momentum [N m s], static torque [N m].

    The torque of joint j that holds and moves the mass is d(momentum)/dt + static torque.
    They are p_j = x_j . v and -d(x_j)/dt . v + g z_j - Omega^2 rho x_j, with v the velocity of the mass, x_j the
    derivative of its place by the angle of joint j, rho its distance from the slew axis.

    at: motion of the mass
    up: `gravity_factor` of the motion
    slew_squared: square of the slew rate Omega^2 (...,) [rad^2/s^2]
    axis: signed distance of the first pin from the slew axis [m]
    """
    x, z, centrifugal = at.velocity.real, at.velocity.imag, slew_squared * (axis + at.place.real)
    momentum = [g.real * x + g.imag * z for g in at.gradient]
    static = [
        (up * g).imag - centrifugal * g.real - h.real * x - h.imag * z
        for g, h in zip(at.gradient, at.rate, strict=True)
    ]
    return momentum, static


def _less(minuend: list[Any], subtrahend: list[Any]) -> list[Any]:
    """Return the differences of two lists, as long as the shorter one."""
    return [a - b for a, b in zip(minuend, subtrahend, strict=False)]


def _arm(bars: FourBar, base: Vector) -> Vector:
    """Return the vector (...,) [m] from rocker pin to rocker end (`FourBar.arm`), a Python number for a Python number.

    base: vector from rocker pin to link pin, x + i z (...,) [m]
    """
    if not isinstance(base, complex):
        return bars.arm(base)
    return complex(bars.arm(np.asarray(base)))


def _inverse(value: Number) -> Number:
    """Return 1/value, infinite for zero."""
    inverse = np.divide(1.0, value)
    return float(inverse) if isinstance(value, float) else np.asarray(inverse)


def _size(a: Vector) -> Number:
    """Return the length of a vector."""
    return abs(a) if isinstance(a, complex) else np.abs(a)


def _dot(a: Vector, b: Vector) -> Number:
    """Return the scalar product of two vectors x + i z."""
    return a.real * b.real + a.imag * b.imag


def _cross(a: Vector, b: Vector) -> Number:
    """Return the cross product a_x b_z - a_z b_x of two vectors x + i z."""
    return a.real * b.imag - a.imag * b.real
