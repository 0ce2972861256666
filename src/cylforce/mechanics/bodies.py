"""Links as rigid bodies with their data sheets' masses along a motion: weight, inertia, and torques of a small
rotation.

The rotation turns the links from one joint outwards in addition to the motion.
"""

from typing import NamedTuple, TypeVar

import numpy as np

from cylforce.mechanics.chain import Complex
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array

Course = TypeVar("Course", Array, Complex)


class Bodies(NamedTuple):
    """N links at T instants. Positions are x + i z [m] from the first pin, z truly upwards.

    machine:  the machine, with its data sheet
    pins:     (T, N) inner pin of every link [m]
    centres:  (T, N) centre of gravity of every link [m]
    velocity: (T, N) velocity of the centres relative to the first pin [m/s]
    rates:    (T, N) absolute rate of every link [rad/s]
    specific: (T,) specific force of the first pin, forwards + i upwards [m/s^2]; at rest i g
    """

    machine: Machine
    pins: Complex
    centres: Complex
    velocity: Complex
    rates: Array
    specific: Complex

    @property
    def masses(self) -> Array:
        """Masses (N,) [kg] of the data sheet."""
        return np.array([link.mass for link in self.machine.links])

    @property
    def inertias(self) -> Array:
        """Moments of inertia (N,) [kg m^2] about the centres of gravity."""
        return np.array([link.inertia for link in self.machine.links])

    def weight(self, joint: int) -> Complex:
        """Return the force (T,) [N], forwards + i upwards, that carries all links from `joint` outwards.

        It is their mass times the specific force of the first pin, without their accelerations relative to that pin.
        """
        return np.asarray(self.specific * float(np.sum(self.masses[joint:])))

    def torque(self, t: Array, joint: int) -> Array:
        """Return the torque (T,) [N m] that holds and moves the links from `joint` outwards, at times t (T,) [s].

        It is the sum over these links k of Im(conj(c_k - o_j) m_k (dv_k/dt + s)) + I_k dw_k/dt, with c_k the centre,
        v_k its velocity, w_k the rate of link k, o_j the pin of `joint` and s the specific force of the first pin.
        """
        pushed = (rate(self.velocity, t) + self.specific[:, None]) * self.masses
        about = (np.conj(self.centres - self.pins[:, [joint]]) * pushed).imag
        turned = rate(self.rates, t) * self.inertias
        return np.asarray(np.sum((about + turned)[:, joint:], axis=1))

    def inertia(self, joint: int, pivot: Complex) -> Array:
        """Return the torques (T, N) [N m] of all joints per rad/s^2 of additional rotation of the links from `joint`
        outwards.

        The rotation is about a `pivot` P (T,) [m]. The torque of joint j is the sum of
        m_k Re(conj(c_k - o_j) (c_k - P)) + I_k over the links k that turn and lie from j outwards.
        """
        lever = np.conj(self.centres[:, None, :] - self.pins[:, :, None])  # (T, joint, link)
        each = self.masses * (lever * (self.centres - pivot[:, None])[:, None, :]).real + self.inertias
        return np.asarray(np.sum(each * self._turning(joint), axis=-1))

    def lowering(self, joint: int, pivot: Complex) -> Array:
        """Return the torques (T, N) [N m] of all joints per radian of additional rotation of the links from `joint`
        outwards.

        The rotation is about a `pivot` P (T,) [m]: the torque that carries the weight changes by
        -sum_k m_k g Im(c_k - o_j) over the links k that turn and lie from j outwards. Pins o_j farther in do not turn;
        for these it is -sum_k m_k g Im(c_k - P).
        """
        inner = np.arange(self.machine.size) < joint
        about = np.where(inner, pivot[:, None], self.pins)
        each = -self.masses * (self.centres[:, None, :] - about[:, :, None]).imag
        return np.asarray(self.specific.imag[:, None] * np.sum(each * self._turning(joint), axis=-1))

    def _turning(self, joint: int) -> Array:
        """Return a matrix (N, N): 1 at [j, k] where link k loads joint j and turns with `joint`."""
        return self.machine.sum_outward * (np.arange(self.machine.size) >= joint)


def bodies(machine: Machine, moving: Motion) -> Bodies:
    """Return the links along a motion of T instants."""
    turn = np.exp(1j * moving.q)
    arms = machine.lengths * turn
    own = turn * np.array([complex(link.cx, link.cz) for link in machine.links])
    pins = arms @ machine.outward
    velocity = (1j * moving.qd * arms) @ machine.outward + 1j * moving.qd * own
    return Bodies(machine, pins, pins + own, velocity, moving.qd, 1j * np.conj(moving.g))


def rate(course: Course, t: Array) -> Course:
    """Return the time derivative of `course` (T, ...) at times t (T,) [s], in its unit per second.

    Central differences, one-sided ones at both ends; zero for a single sample.
    """
    if len(t) < 2:
        return np.zeros_like(course)
    slope: Course = np.gradient(course, t, axis=0)
    return slope


def resonance(course: Array, t: Array, frequency: float, damping: float) -> tuple[Array, Array]:
    """Return the response (T,) of a damped spring to `course` (T,) at evenly spaced times t (T,) [s], and the second
    time derivative (T,) of the response.

    The response is in the unit of `course`, its derivative in that unit per s^2.
    The response is w^2 / (s^2 + 2 D w s + w^2), with the natural frequency w = 2 pi `frequency` [Hz] and the `damping`
    ratio D; it is settled at the first sample. It is exact for an input that is linear between samples, and corrected
    for the curvature of a smooth one. Gaps (NaN) are bridged by straight lines, so that they do not make it ring; both
    results are zero where `course` is NaN throughout.
    """
    from scipy.signal import cont2discrete, lfilter, lfilter_zi  # not needed by the service, which measures without it

    if len(t) < 2:
        return course.copy(), np.zeros_like(course)
    known = np.isfinite(course)
    course = np.interp(t, t[known], course[known]) if np.any(known) else np.zeros_like(course)
    w, step = 2.0 * np.pi * frequency, float(np.mean(np.diff(t)))
    poles = np.array([1.0, 2.0 * damping * w, w * w])

    def run(zeros: tuple[float, ...]) -> Array:
        """Return the output (T,) of the filter whose numerator has these coefficients of s, highest power first.

        It is settled at the first sample.
        """
        numerator, denominator, _ = cont2discrete((np.array(zeros), poles), step, method="foh")
        b = numerator.ravel()
        return np.asarray(lfilter(b, denominator, course, zi=lfilter_zi(b, denominator) * course[0])[0])

    bent, quickened = run((w * w,)), run((w * w, 0.0, 0.0))
    # straight lines between samples lie inside of a curve by step^2/12 of its second derivative, on average
    quickened[1:-1] += w * w / 12.0 * np.diff(course, 2)
    return bent, quickened
