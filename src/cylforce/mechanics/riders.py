"""Points that move with the arm, along a motion: places, velocities, and how both follow from the joint angles.

Everything is kept joint by joint, in lists: of arrays along a recording, of Python's own numbers at one instant, which
are handled several times faster than arrays of three."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.mechanics.chain import Pin
from cylforce.mechanics.linkages import FourBar
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


class Pins(NamedTuple):
    """Of every link: `place` [m] and `velocity` [m/s] of its inner pin in chassis axes, its direction `turn`, its rate
    `qd` [rad/s]."""

    place: list[Vector]
    velocity: list[Vector]
    turn: list[Vector]
    qd: list[Number]


def pins(machine: Machine, moving: Motion) -> Pins:
    """The links along a motion."""
    turned = np.exp(1j * moving.a)
    turn: list[Vector] = _joints(turned)
    qd: list[Number] = _joints(moving.qd)
    place, velocity = [0.0 * turn[0]], [0.0 * turn[0]]
    for length, e, rate in zip(machine.lengths[:-1].tolist(), turn, qd, strict=False):
        place.append(place[-1] + length * e)
        velocity.append(velocity[-1] + 1j * length * e * rate)
    return Pins(place, velocity, turn, qd)


def _joints(values: NDArray[Any]) -> list[Any]:
    """The N columns of (..., N)."""
    return values.tolist() if values.ndim == 1 else list(np.moveaxis(values, -1, 0))


def rider(at: Pins, pin: Pin) -> Rider:
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


def rocker(at: Pins, bars: FourBar) -> tuple[Rider, Rider]:
    """The pin of a four-bar's rocker and the rocker's end; not a number where the linkage cannot be closed.

    The link stays as long as it is, so that bar . base' = sine spin: bar the vector from the link's pin to the rocker's
    end, base from the rocker's pin to the link's, sine = arm x bar, and spin the rocker's turning by a joint's angle.
    """
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


def _dot(a: Vector, b: Vector) -> Number:
    return a.real * b.real + a.imag * b.imag


def _cross(a: Vector, b: Vector) -> Number:
    return a.real * b.imag - a.imag * b.real
