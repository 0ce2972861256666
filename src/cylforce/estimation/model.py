"""The model of the empty machine: which effects stand side by side, and what the data sheet says of their
parameters."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cylforce.effects.effect import Effect, Parameter
from cylforce.effects.fault import ForceLaw
from cylforce.effects.friction.asymmetric_friction import AsymmetricFriction
from cylforce.effects.friction.coulomb_friction import CoulombFriction
from cylforce.effects.friction.friction import AtRest, Friction
from cylforce.effects.friction.load_dependent_friction import LoadDependentFriction
from cylforce.effects.friction.viscous_friction import ViscousFriction
from cylforce.effects.loads.rigid import Rigid
from cylforce.effects.loads.slew import Slew, slew_parameters
from cylforce.effects.loads.tip_force import TipForce
from cylforce.effects.sensors.delay import Delay
from cylforce.effects.sensors.pressure_zero import PressureZero
from cylforce.estimation.batch import Prior
from cylforce.estimation.channels import Channels
from cylforce.estimation.regressor import FilteredRegressor, Regressor
from cylforce.mechanics.installation import Filters
from cylforce.mechanics.machine import Machine, base_parameter_covariance, base_parameters
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

# Laws of friction, and the delay of the angles, which on an empty machine looks like one.
FRICTION = ("coulomb", "viscous", "delay", "load_dependent", "directional")

# Standard errors of what nobody measured yet: as shares of the largest force, of it per m/s, or of the force itself.
CERTAIN_SHARE = 0.02  # at rest, above which friction is not what it is in motion: biased by noise, by break-away
SPREAD = {"coulomb": 0.05, "viscous": 0.2, "load_dependent": 0.01, "directional": 0.01, "delay": 0.01}
USUAL = {"load_dependent": 0.01}  # means where they are not zero: seals and pins rub the more they carry
ABSOLUTE = ("load_dependent", "delay")  # do not grow with the cylinder


class Tares(NamedTuple):
    """The dynamic tares: `friction` laws of the model, `values` (P,) of its parameters, `covariance` (P, P),
    `row_error` (R,) [N m] of what it leaves unexplained on the empty machine, `identified`: from a recording, else
    from the data sheet. What remains is multiplied by `scale`, which a lift of known weight tells (levers, areas,
    gains)."""

    friction: tuple[str, ...]
    names: tuple[str, ...]
    values: Array
    covariance: Array
    row_error: Array
    identified: bool
    scale: float = 1.0
    scale_error: float = 0.0


@dataclass(frozen=True)
class Model:
    """Columns of the empty machine (P), then the tool's force and moment (3), then the unknown friction at rest (C)
    and the pressures' zero errors (C)."""

    machine: Machine
    filters: Filters
    friction: tuple[str, ...]

    @cached_property
    def empty(self) -> Regressor:
        """Gravity, inertia, centrifugal terms of the slew where it is measured, friction."""
        rounding = self.filters.direction_speed
        laws: dict[str, ForceLaw] = {
            "coulomb": CoulombFriction(rounding),
            "viscous": ViscousFriction(),
            "load_dependent": LoadDependentFriction(rounding),
            "directional": AsymmetricFriction(rounding),
        }
        turning: tuple[Effect, ...] = (Slew(),) if self._slews else ()
        friction = (Delay() if name == "delay" else Friction(name, laws[name]) for name in self.friction)
        return Regressor(self.machine, (Rigid(), *turning, *friction))

    @cached_property
    def _slews(self) -> bool:
        return any(s.kind in (Kind.SLEW_RATE, Kind.SLEW_ANGLE) for s in self.machine.signals)

    @cached_property
    def filtered(self) -> FilteredRegressor:
        """All columns, filtered."""
        effects = (*self.empty.effects, TipForce(), AtRest(self.filters.direction_speed), PressureZero())
        f = self.filters
        return FilteredRegressor(Regressor(self.machine, effects), 1.0 / f.rate_hz, f.regressor_hz, f.smoothing_hz)

    @cached_property
    def channels(self) -> Channels:
        """From signals to motion."""
        return Channels(self.machine, self.filters)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The P parameters of the empty machine."""
        return self.empty.parameters

    @property
    def tool(self) -> slice:
        """The columns of the tool's force and moment."""
        return slice(len(self.parameters), len(self.parameters) + 3)

    @property
    def at_rest(self) -> slice:
        """The columns of the unknown friction."""
        first = len(self.parameters) + 3
        return slice(first, first + len(self.machine.cylinders))

    def share_at_rest(self, columns: Array) -> Array:
        """The share (..., R) of the levers of rows (..., R, P) at which the direction of friction is unknown."""
        unknown = columns[..., self.at_rest].sum(axis=-1)
        lever = np.abs(columns[..., self.coulomb]).sum(axis=-1)
        return np.asarray(unknown / np.maximum(lever + unknown, 1e-12))

    @property
    def zero(self) -> slice:
        """The columns of the pressures' zero errors."""
        return slice(len(self.parameters) + 3 + len(self.machine.cylinders), None)

    @cached_property
    def scale_error(self) -> float:
        """Relative standard error of what the data sheet turns pressure into at the innermost measured joint: areas,
        and the lever with both its pins, in mid-range. The empty machine cannot tell it; a known weight can."""
        middle = np.array([(link.angle_low + link.angle_high) / 2.0 for link in self.machine.links])
        lever = np.abs(self.machine.geometry(middle).lever[:, self.machine.rows[0]])
        cylinders = [self.machine.cylinders[c] for c in self.acting[0]]
        areas = max(c.area_error for c in cylinders)
        pins = max(c.pin_error * np.sqrt(2.0) / lever[k] for c, k in zip(cylinders, self.acting[0], strict=True))
        return float(np.hypot(areas, pins))

    @cached_property
    def coulomb(self) -> list[int]:
        """The columns of the Coulomb friction."""
        return [k for k, p in enumerate(self.parameters) if p.name.endswith(".coulomb")]

    @cached_property
    def load(self) -> Array:
        """(P, 4): what a load's (m, m x, m z, J about the last pin) adds to the parameters
        (mechanics/README.md, section 9)."""
        place = {p.name: k for k, p in enumerate(self.parameters)}
        table = np.zeros((len(place), 4))
        for link in self.machine.links[:-1]:
            table[place[f"{link.name}.J"], 0] = link.length**2
            table[place[f"{link.name}.X"], 0] = link.length
        last = self.machine.links[-1].name
        for column, symbol in enumerate(("X", "Z", "J"), 1):
            table[place[f"{last}.{symbol}"], column] = 1.0
        return table

    @cached_property
    def acting(self) -> tuple[tuple[int, ...], ...]:
        """For each measured row the cylinders that act on its joint."""
        spans = self.machine.spans
        return tuple(tuple(c for c, span in enumerate(spans) if j in span) for j in self.machine.rows)

    @cached_property
    def settle_steps(self) -> int:
        """Steps until a filter has forgotten its start: 5/w of the slowest, the smoothing filter's two poles
        included."""
        slowest = min(self.filters.regressor_hz, self.filters.smoothing_hz, self.filters.channel_hz)
        return int(np.ceil(7.0 / (2 * np.pi * slowest) * self.filters.rate_hz))

    @cached_property
    def prior(self) -> Prior:
        """The data sheet with its tolerances; of friction only its order of magnitude."""
        n = 3 * self.machine.size
        size = len(self.parameters)
        mean, covariance = np.zeros(size), np.zeros((size, size))
        place = {p.name: k for k, p in enumerate(self.parameters)}
        for name, value, spread in self._guesses():
            mean[place[name]], covariance[place[name], place[name]] = value, spread**2
        mean[:n] = base_parameters(self.machine.links)
        covariance[:n, :n] = base_parameter_covariance(self.machine.links) + np.diag(1e-6 * mean[:n] ** 2 + 1e-2)
        return Prior(mean, covariance)

    def _guesses(self) -> list[tuple[str, float, float]]:
        """(name, mean, standard error) of every parameter that is not a base parameter."""
        guesses = []
        if self._slews:
            for link, (excess, product) in zip(self.machine.links, slew_parameters(self.machine.links), strict=True):
                guesses.append((f"{link.name}.D_excess", excess, 0.2 * abs(excess) + 1.0))
                guesses.append((f"{link.name}.E", product, 0.2 * abs(product) + 1.0))
        for law in self.friction:
            for c in self.machine.cylinders:
                largest = 300e5 * c.area_head  # the force at a usual relief pressure
                spread = SPREAD[law] * (1.0 if law in ABSOLUTE else largest)
                guesses.append((f"{c.name}.{law}", USUAL.get(law, 0.0), spread))
        return guesses

    @cached_property
    def data_sheet(self) -> Tares:
        """Tares of a machine that nobody identified: what the data sheet says, with a modest idea of the friction."""
        scale = np.array([0.02 * 9.8 * abs(np.sum(np.abs(self.prior.mean[1::3][: self.machine.size])))])
        rows = np.broadcast_to(scale, (len(self.machine.rows),))
        names = tuple(p.name for p in self.parameters)
        return Tares(self.friction, names, self.prior.mean, self.prior.covariance, rows, False)
