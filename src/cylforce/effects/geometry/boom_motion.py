"""The body that carries the first link moves, for example a crane's boom, but the model assumes a chassis at rest."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.effect import Halves
from cylforce.effects.fault import About, Place
from cylforce.mechanics.chain import Complex
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class BoomMotion:
    """Motion of the carrying body: its measured pitch phi changes with rate w.

    The first two sizes are the position R = (Rx, Rz) [m] of the first pin relative to the body's pivot, in the body's
    frame. The pin then has the velocity V = i w R exp(i phi). The third is the share (1: in full) of w with which all
    links turn in addition.
    """

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="boom_motion",
            unit="m",
            low=0.5,
            high=8.0,
            place=Place.MACHINE,
            shows="while the measured pitch changes, with the acceleration of the first pin",
            confirm="the same moves with the boom, or whatever carries the first link, held still",
            axes=2,
            form=0.05,
        )

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the sizes of which the effect consists."""
        return ("m", "m", "1")

    @property
    def typical(self) -> tuple[float, ...]:
        """Typical sizes, the scale of the diagnosis' prior: several metres; the rate in full."""
        return (4.0, 4.0, 1.0)

    def halves(self, machine: Machine, moving: Motion, turning: Array, base: Array) -> Halves:
        """Return the columns (..., N, 3) per metre of Rx, per metre of Rz and for the whole share, in joint torques.

        Their two halves are momentum [N m s] and static torque [N m].

        The columns of Rx and Rz are the difference that the velocity of the first pin makes, per metre of R. The column
        of the share is the difference between link rates with and without `turning`. Both halves are such differences.

        moving:  motion of the links (...), with rates relative to a body at rest
        turning: (...,) pitch rate w of the carrying body [rad/s]
        base:    (..., N, 3) base parameters (J, X, Z) of the links [kg m^2, kg m, kg m]
        """
        pitch, w = np.exp(1j * (moving.q[..., 0] - moving.a[..., 0])), turning[..., None]  # pitch: exp(i phi)
        bodies = _Bodies(machine, np.exp(1j * moving.q), base)
        pin_at_rest = np.zeros(1, dtype=np.complex128)
        without_turning, with_turning = bodies.halves(moving.qd, pin_at_rest), bodies.halves(moving.qd + w, pin_at_rest)
        # V = i w R exp(i phi) for R = 1 m (Rx) and i m (Rz)
        with_pin = [bodies.halves(moving.qd + w, 1j * w * (unit * pitch)[..., None]) for unit in (1.0, 1j)]
        pairs = [(with_pin[0], with_turning), (with_pin[1], with_turning), (with_turning, without_turning)]
        momentum, static = (
            machine.sum_outward @ np.stack([more[k] - less[k] for more, less in pairs], axis=-1) for k in (0, 1)
        )
        return Halves(momentum, static)


@dataclass(frozen=True, slots=True)
class _Bodies:
    """Links on a first pin with velocity V.

    machine: the machine
    turn:    (..., N) exp(i q) of the links
    base:    (..., N, 3) base parameters (J, X, Z) [kg m^2, kg m, kg m]

    With r_j = (X_j + i Z_j) exp(i q_j), the velocity of pin j, P_j = V + sum_{i<j} i qd_i l_i exp(i q_i), the momentum
    of the links beyond, B_j = sum_{k>j} i qd_k r_k, and U_j = conj(r_j) P_j + l_j exp(-i q_j) B_j:
    p_j = J_j qd_j + Im(U_j), -dT/dq_j = qd_j Re(U_j).
    """

    machine: Machine
    turn: Complex
    base: Array

    def halves(self, qd: Array, velocity: Complex) -> tuple[Array, Array]:
        """Return momentum p [N m s] and -dT/dq [N m] of every absolute angle, each (..., N).

        qd:       (..., N) rates [rad/s]
        velocity: (..., 1) velocity of the first pin, x + i z in true horizontal and vertical [m/s]
        """
        r, arms = (self.base[..., 1] + 1j * self.base[..., 2]) * self.turn, self.machine.lengths * self.turn
        pins = velocity + (1j * qd * arms) @ self.machine.outward
        beyond = (1j * qd * r) @ self.machine.outward.T
        pull = np.conj(r) * pins + np.conj(arms) * beyond
        return self.base[..., 0] * qd + pull.imag, qd * pull.real
