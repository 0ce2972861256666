"""Points that move with the arm, along a motion: places, velocities, and how both follow from the joint angles.

Everything is kept joint by joint, in lists: of arrays along a recording, of Python's own numbers at one instant, which
are handled several times faster than arrays of three."""

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


class Rider(NamedTuple):
    """A point in chassis axes: its `place` [m] and `velocity` [m/s] (...,); for each joint the derivative of the place
    by the joint's angle, `gradient` [m/rad] (...,), and the time derivative of that, `rate` [m/(rad s)]."""

    place: Vector
    velocity: Vector
    gradient: list[Vector]
    rate: list[Vector]


class Hinges(NamedTuple):
    """Of every link: `place` [m] and `velocity` [m/s] of its inner pin in chassis axes, its direction `turn`, its rate
    `qd` [rad/s]; the four-bars' rockers that were asked for so far, by their pins and lengths."""

    place: list[Vector]
    velocity: list[Vector]
    turn: list[Vector]
    qd: list[Number]
    rockers: dict[FourBar, tuple[Rider, Rider]]


_last: tuple[Machine, Motion, Hinges] | None = None  # several effects ask for the links of one motion, in turn


def pins(machine: Machine, moving: Motion) -> Hinges:
    """The links along a motion."""
    global _last  # noqa: PLW0603 - what was computed last, not a state
    last = _last
    if last is not None and last[1] is moving and last[0] is machine:
        return last[2]
    found = _pins(machine, moving)
    _last = (machine, moving, found)
    return found


def _pins(machine: Machine, moving: Motion) -> Hinges:
    turned = np.exp(1j * moving.a)
    turn: list[Vector] = _joints(turned)
    qd: list[Number] = _joints(moving.qd)
    place, velocity = [0.0 * turn[0]], [0.0 * turn[0]]
    for length, e, rate in zip(machine.lengths[:-1].tolist(), turn, qd, strict=False):
        place.append(place[-1] + length * e)
        velocity.append(velocity[-1] + 1j * length * e * rate)
    return Hinges(place, velocity, turn, qd, {})


def _joints(values: NDArray[Any]) -> list[Any]:
    """The N columns of (..., N)."""
    return values.tolist() if values.ndim == 1 else list(np.moveaxis(values, -1, 0))


def rider(at: Hinges, pin: Pin) -> Rider:
    """A point that is fixed to a body (0: the chassis)."""
    (body, local), still = pin, 0.0 * at.turn[0]
    place: Vector = local + still
    velocity: Vector = still
    if body:
        own = local * at.turn[body - 1]
        place, velocity = at.place[body - 1] + own, at.velocity[body - 1] + 1j * own * at.qd[body - 1]
    beyond = [still] * (len(at.turn) - body)
    gradient = [1j * (place - p) for p in at.place[:body]]
    return Rider(place, velocity, gradient + beyond, [1j * (velocity - v) for v in at.velocity[:body]] + beyond)


def rocker(at: Hinges, bars: FourBar) -> tuple[Rider, Rider]:
    """The pin of a four-bar's rocker and the rocker's end; not a number where the linkage cannot be closed.

    The link stays as long as it is, so that bar . base' = sine spin: bar the vector from the link's pin to the rocker's
    end, base from the rocker's pin to the link's, sine = arm x bar, and spin the rocker's turning by a joint's angle.
    """
    if bars not in at.rockers:
        at.rockers[bars] = _rocker(at, bars)
    return at.rockers[bars]


def _rocker(at: Hinges, bars: FourBar) -> tuple[Rider, Rider]:
    pin, link = rider(at, bars.rocker_pin), rider(at, bars.link_pin)
    base, gradient, rate = link.place - pin.place, _less(link.gradient, pin.gradient), _less(link.rate, pin.rate)
    arm = _arm(bars, base)
    bar = arm - base
    inverse = _inverse(_cross(arm, bar))
    both = min(bars.rocker_pin[0], bars.link_pin[0])  # the joints that turn the whole linkage
    spin = [1.0] * both + [_dot(bar, g) * inverse for g in gradient[both:]]
    velocity = 1j * arm * sum(s * w for s, w in zip(spin, [at.qd[0], *_less(at.qd[1:], at.qd)], strict=True))
    speed = velocity - link.velocity + pin.velocity
    grows = _cross(velocity, bar) + _cross(arm, speed)
    swinging = zip(spin[both:], gradient[both:], rate[both:], strict=True)
    gains = [0.0] * both + [(_dot(speed, g) + _dot(bar, h) - grows * s) * inverse for s, g, h in swinging]
    end = Rider(
        pin.place + arm,
        pin.velocity + velocity,
        [g + 1j * arm * s for g, s in zip(pin.gradient, spin, strict=True)],
        [h + 1j * (velocity * s + arm * z) for h, s, z in zip(pin.rate, spin, gains, strict=True)],
    )
    return pin, end


def eye(at: Hinges, linkage: Linkage) -> Rider:
    """The cylinder's rod end; not a number where the linkage cannot be closed."""
    if not isinstance(linkage, FourBar):
        return rider(at, linkage.pins[1])
    pin, end = rocker(at, linkage)

    def between(start: Vector, far: Vector) -> Vector:
        return start + linkage.eye * (far - start)

    return Rider(
        between(pin.place, end.place),
        between(pin.velocity, end.velocity),
        [between(*pair) for pair in zip(pin.gradient, end.gradient, strict=True)],
        [between(*pair) for pair in zip(pin.rate, end.rate, strict=True)],
    )


def on_line(foot: Rider, end: Rider, distance: float) -> Rider:
    """The point on the line from `foot` to `end`, at a fixed `distance` [m] from the foot."""
    line, speed = end.place - foot.place, end.velocity - foot.velocity
    inverse = _inverse(_size(line))
    along = line * inverse
    across, turning = 1j * along, _dot(1j * along, speed) * inverse
    grows = _dot(along, speed) * inverse
    swings = [_dot(across, b - a) * inverse for a, b in zip(foot.gradient, end.gradient, strict=True)]
    slopes = zip(foot.gradient, end.gradient, foot.rate, end.rate, swings, strict=True)
    gains = [(_dot(across, d - c) - turning * _dot(along, b - a)) * inverse - grows * s for a, b, c, d, s in slopes]
    return Rider(
        foot.place + distance * along,
        foot.velocity + distance * turning * across,
        [a + distance * s * across for a, s in zip(foot.gradient, swings, strict=True)],
        [h + distance * (z * across - turning * s * along) for h, s, z in zip(foot.rate, swings, gains, strict=True)],
    )


def upward(moving: Motion) -> Vector:
    """Gravity as a factor: what it does along a vector is the imaginary part of the product."""
    found = moving.g * np.exp(1j * (moving.q[..., 0] - moving.a[..., 0]))
    return complex(found) if moving.q.ndim == 1 else np.asarray(found)


def of_mass(at: Rider, up: Vector, turning: Number, axis: float) -> tuple[list[Number], list[Number]]:
    """Momentum and static torque by joints of a unit mass: p_j = x_j . v and -d(x_j)/dt . v + g z_j - Omega^2 rho x_j,
    with x_j the derivatives of its place by the joints' angles, rho its distance from the slew axis."""
    x, z, thrown = at.velocity.real, at.velocity.imag, turning * (axis + at.place.real)
    momentum = [g.real * x + g.imag * z for g in at.gradient]
    static = [
        (up * g).imag - thrown * g.real - h.real * x - h.imag * z for g, h in zip(at.gradient, at.rate, strict=True)
    ]
    return momentum, static


def _less(these: list[Any], those: list[Any]) -> list[Any]:
    return [a - b for a, b in zip(these, those, strict=False)]


def _arm(bars: FourBar, base: Vector) -> Vector:
    if not isinstance(base, complex):
        return bars.arm(base)
    return complex(bars.arm(np.asarray(base)))


def _inverse(value: Number) -> Number:
    """1/value, infinite for zero."""
    found = np.divide(1.0, value)
    return float(found) if isinstance(value, float) else np.asarray(found)


def _size(a: Vector) -> Number:
    return abs(a) if isinstance(a, complex) else np.abs(a)


def _dot(a: Vector, b: Vector) -> Number:
    return a.real * b.real + a.imag * b.imag


def _cross(a: Vector, b: Vector) -> Number:
    return a.real * b.imag - a.imag * b.real
