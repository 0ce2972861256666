"""The model of the empty machine: its effects, the prior of their parameters from the data sheet, and the tares."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.effects.effect import Effect, Parameter
from cylforce.effects.fault import ForceLaw
from cylforce.effects.friction.asymmetric_friction import AsymmetricFriction
from cylforce.effects.friction.coulomb_friction import CoulombFriction
from cylforce.effects.friction.friction import AtRest, Friction
from cylforce.effects.friction.load_dependent_friction import LoadDependentFriction
from cylforce.effects.friction.stribeck import Stribeck
from cylforce.effects.friction.viscous_friction import ViscousFriction
from cylforce.effects.loads.rigid import Rigid
from cylforce.effects.loads.slew import Slew
from cylforce.effects.loads.tip_force import TipForce
from cylforce.effects.sensors.delay import Delay
from cylforce.effects.sensors.pressure_zero import PressureZero
from cylforce.estimation.channels import Channels
from cylforce.estimation.fast import FastFilters
from cylforce.estimation.priors.bars import of_bars, with_bars
from cylforce.estimation.priors.depth import slewing
from cylforce.estimation.priors.prior import Prior
from cylforce.estimation.regressor import FilteredRegressor, Regressor
from cylforce.mechanics.installation import Filters
from cylforce.mechanics.machine import Machine, base_parameter_covariance, base_parameters
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

# Friction laws that a model may contain; with them the delay of the angles behind the forces, which looks like friction
# while empty, and the weight of linkages' bars and of cylinders, which the links represent in the mean only.
BARS = "rocker"
FRICTION = ("coulomb", "viscous", "delay", "load_dependent", "directional", "stribeck", BARS)

# Share of the lever with friction of unknown direction, above which a row is not fitted: the speed there is so low that
# noise and break-away friction would bias the fit; chosen.
CERTAIN_SHARE = 0.02
# Prior standard errors: of coulomb, directional and stribeck as a share of the cylinder's largest force; of viscous as
# such a share per m/s; of load_dependent as a share of the force; of the delay in seconds. Chosen: wide for any
# cylinder.
SPREAD = {
    "coulomb": 0.05,
    "viscous": 0.2,
    "load_dependent": 0.01,
    "directional": 0.01,
    "delay": 0.01,
    "stribeck": 0.05,
}
# m/s: speed at which the extra friction of creep has fallen to 37 %. Fitted: of 10, 15, 20, 30 and 50 mm/s the one that
# predicts held-out empty motion best, on each of ten machines of a foreign generator.
CREEP = 0.01
# Relative standard error of a pressure sensor's gain: accuracy class 0.5, so evenly within 0.5 % either way.
GAIN_ERROR = 0.005 / 3.0**0.5
TYPICAL = {"load_dependent": 0.01}  # prior means that are not zero; chosen: one percent of the force for seals and pins
ABSOLUTE = ("load_dependent", "delay")  # laws whose prior does not scale with the cylinder's largest force


class BetweenStrokes(NamedTuple):
    """Standard errors of the differences between strokes.

    friction: of a friction, as a share of the identified one
    zero:     of a pressure's zero [Pa]
    """

    friction: float
    zero: float


EXPECTED = BetweenStrokes(0.1, 1.5e4)  # before it is measured; chosen


class Tares(NamedTuple):
    """Dynamic tares: the identified parameters of the empty machine.

    friction:        names of the model's friction laws
    names:           of the P parameters
    values:          (P,) parameters
    covariance:      (P, P) of the values
    row_error:       (R,) rms torque that the model does not explain on the empty machine [N m]
    identified:      from a recording; otherwise from the data sheet
    scale:           factor on the residual torque; a lift of a known weight corrects by it errors of levers, areas and
                     gains
    scale_error:     standard error of `scale`
    correlation:     time for which the unexplained torque keeps its sign, as far as a weight is concerned [s]; 0: not
                     measured
    between_strokes: differences of friction and zeros between strokes
    common_error:    relative error of a common scale of all pressures that the data sheet's masses allow; 0 after a
                     lift of a known weight
    """

    friction: tuple[str, ...]
    names: tuple[str, ...]
    values: Array
    covariance: Array
    row_error: Array
    identified: bool
    scale: float = 1.0
    scale_error: float = 0.0
    correlation: float = 0.0
    between_strokes: BetweenStrokes = EXPECTED
    common_error: float = 0.0

    @property
    def reported_scale_error(self) -> float:
        """Relative standard error of every reported weight and force by the scale: `scale_error` and `common_error`."""
        return float(np.hypot(self.scale_error, self.common_error))


@dataclass(frozen=True)
class Model:
    """Model of one machine.

    Its columns: the P parameters of the empty machine, force and moment at the tool (3), the unknown friction at rest
    (C), and the zero errors of the pressures (C).

    machine:  the data sheet
    filters:  rates and cut-off frequencies
    friction: names of the friction laws
    usual:    (name, mean, standard deviation) of parameters over machines of this type; empty: unknown
    """

    machine: Machine
    filters: Filters
    friction: tuple[str, ...]
    usual: tuple[tuple[str, float, float], ...] = ()

    def with_laws(self, friction: tuple[str, ...]) -> "Model":
        """Return the model with other friction laws."""
        return replace(self, friction=friction)

    @property
    def sheet(self) -> "Model":
        """Model of the data sheet alone, without the usual values of the type."""
        return replace(self, usual=()) if self.usual else self

    @cached_property
    def empty(self) -> Regressor:
        """Columns of the empty machine's effects, by which its joint torques are columns @ parameters.

        The effects are gravity and inertia, centrifugal terms where slewing is measured, and those named in `friction`:
        friction laws, the delay of the angles behind the forces, the weight of linkages' bars and of cylinders."""
        rounding = self.filters.direction_speed
        laws: dict[str, ForceLaw] = {
            "coulomb": CoulombFriction(rounding),
            "viscous": ViscousFriction(),
            "load_dependent": LoadDependentFriction(rounding),
            "directional": AsymmetricFriction(rounding),
            "stribeck": Stribeck(CREEP, rounding),
        }
        turning: tuple[Effect, ...] = (Slew(),) if self._slews else ()
        others: dict[str, tuple[Effect, ...]] = {"delay": (Delay(),), BARS: of_bars(self.machine)}
        friction = [e for name in self.friction for e in others.get(name) or (Friction(name, laws[name]),)]
        return Regressor(self.machine, (Rigid(), *turning, *friction))

    @cached_property
    def _slews(self) -> bool:
        """Whether a sensor measures the slewing of the house."""
        return any(s.kind in (Kind.SLEW_RATE, Kind.SLEW_ANGLE) for s in self.machine.signals)

    @cached_property
    def filtered(self) -> FilteredRegressor:
        """All K columns with the filters of the weighing: P parameters, tool (3), friction at rest (C), zeros (C)."""
        effects = (*self.empty.effects, TipForce(), AtRest(self.filters.direction_speed), PressureZero())
        f = self.filters
        return FilteredRegressor(Regressor(self.machine, effects), 1.0 / f.rate_hz, f.regressor_hz, f.smoothing_hz)

    @cached_property
    def fast(self) -> FastFilters:
        """Filters of the rows of the instant, from which the force at the tool is computed."""
        return FastFilters(self.filters)

    @cached_property
    def channels(self) -> Channels:
        """Conversion of signals to motion."""
        return Channels(self.machine, self.filters)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The P parameters of the empty machine."""
        return self.empty.parameters

    @cached_property
    def tool(self) -> slice:
        """Places of the tool's three columns among all K: force forwards, force upwards, moment."""
        return slice(len(self.parameters), len(self.parameters) + 3)

    @cached_property
    def at_rest(self) -> slice:
        """Places of the columns of the unknown friction at rest among all K, one per cylinder."""
        first = len(self.parameters) + 3
        return slice(first, first + len(self.machine.cylinders))

    def share_at_rest(self, columns: Array) -> Array:
        """Return the share (..., R), 0 to 1, of each measured joint's lever with friction of unknown direction.

        At rest the direction of friction is unknown: the share is 1. It falls to 0 as the cylinders move faster. The
        lever is the sum of the sizes of the levers of the cylinders that act on the joint.

        columns: (..., R, K) all columns of filtered rows
        """
        unknown = columns[..., self.at_rest].sum(axis=-1)
        lever = np.abs(columns[..., self.coulomb]).sum(axis=-1)
        return np.asarray(unknown / np.maximum(lever + unknown, 1e-12))

    @cached_property
    def zero(self) -> slice:
        """Places of the columns of the pressures' zero errors among all K, one per cylinder."""
        return slice(len(self.parameters) + 3 + len(self.machine.cylinders), None)

    @cached_property
    def scale_error(self) -> float:
        """Relative standard error of the torque computed from pressures, by the data sheet.

        It combines the piston areas, the gain of the pressure sensors, and the lever with its two pins in mid-range, at
        the innermost measured joint. The largest error of several cylinders counts. A recording of the empty machine
        cannot reduce it; a lift of a known weight can. A cylinder that also acts on a joint beyond does not count,
        unless all do: at a loader's arm only the lift cylinders count, because the lever of the tilt cylinder, and with
        it its torque, may vanish there."""
        middle = np.array([(link.angle_low + link.angle_high) / 2.0 for link in self.machine.links])
        lever = np.abs(self.machine.geometry(middle).lever[:, self.machine.rows[0]])
        own = [c for c in self.acting[0] if max(self.machine.spans[c]) == self.machine.rows[0]] or self.acting[0]
        cylinders = [self.machine.cylinders[c] for c in own]
        areas = np.hypot(max(c.area_error for c in cylinders), GAIN_ERROR)
        pins = max(c.pin_error * np.sqrt(2.0) / lever[k] for c, k in zip(cylinders, own, strict=True))
        return float(np.hypot(areas, pins))

    @cached_property
    def changing_friction(self) -> list[int]:
        """Numbers of the columns whose friction changes with temperature and wear: Coulomb and viscous."""
        return [k for k, p in enumerate(self.parameters) if p.name.endswith((".coulomb", ".viscous"))]

    @cached_property
    def changing(self) -> NDArray[np.intp]:
        """Numbers (D,) of the columns that drift in service: changing friction, then the pressures' zero errors."""
        first = self.zero.start
        return np.array([*self.changing_friction, *range(first, first + len(self.machine.cylinders))])

    @cached_property
    def coulomb(self) -> list[int]:
        """Numbers of the columns of the Coulomb friction, one per cylinder; empty without that law."""
        return [k for k, p in enumerate(self.parameters) if p.name.endswith(".coulomb")]

    @cached_property
    def load(self) -> Array:
        """Change (P, 4) of the parameters per unit of a load (m, m x, m z, J about the last pin).

        A load at the last pin adds m l^2 to J and m l to X of each link before the last one, of length l, and its own
        moments to X, Z and J of the last link (mechanics/README.md, section 9)."""
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
        """For each of the R measured torques the numbers of the cylinders that act on its joint."""
        spans = self.machine.spans
        return tuple(tuple(c for c, span in enumerate(spans) if j in span) for j in self.machine.rows)

    @cached_property
    def settle_steps(self) -> int:
        """Settling time of the filters in steps: 7/w of the lowest cut-off w.

        A first-order filter settles in 5/w; the rest is a reserve for the filters of second order."""
        slowest = min(self.filters.regressor_hz, self.filters.smoothing_hz, self.filters.channel_hz)
        return int(np.ceil(7.0 / (2 * np.pi * slowest) * self.filters.rate_hz))

    @cached_property
    def prior(self) -> Prior:
        """Prior mean and covariance of the P parameters: the data sheet with its tolerances, before any recording.

        The parameters are J [kg m^2], X, Z [kg m] of each link, then those of slewing from the data sheet, of friction
        and delay, of which only the order of magnitude is known, and of linkages' bars and cylinders (`with_bars`).
        Usual values of the machine's type replace those of the data sheet. A millionth of the square of each J, X and
        Z, and 0.01 [SI], are added to its variance, so that none is exact."""
        n = 3 * self.machine.size
        size = len(self.parameters)
        mean, covariance = np.zeros(size), np.zeros((size, size))
        place = {p.name: k for k, p in enumerate(self.parameters)}
        for name, value, spread in self._guesses():
            mean[place[name]], covariance[place[name], place[name]] = value, spread**2
        mean[:n] = base_parameters(self.machine.links)
        covariance[:n, :n] = base_parameter_covariance(self.machine.links) + np.diag(1e-6 * mean[:n] ** 2 + 1e-2)
        return self._as_usual(with_bars(self.machine, tuple(place), Prior(mean, covariance)))

    def _as_usual(self, prior: Prior) -> Prior:
        """Return the prior of the P parameters with the usual values of the type in place of the data sheet's.

        They are independent of all others. A model without columns for the bars of linkages has the bars within its
        links. The type's values of links exclude the bars, so that they are skipped then."""
        place = {p.name: k for k, p in enumerate(self.parameters)}
        mean, covariance = prior.mean.copy(), prior.covariance.copy()
        first = 0 if BARS in self.friction or not of_bars(self.machine) else 3 * self.machine.size
        for name, value, spread in self.usual:
            k = place.get(name, -1)
            if k >= first:
                mean[k], covariance[k, :], covariance[:, k] = value, 0.0, 0.0
                covariance[k, k] = spread**2
        return Prior(mean, covariance)

    def _guesses(self) -> list[tuple[str, float, float]]:
        """Return the prior (name, mean, standard error) of every parameter of slewing, friction and delay.

        Those of slewing [kg m^2] follow from the data sheet. Of friction only the order of magnitude is known: a share
        of the cylinder's largest force [N, N s/m], or of its force; of the delay a time [s]. The bars of linkages are
        not among them."""
        guesses = []
        if self._slews:
            for link in self.machine.links:
                terms = slewing(link, tool=link is self.machine.links[-1])
                guesses.append((f"{link.name}.D_excess", terms.excess, terms.excess_error))
                guesses.append((f"{link.name}.E", terms.product, terms.product_error))
        for law in self.friction:
            if law == BARS:
                continue
            for c in self.machine.cylinders:
                largest = 300e5 * c.area_head  # N, at a relief pressure of 300 bar, typical of excavators
                spread = SPREAD[law] * (1.0 if law in ABSOLUTE else largest)
                guesses.append((f"{c.name}.{law}", TYPICAL.get(law, 0.0), spread))
        return guesses

    @cached_property
    def data_sheet(self) -> Tares:
        """Tares of a machine that was not identified: the prior's mean and covariance.

        The row errors are 2 % of the torque of the links' weight, as if each link were level: 0.02 g sum |X|."""
        scale = np.array([0.02 * 9.8 * abs(np.sum(np.abs(self.prior.mean[1::3][: self.machine.size])))])
        rows = np.broadcast_to(scale, (len(self.machine.rows),))
        names = tuple(p.name for p in self.parameters)
        return Tares(self.friction, names, self.prior.mean, self.prior.covariance, rows, False)
