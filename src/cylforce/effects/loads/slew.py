"""Centrifugal torques of a slewing house (mechanics/README.md, section 4). As a fault: the house slews, but no sensor
measures it."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cylforce.effects.effect import Halves, Parameter
from cylforce.effects.fault import SHAPES, About, Place, TimeCourse
from cylforce.mechanics.machine import Link, Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class Slew:
    """Centrifugal torque of every absolute angle at slew rate Omega:
    Omega^2 [rho_j (X_j sin a_j + Z_j cos a_j) + D_j/2 sin 2a_j + E_j cos 2a_j
    + l_j sin a_j sum_{k>j} (X_k cos a_k - Z_k sin a_k)], rho_j = rho_0 + sum_{i<j} l_i cos a_i.

    J, X and Z are the parameters of `Rigid` (the regressor adds columns of the same name); D = J + D_excess. For
    slender links D_excess and E are zero."""

    depends_on: ClassVar[tuple[str, ...]] = ("a", "slew")

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """Return the 5N parameters: J [kg m^2], X, Z [kg m], D_excess and E [kg m^2] of every link, house outwards."""
        units = (("J", "kg m^2"), ("X", "kg m"), ("Z", "kg m"), ("D_excess", "kg m^2"), ("E", "kg m^2"))
        return tuple(Parameter(f"{link.name}.{symbol}", unit) for link in machine.links for symbol, unit in units)

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Return the static columns (..., N, 5N) in joint torques, those of J, X, Z, D_excess and E link by link.

        They are [N m] per unit of each parameter, Omega^2 included.
        """
        n, lengths, turn = machine.size, machine.lengths, np.exp(1j * moving.a)
        rho = machine.slew_axis + (lengths * turn.real) @ machine.outward
        # c = X + i Z, X sin + Z cos = Im(c e), X cos - Z sin = Re(c e): Re(c u) has the columns Re(u) and -Im(u)
        pair = np.empty((*turn.shape, n), dtype=np.complex128)
        np.multiply(machine.reach * turn.imag[..., :, None], turn[..., None, :], out=pair)
        pair.reshape(*turn.shape[:-1], n * n)[..., :: n + 1] = -1j * rho * turn
        double = turn * turn
        columns = np.zeros((*pair.shape, 5))
        columns[..., 1], columns[..., 2] = pair.real, -pair.imag
        own = columns.reshape(*turn.shape[:-1], n * n, 5)[..., :: n + 1, :]  # the diagonal
        own[..., 0] = own[..., 3] = double.imag / 2.0
        own[..., 4] = double.real
        rows = machine.sum_outward @ columns.reshape(*pair.shape[:-1], 5 * n)
        return Halves(None, (moving.slew**2)[..., None, None] * rows)

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="slew_centrifugal",
            unit="rad^2/s^2",
            low=0.005,
            high=2.0,
            place=Place.MACHINE,
            shows="while the house turns, as the centrifugal force of all links",
            confirm="the same arm motion with the house still",
            sign=1,
            axes=SHAPES,
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns whose sizes change during the incident (see `fault.INCIDENTAL`)."""
        return tuple(f"slew.{k}" for k in range(SHAPES))

    @property
    def course(self) -> TimeCourse:
        """Course of the sizes over time."""
        return TimeCourse.WINDOWS


def slew_parameters(links: tuple[Link, ...]) -> Array:
    """Return (D_excess, E) (N, 2) [kg m^2] of each link by the data sheet's masses.

    D - J = -2 Z^2/m = -2 m cz^2, E = (X - mu l) Z / m = m cx cz (mechanics/README.md, section 4).
    """
    return np.array([(-2.0 * k.mass * k.cz**2, k.mass * k.cx * k.cz) for k in links])
