"""Gravity and inertia of the links: three base parameters (J, X, Z) each (PHYSICS sections 3 and 5)."""

from dataclasses import dataclass

import numpy as np

from cylforce.machine.chain import Complex
from cylforce.machine.effect import Halves, Parameter
from cylforce.machine.machine import Machine
from cylforce.machine.motion import Motion
from cylforce.words.estimate import Array


@dataclass(frozen=True, slots=True)
class Rigid:
    """p_j = J_j qd_j + sum_{i<j} l_i A_ij qd_i + sum_{k>j} l_j A_jk qd_k and
    static_j = sum_{i<j} l_i qd_i qd_j B_ij - sum_{k>j} l_j qd_j qd_k B_jk + g (X_j cos q_j - Z_j sin q_j),
    with A_ij = Re(c_j e), B_ij = Im(c_j e), c = X + i Z, e = exp(i (q_j - q_i))."""

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """J [kg m^2], X and Z [kg m] of every link, house outwards."""
        units = (("J", "kg m^2"), ("X", "kg m"), ("Z", "kg m"))
        return tuple(Parameter(f"{link.name}.{symbol}", unit) for link in machine.links for symbol, unit in units)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Columns (..., N, 3N)."""
        turn = np.exp(1j * moving.q)
        outer = turn[..., None, :] * np.conj(turn[..., :, None])  # [j, k] = exp(i (q_k - q_j))
        inner = np.triu(machine.lengths[:, None] * outer, 1)  # l_j exp(...) for k > j: the part that row j sees
        qd_j, qd_k = moving.qd[..., :, None], moving.qd[..., None, :]
        momentum, kinetic = inner * qd_k, 1j * inner * (qd_j * qd_k)
        own = np.sum(inner * qd_j, axis=-2)  # sum_{i<k} l_i exp(i (q_k - q_i)) qd_i, in row k itself
        weight = moving.g[..., None] * turn - np.sum(kinetic, axis=-2)
        n = machine.size
        diagonal = np.arange(n)
        momentum[..., diagonal, diagonal] = own
        kinetic[..., diagonal, diagonal] = weight
        inertia = np.zeros((*qd_j.shape[:-2], n, n))
        inertia[..., diagonal, diagonal] = moving.qd
        return Halves(_torque_form(inertia, momentum), _torque_form(np.zeros_like(inertia), kinetic))


def _torque_form(real: Array, pair: Complex) -> Array:
    """Interleave (J, X, Z) columns and sum rows outwards: tau_j = sum_{k>=j} Q_k."""
    columns = np.stack([real, pair.real, -pair.imag], axis=-1)
    rows = columns.reshape(*columns.shape[:-2], 3 * columns.shape[-2])
    return np.asarray(np.cumsum(rows[..., ::-1, :], axis=-2)[..., ::-1, :])
