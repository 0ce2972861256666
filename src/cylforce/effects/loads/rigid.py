"""Gravity and inertia of the links: three base parameters (J, X, Z) each (mechanics/README.md, sections 3 and 5)."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cylforce.effects.effect import Halves, Parameter
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion


@dataclass(frozen=True, slots=True)
class Rigid:
    """Torque of rigid links: momentum and the other terms of the generalised forces Q_j of the absolute angles.

    p_j = J_j qd_j + sum_{i<j} l_i A_ij qd_i + sum_{k>j} l_j A_jk qd_k
    static_j = sum_{i<j} l_i qd_i qd_j B_ij - sum_{k>j} l_j qd_j qd_k B_jk + g (X_j cos q_j - Z_j sin q_j)
    with A_ij = Re(c_j e), B_ij = Im(c_j e), c = X + i Z, e = exp(i (q_j - q_i)).
    """

    depends_on: ClassVar[tuple[str, ...]] = ("q", "qd", "g")

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """Return the 3N parameters: J [kg m^2], X and Z [kg m] of every link, house outwards."""
        units = (("J", "kg m^2"), ("X", "kg m"), ("Z", "kg m"))
        return tuple(Parameter(f"{link.name}.{symbol}", unit) for link in machine.links for symbol, unit in units)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Return the momentum [N m s] and static columns [N m], each (..., N, 3N), in joint torques.

        They are per unit of J, X and Z, link by link. Joint torques are sums of the class's terms, tau_j = sum_{k>=j}
        Q_k.
        """
        n, turn, qd = machine.size, np.exp(1j * moving.q), moving.qd
        outer = turn[..., None, :] * np.conj(turn)[..., :, None]  # [j, k] = exp(i (q_k - q_j))
        beyond = machine.reach * outer  # l_j exp(...) for k > j: what row j sees
        momentum = beyond * qd[..., None, :]
        own = (qd[..., None, :] @ beyond)[..., 0, :]  # sum_{i<k} l_i exp(i (q_k - q_i)) qd_i, in row k itself
        weight = moving.g[..., None] * turn - 1j * qd * own
        columns = np.zeros((*qd.shape[:-1], 2, n, n, 3))
        columns[..., 0, :, :, 0] = machine.identity * qd[..., None, :]
        # c = X + i Z: Re(c u) has the columns Re(u) and -Im(u)
        pairs = columns[..., 1:].view(np.complex128)[..., 0]
        pairs[..., 0, :, :] = np.conj(momentum + machine.identity * own[..., None, :])
        pairs[..., 1, :, :] = np.conj(1j * qd[..., :, None] * momentum + machine.identity * weight[..., None, :])
        rows = machine.sum_outward @ columns.reshape(*qd.shape[:-1], 2, n, 3 * n)
        return Halves(rows[..., 0, :, :], rows[..., 1, :, :])
