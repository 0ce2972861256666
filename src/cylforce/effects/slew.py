"""Centrifugal torques of a turning house (PHYSICS section 4)."""

from dataclasses import dataclass

import numpy as np

from cylforce.machine.effect import Halves, Parameter
from cylforce.machine.machine import Link, Machine
from cylforce.machine.motion import Motion
from cylforce.words.estimate import Array


@dataclass(frozen=True, slots=True)
class Slew:
    """Omega^2 [rho_j (X_j sin a_j + Z_j cos a_j) + D_j/2 sin 2a_j + E_j cos 2a_j
    + l_j sin a_j sum_{k>j} (X_k cos a_k - Z_k sin a_k)], rho_j = rho_0 + sum_{i<j} l_i cos a_i.

    J, X and Z are the rigid ones (a regressor adds columns of one name), D = J + D_excess; slender links: excess and
    E 0."""

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """J, D_excess, E [kg m^2]; X, Z [kg m]."""
        units = (("J", "kg m^2"), ("X", "kg m"), ("Z", "kg m"), ("D_excess", "kg m^2"), ("E", "kg m^2"))
        return tuple(Parameter(f"{link.name}.{symbol}", unit) for link in machine.links for symbol, unit in units)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Columns (..., N, 5N)."""
        n, lengths, turn = machine.size, machine.lengths, np.exp(1j * moving.a)
        rho = machine.slew_axis + (lengths * turn.real) @ machine.outward
        # c = X + i Z, X sin + Z cos = Im(c e), X cos - Z sin = Re(c e): Re(c u) has the columns Re(u) and -Im(u)
        pair = machine.reach * turn.imag[..., :, None] * turn[..., None, :]
        diagonal = np.arange(n)
        pair[..., diagonal, diagonal] = -1j * rho * turn
        double = turn * turn
        columns = np.zeros((*pair.shape, 5))
        columns[..., 1], columns[..., 2] = pair.real, -pair.imag
        columns[..., diagonal, diagonal, 0] = columns[..., diagonal, diagonal, 3] = double.imag / 2.0
        columns[..., diagonal, diagonal, 4] = double.real
        rows = machine.sum_outward @ columns.reshape(*pair.shape[:-1], 5 * n)
        return Halves(None, (moving.slew**2)[..., None, None] * rows)


def slew_parameters(links: tuple[Link, ...]) -> Array:
    """(D_j - J_j, E_j) (N, 2) from rough masses: D = J - 2 Z^2/m, E = (X - mu l) Z / m, with Z = m cz, X - mu l = m
    cx."""
    return np.array([(-2.0 * k.mass * k.cz**2, k.mass * k.cx * k.cz) for k in links])
