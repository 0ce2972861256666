"""Regressors of the diagnosis: the residual torque of a model along a recording, and the column of each effect.

    residual = torque - base columns @ parameters

All rows are computed thinned to about 20 Hz, after the low-pass that the service applies first. The column of
an effect is the torque [N m] that one unit of its magnitude adds to the residual. Laws of force and torque give it
directly. For errors of sensors and of geometry it is a central difference of the residual.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from cylforce.effects.effect import Effect, Halves, Parameter
from cylforce.effects.fault import (
    ALL_ALONG,
    INCIDENTAL,
    OVER_BLOCKS,
    SHAPES,
    Alteration,
    BaseMotion,
    Distortion,
    Fault,
    ForceLaw,
    GrowingMass,
    Incident,
    JointLaw,
    MassChange,
    Place,
    Share,
    acting,
    places,
    rubbing,
)
from cylforce.effects.imposed import (
    Imposed,
    added_parameters,
    altered,
    base_motions,
    changed_laws,
    changed_load,
    contact_force,
    distorted,
    excess_force,
    excess_torque,
    friction_level,
    undistorted,
    unseen_slew,
)
from cylforce.effects.library import Proposal
from cylforce.effects.loads.carried import CarriedLoad
from cylforce.effects.loads.rocker_weight import RockerWeight
from cylforce.effects.loads.slew import Slew
from cylforce.effects.loads.tip_force import TipForce, tip_torque
from cylforce.estimation.channels import Moved
from cylforce.estimation.filters import Filter, denoised, second_order
from cylforce.estimation.model import Model
from cylforce.estimation.observation import REST_SHARE, unusable
from cylforce.estimation.regressor import FilteredRegressor, Regressor
from cylforce.estimation.sensitivity import Sensitivity
from cylforce.mechanics.machine import Machine, with_parameters
from cylforce.mechanics.motion import Motion
from cylforce.readings.constants import BLOCK_ROWS, LOAD_CENTRE, ROWS_HZ
from cylforce.readings.recording import Recording
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

CLOCK_COLUMN = INCIDENTAL.index("clock")
BARS = 100.0  # kg m: standard deviation of the first moments of a linkage's bars; physics: 100 kg at 1 m
# Decay of the polynomials of an incident's course within a block, from the level on; convention: a smooth function.
COURSE = (1.0, 0.6, 0.5, 0.35, 0.25, 0.2)
TYPICAL = (*ALL_ALONG.values(), *(share * size for share in COURSE for size in OVER_BLOCKS.values()))
FREE_TORQUE = 5e3  # N m, typical size of a torque in a single block
DEAD_SLEW = 0.01  # rad/s, below which a slew sensor may be dead
LATE_STEP = 0.01  # s, of the difference quotient by the clock
LOAD_S = 100.0  # s of a recording, to which the centre of a known load is fitted; chosen, below NOISE_S
LIGHTEST = 1e-9  # kg: replaces a mass of zero in a quotient


@dataclass(frozen=True)
class TorqueRows:
    """Rows of a recording: T rows, R measured joints, C cylinders, N links.

    base:       (T, R, P) columns of the model's parameters
    bars:       (T, R, Q) columns of the bars of linkages
    effects:    (T, R, E) columns of the lasting effects, in the order of the proposals
    incidental: (T, R, I) columns of a load, of the clock, of forces at the teeth, of slewing, of free torques
    residual:   (T, R) residual torque [N m]; NaN where not usable
    t:          (T,) time since the start of the file [s]
    speed:      (T, C) speed of the cylinders [m/s]
    force:      (T, C) force of the cylinders [N]
    posture:    (T, N) joint angles [rad]
    """

    base: Array
    bars: Array
    effects: NDArray[np.float32]
    incidental: NDArray[np.float32]
    residual: Array
    t: Array
    speed: Array
    force: Array
    posture: Array

    def first(self, count: int) -> "TorqueRows":
        """Return the first `count` rows."""
        return TorqueRows(**{f.name: getattr(self, f.name)[:count] for f in fields(self)})


def courses(share: Array) -> Array:
    """Return the polynomials (SHAPES, T) of an incident's course, mean square one.

    share: (T,) position in a block, 0..1
    """
    return np.asarray(legvander(2.0 * share - 1.0, SHAPES - 1).T * np.sqrt(2.0 * np.arange(SHAPES) + 1.0)[:, None])


def typical_incidents(machine: Machine) -> Array:
    """Return the typical sizes (I,) of the incidental columns."""
    return np.concatenate([TYPICAL, np.tile(FREE_TORQUE * np.array(COURSE), len(machine.rows))])


@dataclass(frozen=True)
class _Laws:
    """Laws of force and torque at their locations, as one effect of the regressor.

    laws: each with the number of its location
    t:    (T,) time [s]
    """

    laws: tuple[tuple[ForceLaw | JointLaw, int], ...]
    t: Array

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """Return one parameter of each law."""
        return tuple(Parameter(f"{k}.{law.about.name}", law.about.unit) for k, (law, _) in enumerate(self.laws))

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Return the columns (T, N, E)."""
        return Halves(None, np.stack([acting(law, machine, moving, self.t, at) for law, at in self.laws], axis=-1))


@dataclass(frozen=True)
class _MovingBase:
    """Motion of the base as an effect of the regressor.

    effect: the motion
    rate:   (T,) rate of the base in the arm's plane [rad/s]
    masses: (N, 3) inertia and first moments of the links
    """

    effect: BaseMotion
    rate: Array
    masses: Array

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """Return one parameter of each size."""
        return tuple(Parameter(f"{k}.{self.effect.about.name}", u) for k, u in enumerate(self.effect.units))

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Return the columns (T, N, M)."""
        return self.effect.halves(machine, moving, self.rate, self.masses)


@dataclass(frozen=True)
class _ColumnRun:
    """Inputs for the columns of a recording.

    regressors: of the model
    recording:  the recording
    parameters: (P,) of the machine with its known load
    change:     sensitivity of the residual to readings and machines
    """

    regressors: "Regressors"
    recording: Recording
    parameters: Array
    change: Sensitivity

    @cached_property
    def base_rate(self) -> Array:
        """Rate (T,) of the base [rad/s]."""
        return self.regressors.base_rate(self.recording.values)


@dataclass(frozen=True)
class Regressors:
    """Computation of the rows of recordings for one model.

    model:      the model
    parameters: (P,) values of its parameters
    """

    model: Model
    parameters: Array

    @cached_property
    def _thin(self) -> int:
        return max(round(self.model.filters.rate_hz / ROWS_HZ), 1)

    @property
    def rows_hz(self) -> float:
        """Rows per second: ROWS_HZ, or the nearest rate of which the service's is a multiple."""
        return self.model.filters.rate_hz / self._thin

    @cached_property
    def weighed(self) -> Machine:
        """Machine with the masses of its parameters: the error of some readings depends on the weight."""
        return with_parameters(self.model.machine, self.parameters[: 3 * self.model.machine.size])

    @cached_property
    def slow(self) -> Model:
        """Model at the diagnosis' rate."""
        filters = self.model.filters._replace(rate_hz=self.rows_hz)
        return Model(self.model.machine, filters, self.model.friction)

    @cached_property
    def _low_pass(self) -> Filter:
        return second_order(self.model.filters.channel_hz, 1.0 / self.model.filters.rate_hz)

    def _sensitivity(self, values: Array, parameters: Array) -> Sensitivity:
        return Sensitivity(self.slow, parameters, values, self._low_pass, self._thin)

    def thinned(self, values: Array) -> Array:
        """Return samples (T', S) at the diagnosis' rate, low-passed."""
        return self._sensitivity(values, self.parameters).thinned

    @property
    def _bars(self) -> list[Effect]:
        modelled = "rocker" in self.model.friction or not RockerWeight().parameters(self.model.machine)
        return [] if modelled else [RockerWeight()]

    def _filtered(self, *more: Effect) -> FilteredRegressor:
        f, effects = self.slow.filters, (*self.slow.empty.effects, *more)
        return FilteredRegressor(Regressor(self.slow.machine, effects), 1.0 / f.rate_hz, f.regressor_hz, f.smoothing_hz)

    @cached_property
    def regressor(self) -> FilteredRegressor:
        """Filtered columns of the model's parameters and of the bars of linkages."""
        return self._filtered(*self._bars)

    @property
    def channel_lag(self) -> float:
        """Latency of a motion behind its samples [s]."""
        return (
            self._low_pass.delay / self.model.filters.rate_hz + self.slow.channels.smooth.delay * self.slow.channels.dt
        )

    @property
    def lag(self) -> float:
        """Latency of a row behind its samples [s]."""
        return self.channel_lag + self.regressor.delay

    # Rows

    def rows(
        self, recording: Recording, proposals: Sequence[Proposal], lost: NDArray[np.bool_] | None = None
    ) -> TorqueRows:
        """Return the rows of a recording, with one column for each size of the proposals.

        lost: (T'', R) rows that are not usable, T'' >= T'; None: computed from levers, end stops and rest
        """
        values, late = recording.values, slice(self.slow.settle_steps, None)
        moved = self.slow.channels.run(self.thinned(values))
        steps = np.arange(len(moved.motion.q), dtype=np.float64)
        t = recording.begins_s + (steps - 0.5) / self.slow.filters.rate_hz  # the middle of the step before
        laws = tuple((e, p.where) for p in proposals for e in p.group if isinstance(e, ForceLaw | JointLaw))
        filtered = self._filtered(*([_Laws(laws, t)] if laws else []), *self._bars).run(moved.motion)
        size = len(self.parameters)
        base = filtered.columns[..., :size]
        residual = filtered.torque - base @ self.parameters
        if lost is None:
            lost = self._lost(moved)
        else:
            lost = np.pad(lost[: len(residual[late])], ((self.slow.settle_steps, 0), (0, 0)))
        residual = np.where(lost, np.nan, residual)
        parameters = self.parameters + self._carried(recording.load_kg, base[late], residual[late])
        run = _ColumnRun(self, recording, parameters, self._sensitivity(values, parameters))
        forces = iter(np.moveaxis(filtered.columns[..., size : size + len(laws)], -1, 0))
        lasting = [(p, e) for p in proposals for e in p.group if not isinstance(e, Incident)]
        columns = [self._columns(p, e, run, base, t, forces)[late] for p, e in lasting]
        effects = np.concatenate([np.zeros((*base[late].shape[:2], 0)), *columns], axis=-1, dtype=np.float64)
        motion = moved.motion
        return TorqueRows(
            base=base[late].copy(),
            bars=filtered.columns[late, :, size + len(laws) :].copy(),
            effects=np.where(np.isfinite(effects), effects, 0.0).astype(np.float32),
            incidental=self._incidental(run, moved, base)[late].astype(np.float32),
            residual=residual[late],
            t=t[late],
            speed=motion.speed[late],
            force=motion.force[late],
            posture=np.diff(motion.a, axis=1, prepend=0.0)[late],
        )

    def column_source(self, recording: Recording, rows: TorqueRows) -> "ColumnSource":
        """Return the source of the columns of further effects along a recording with computed rows."""
        values = recording.values
        moved = self.slow.channels.run(self.thinned(values))
        parameters = self.parameters + self._carried(recording.load_kg, rows.base, rows.residual)
        run = _ColumnRun(self, recording, parameters, self._sensitivity(values, parameters))
        steps = np.arange(len(moved.motion.q), dtype=np.float64)
        return ColumnSource(self, run, moved, recording.begins_s + (steps - 0.5) / self.slow.filters.rate_hz)

    def residual(self, recording: Recording, lost: NDArray[np.bool_]) -> Array:
        """Return only the residual (T', R) [N m], the mass of the known load subtracted.

        lost: (T'', R) rows that are not usable, T'' >= T'
        """
        motion = self.slow.channels.run(self.thinned(recording.values)).motion
        parameters = self.parameters + self.model.load[:, 0] * recording.load_kg
        found = self._filtered().left(motion, parameters)[self.slow.settle_steps :]
        return np.where(lost[: len(found)], np.nan, found)

    def _lost(self, moved: Moved) -> NDArray[np.bool_]:
        share = self.slow.share_at_rest(self.slow.filtered.run(moved.motion).columns)
        return np.asarray(np.logical_or(unusable(self.slow, moved), share > REST_SHARE))

    def _carried(self, load_kg: float, base: Array, residual: Array) -> Array:
        """Return the contribution of a known load to the parameters (P,): errors of sensors depend on it.

        Its first moments and inertia are fitted to the first LOAD_S of the residual (T, R), each row weighted by its
        rms: to the same time in a recording and in its beginning with more sensor noise.
        """
        if not load_kg:
            return np.zeros_like(self.parameters)
        count = round(LOAD_S * self.rows_hz)
        base, residual = base[:count], residual[:count]
        columns, good = base @ self.model.load, np.isfinite(residual)
        energy = np.sum(np.where(good, residual, 0.0) ** 2, axis=0)
        scale = np.sqrt(energy / np.maximum(np.sum(good, axis=0), 1)) + 1e-9
        weighted = (columns / scale[:, None])[good]
        excess = (residual / scale)[good] - weighted[:, 0] * load_kg
        normal = weighted[:, 1:].T @ weighted[:, 1:] + np.diag(np.array(LOAD_CENTRE) ** -2.0)
        moments = np.linalg.solve(normal, weighted[:, 1:].T @ excess)
        return np.asarray(self.model.load @ np.array([load_kg, *moments]))

    def base_rate(self, values: Array) -> Array:
        """Return the rate (T',) [rad/s] of the base, from a denoised pitch: its noise would bias a regression."""
        quiet = values.copy()
        for k, signal in enumerate(self.model.machine.signals):
            if signal.kind is Kind.PITCH:
                quiet[:, k] = denoised(values[:, k], self.model.filters.rate_hz)
        return self.slow.channels.turning(self.thinned(quiet))

    def _incidental(self, run: _ColumnRun, moved: Moved, base: Array) -> Array:
        """Return the incidental columns (T', R, I)."""
        machine, f = self.model.machine, self.slow.filters
        turning = moved.motion._replace(slew=np.ones_like(moved.motion.slew))
        plain = Regressor(machine, (TipForce(), Slew()))
        found = FilteredRegressor(plain, 1.0 / f.rate_hz, f.regressor_hz, f.smoothing_hz).run(turning).columns
        known = dict(zip((p.name for p in self.model.parameters), run.parameters.tolist(), strict=True))
        slew = found[..., 3:] @ np.array([known.get(name, 0.0) for name in plain.names[3:]])
        unmeasured = np.abs(moved.motion.slew) < DEAD_SLEW  # a slew that is measured is no incident
        each = {"tip.x": found[..., 0], "tip.z": found[..., 1], "slew": slew * unmeasured[:, None]}
        local = np.stack([each[name] for name in OVER_BLOCKS], axis=-1)
        steps = np.arange(len(base)) - self.slow.settle_steps
        within = courses((steps % BLOCK_ROWS + 0.5) / BLOCK_ROWS)
        forces = [local * course[:, None, None] for course in within]
        torques = np.eye(len(machine.rows))[None, :, :, None] * within.T[:, None, None, :]
        return np.concatenate(
            [base @ self.model.load, self._late_pressures(run), *forces, torques.reshape(*torques.shape[:2], -1)],
            axis=-1,
        )

    def _late_pressures(self, run: _ColumnRun) -> Array:
        """Return the change of the residual (T', R, 1) per second of latency of the pressures, by a difference
        quotient.
        """
        values, t = run.recording.values, np.arange(len(run.recording.values)) / self.model.filters.rate_hz
        pressures = [k for _, k in places(self.model.machine, Place.PRESSURE)]

        def shifted(by: float) -> Array:
            other = values.copy()
            for k in pressures:
                other[:, k] = np.interp(t - by, t, values[:, k])
            return other

        change = run.change.of_readings(shifted(LATE_STEP), shifted(-LATE_STEP))
        return np.asarray(change[..., None] / (2.0 * LATE_STEP))

    def _columns(
        self, p: Proposal, effect: Fault, run: _ColumnRun, base: Array, t: Array, forces: Iterator[Array]
    ) -> Array:
        """Return the columns (T', R, M) of one effect at its location."""
        if isinstance(effect, ForceLaw | JointLaw):
            return next(forces)[..., None]
        if isinstance(effect, MassChange):
            grown = effect.grown(t)[:, None, None] if isinstance(effect, GrowingMass) else np.ones(1)
            rigid = base[..., : 3 * self.model.machine.size]
            return np.asarray(rigid @ effect.change(self.model.machine, p.where) * grown)
        if isinstance(effect, Share):
            return self._known_friction(p, effect, base, t)
        if isinstance(effect, BaseMotion):
            return self._base_motion(effect, run)
        return self._difference(p, effect, run)

    def _known_friction(self, p: Proposal, effect: Share, base: Array, t: Array) -> Array:
        cylinders = self.model.machine.cylinders
        own = [cylinders[c].name for c in rubbing(effect, p.where, len(cylinders))]
        names = [f"{name}.{law}" for name in own for law in effect.laws]
        chosen = [k for k, parameter in enumerate(self.model.parameters) if parameter.name in names]
        return np.asarray((base[..., chosen] @ self.parameters[chosen] * effect.course(t)[:, None])[..., None])

    def _base_motion(self, effect: BaseMotion, run: _ColumnRun) -> Array:
        f, machine = self.slow.filters, self.model.machine
        moving = _MovingBase(effect, run.base_rate, run.parameters[: 3 * machine.size].reshape(-1, 3))
        plain = FilteredRegressor(Regressor(machine, (moving,)), 1.0 / f.rate_hz, f.regressor_hz, f.smoothing_hz)
        return plain.run(run.change.motion).columns

    def _difference(self, p: Proposal, effect: Fault, run: _ColumnRun) -> Array:
        """Return the derivative of the residual with respect to the magnitude, by a central difference.

        measured = true + error. The column of an error of readings is the change when they are distorted once more;
        that of an error of the machine file is the negative change with the true machine.
        """
        step = np.sqrt(effect.about.low * effect.about.high)
        values = run.recording.values
        if isinstance(effect, Distortion):
            t = run.recording.times(self.model.filters.rate_hz)
            read = [effect.distorted(self.weighed, values, t, p.where, sign * step) for sign in (1.0, -1.0)]
            change = run.change.of_readings(*read)
        elif isinstance(effect, Alteration):
            true = [effect.altered(self.model.machine, p.where, sign * step) for sign in (-1.0, 1.0)]
            change = run.change.of_machines(*true)
        else:
            raise TypeError(f"{effect!r} is no force law, distortion, alteration or weight")
        return np.asarray(change[..., None] / (2.0 * step))

    # Effects removed from readings, or switched on

    def corrected(self, recording: Recording, effects: Sequence[Imposed]) -> tuple["Regressors", Recording]:
        """Return the regressors of the altered machine, and the recording with its sensor errors removed."""
        other = Regressors(replace(self.model, machine=altered(self.model.machine, effects)), self.parameters)
        values = undistorted(self.weighed, effects, recording.values, recording.times(self.model.filters.rate_hz))
        return other, replace(recording, values=values)

    def simulated(self, recording: Recording, rows: TorqueRows, effects: Sequence[Imposed], load: Array) -> TorqueRows:
        """Return the rows of a machine with effects: base, bars and residual along the true motion.

        The effects are read by the code of the simulated machine, so that a wrong unit, sign, location or time shows.
        The true motion is the one that the sensors' errors distort into the recorded one. Raises ValueError, in a
        sentence, where the machine cannot do so.
        load: (4,) mass [kg], first moments [kg m], inertia [kg m^2] of the known load
        """
        if not effects:
            return rows
        other, corrected = self.corrected(recording, effects)
        return _Simulated(other, effects, self.parameters + self.model.load @ load, load).rows(
            corrected.values, rows, recording
        )


@dataclass(frozen=True)
class ColumnSource:
    """Source of the columns of single effects along a recording, such as a law with another shape.

    regressors: of the model
    run:        inputs for the columns
    moved:      motion of the recording
    t:          (T,) time [s]
    """

    regressors: Regressors
    run: _ColumnRun
    moved: Moved
    t: Array

    def columns(self, p: Proposal) -> Array:
        """Return the columns (T', R, M) of an effect at its location."""
        own, f, late = self.regressors, self.regressors.slow.filters, slice(self.regressors.slow.settle_steps, None)
        laws = tuple((e, p.where) for e in p.group if isinstance(e, ForceLaw | JointLaw))
        if laws:
            plain = Regressor(own.slow.machine, (_Laws(laws, self.t),))
            filtered = FilteredRegressor(plain, 1.0 / f.rate_hz, f.regressor_hz, f.smoothing_hz).run(self.moved.motion)
            found = filtered.columns
        else:
            base = self._base if any(isinstance(e, MassChange | Share) for e in p.group) else np.zeros(0)
            each = [own._columns(p, e, self.run, base, self.t, iter(())) for e in p.group]  # noqa: SLF001 - of one module
            found = np.concatenate(each, axis=-1)
        return np.nan_to_num(found[late])

    @cached_property
    def _base(self) -> Array:
        return self.regressors._filtered().run(self.moved.motion).columns  # noqa: SLF001 - of one module


@dataclass(frozen=True)
class _Simulated:
    """Machine with effects switched on, along a true motion.

    regressors: of the altered machine
    effects:    effects that are switched on
    parameters: (P,) with the known load
    load:       (4,) mass, first moments and inertia of the known load
    """

    regressors: Regressors
    effects: Sequence[Imposed]
    parameters: Array
    load: Array

    def rows(self, values: Array, rows: TorqueRows, recording: Recording) -> TorqueRows:
        """Return rows with base, bars, load and residual along the true readings (T, S).

        The other incidental columns are those of the recorded motion.
        """
        own, late, size = self.regressors, slice(self.regressors.slow.settle_steps, None), len(self.parameters)
        moved = own.slow.channels.run(own.thinned(values))
        steps = np.arange(len(moved.usable), dtype=np.float64)
        t = recording.begins_s + (steps - 0.5) / own.slow.filters.rate_hz - own.channel_lag
        filtered = own.regressor.run(moved.motion)
        base, bars = filtered.columns[..., :size], filtered.columns[..., size:]
        excess = own.regressor.filtered(*self._excess(moved.motion, values, t))
        residual = filtered.torque - base @ own.parameters - excess
        residual -= np.einsum("trp,tp->tr", base, self._added(t - own.regressor.delay))
        lost = np.isnan(rows.residual) | unusable(own.slow, moved)[late]
        residual = np.where(lost, np.nan, residual[late])
        load = (base[late] @ own.model.load).astype(np.float32)
        incidental = np.concatenate([load, rows.incidental[..., load.shape[-1] :]], axis=-1)
        return replace(rows, base=base[late].copy(), bars=bars[late].copy(), incidental=incidental, residual=residual)

    def _added(self, t: Array) -> Array:
        """Return the change of the parameters (T, P) by the effects: masses of links, friction, changes of the load."""
        machine, model = self.regressors.slow.machine, self.regressors.slow
        found = np.zeros((len(t), len(self.parameters)))
        found[:, : 3 * machine.size] = added_parameters(machine, self.effects, t).reshape(len(t), -1)
        names = [p.name for p in model.parameters]
        for law in changed_laws(self.effects):
            level = friction_level(self.effects, len(machine.cylinders), t, law) - 1.0
            for c, cylinder in enumerate(machine.cylinders):
                if f"{cylinder.name}.{law}" in names:
                    k = names.index(f"{cylinder.name}.{law}")
                    found[:, k] += level[:, c] * self.parameters[k]
        mass, x, z, inertia = self.load
        centre = np.tile(np.array([x, z]) / max(mass, LIGHTEST), (len(t), 1))
        before = CarriedLoad(np.full(len(t), mass), centre, np.full(len(t), inertia))
        after = changed_load(self.effects, before, t)
        change = [np.column_stack([c.mass, c.mass[:, None] * c.centre, c.inertia]) for c in (before, after)]
        return np.asarray(found + (change[1] - change[0]) @ model.load.T)

    def _excess(self, moving: Motion, values: Array, t: Array) -> tuple[Array, Array]:
        """Return momentum and static torque (T, R) that the effects add, at times (T,)."""
        machine = self.regressors.slow.machine
        static = np.einsum("tcn,tc->tn", moving.lever, excess_force(self.effects, moving, t))
        static += excess_torque(machine, self.effects, moving, t)
        static += tip_torque(machine, moving, contact_force(self.effects, t))
        static += self._slewing(moving, t)
        momentum, riding = self._moving_base(moving, values, t)
        return momentum, static[:, machine.rows] + riding

    def _slewing(self, moving: Motion, t: Array) -> Array:
        """Return the torque (T, N) of an unmeasured slew, whose square adds to the square of the rate."""
        squares, machine = unseen_slew(self.effects, t), self.regressors.slow.machine
        if not np.any(squares):
            return np.zeros_like(moving.q)
        names = [p.name for p in Slew().parameters(machine)]
        known = dict(zip((p.name for p in self.regressors.slow.parameters), self.parameters.tolist(), strict=True))
        columns = Slew().halves(machine, moving._replace(slew=np.ones_like(moving.slew))).static
        return np.asarray(squares[:, None] * (columns @ np.array([known.get(name, 0.0) for name in names])))

    def _moving_base(self, moving: Motion, values: Array, t: Array) -> tuple[Array, Array]:
        """Return momentum and static torque (T, R) of a moving base."""
        model = self.regressors.slow
        found = np.zeros((2, len(t), len(model.machine.rows)))
        for effect, each in base_motions(self.effects):
            rate = self.regressors.base_rate(values)
            base = _MovingBase(effect, rate, self.parameters[: 3 * model.machine.size].reshape(-1, 3))
            halves = Regressor(model.machine, (base,)).products(moving, np.array(each.sizes))
            found += each.during(t)[:, None] * np.array(halves)
        return found[0], found[1]


# Return pressures: the chamber that discharges oil


STEADY_SPEED = 0.03  # m/s, above which a cylinder counts as moving
EVEN_SHARE, EVEN_STEP = 0.15, 0.003  # of the speed, m/s: by how much it may change nearby
NEARBY = 8  # rows, on either side
FEW_ROWS, FEW_BLOCKS_OF_LAW = 6, 6  # of a block; of a law
COMMON_ERROR = 0.2e5  # Pa: by which a return pressure differs from one recording to the next
EXACT, SCATTERED = 0.3e5, 1.5e5  # Pa: scatter of a law at least; a pressure that scatters more follows none
USUAL_SPEED, STEEP = 0.1, 20e5  # m/s, Pa: a typical speed, and the largest loss at it
FARTHEST = 5.0  # standard errors, beyond which the evidence of a level stays constant
HUBER, WILD, LAW_ROUNDS = 1.5, 3.0, 15
DISCHARGES = {Kind.HEAD_PRESSURE: -1.0, Kind.ROD_PRESSURE: 1.0}  # direction in which a chamber discharges oil


@dataclass(frozen=True)
class ReturnLaw:
    """Return pressure of a chamber while the pump drives its cylinder evenly: a + b |v| + c v^2.

    It is the pressure loss of valve and return line at that speed, whatever the load. A torque cannot separate the zero
    of the head side from that of the rod side, nor both from friction that differs between the directions. This law
    can.
    values:     (3,) [Pa], speed in USUAL_SPEED
    covariance: (3, 3) of the values
    scatter:    of blocks about the law [Pa]
    """

    values: Array
    covariance: Array
    scatter: float


@dataclass(frozen=True)
class ReturnLevel:
    """Return pressure of one sensor in a recording under diagnosis.

    blocks: (recording number, rows (n,)) of every block with an even, driven motion
    excess: (B,) pressure above the law [Pa]
    error:  standard error of the mean excess [Pa]
    """

    blocks: tuple[tuple[int, NDArray[np.intp]], ...]
    excess: Array
    error: float


def _discharging(
    machine: Machine, sensor: int, recording: Recording, rows: TorqueRows, rate_hz: float
) -> list[tuple[NDArray[np.intp], float, float]]:
    """Return (rows, speed [m/s], pressure [Pa]) of each block in which a chamber discharges oil evenly."""
    signal = machine.signals[sensor]
    v, force = rows.speed[:, signal.index], rows.force[:, signal.index]
    even = np.zeros(len(v), dtype=np.bool_)
    if len(v) > 2 * NEARBY:
        here = v[NEARBY : len(v) - NEARBY]
        changes = [
            np.abs(v[NEARBY + d : len(v) - NEARBY + d] - here) for d in (-NEARBY, -NEARBY // 2, NEARBY // 2, NEARBY)
        ]
        even[NEARBY : len(v) - NEARBY] = np.max(changes, axis=0) < EVEN_SHARE * np.abs(here) + EVEN_STEP
    chosen = np.flatnonzero((DISCHARGES[signal.kind] * v > STEADY_SPEED) & (force * v > 0.0) & even)
    pressure = np.interp(rows.t[chosen], recording.times(rate_hz), recording.values[:, sensor])
    found = []
    for block in np.unique(chosen // BLOCK_ROWS):
        own = chosen // BLOCK_ROWS == block
        if np.sum(own) >= FEW_ROWS:
            found.append((chosen[own], float(np.median(v[chosen[own]])), float(np.median(pressure[own]))))
    return found


def _speed_columns(speeds: Sequence[float]) -> Array:
    speed = np.array(speeds) / USUAL_SPEED
    return np.stack([np.ones_like(speed), np.abs(speed), speed**2], axis=-1)


def return_laws(machine: Machine, seen: Sequence[tuple[Recording, TorqueRows]], rate_hz: float) -> dict[int, ReturnLaw]:
    """Return the return laws of a healthy machine, by the number of the pressure's signal."""
    found = {}
    for sensor, signal in enumerate(machine.signals):
        if signal.kind not in DISCHARGES:
            continue
        blocks = [b for recording, rows in seen for b in _discharging(machine, sensor, recording, rows, rate_hz)]
        if len(blocks) >= FEW_BLOCKS_OF_LAW:
            law = _fitted_law(_speed_columns([b[1] for b in blocks]), np.array([b[2] for b in blocks]))
            if law.scatter <= SCATTERED:
                found[sensor] = law
    return found


def _fitted_law(columns: Array, pressures: Array) -> ReturnLaw:
    """Fit a law robustly (Huber's weights); pressure increases with speed."""
    free = max(len(pressures) - 3, 1)
    root, values, scatter = np.ones(len(pressures)), np.zeros(3), EXACT
    away = pressures
    for _ in range(LAW_ROUNDS):
        bounds = (np.array([-np.inf, 0.0, 0.0]), np.inf)
        values = np.asarray(lsq_linear(columns * root[:, None], pressures * root, bounds=bounds).x)
        away = np.abs(pressures - columns @ values)
        scatter = max(1.48 * float(np.median(away)) * float(np.sqrt(len(pressures) / free)), EXACT)
        root = np.minimum(1.0, np.sqrt(HUBER * scatter / np.maximum(away, 1e-9)))
    weight = root**2
    energy = float(np.sum(weight * np.minimum(away, WILD * scatter) ** 2))
    scatter = max(float(np.sqrt(energy / max(float(np.sum(weight)) - 3, 1.0))), scatter)
    known = (columns * weight[:, None]).T @ columns + np.diag([0.0, 1.0, 1.0]) * (scatter / STEEP) ** 2
    return ReturnLaw(values, np.asarray(np.linalg.inv(known) * scatter**2), scatter)


def return_levels(
    machine: Machine, laws: dict[int, ReturnLaw], seen: Sequence[tuple[Recording, TorqueRows]], rate_hz: float
) -> dict[int, ReturnLevel]:
    """Return the excess of the return pressures over the healthy machine's laws, by signal."""
    found = {}
    for sensor, law in laws.items():
        blocks = [
            (n, *b)
            for n, (recording, rows) in enumerate(seen)
            for b in _discharging(machine, sensor, recording, rows, rate_hz)
        ]
        if len(blocks) < FEW_BLOCKS_OF_LAW // 2:
            continue
        columns = _speed_columns([b[2] for b in blocks])
        excess = np.array([b[3] for b in blocks]) - columns @ law.values
        middle, most, mean = float(np.median(excess)), HUBER * law.scatter, np.mean(columns, axis=0)
        variance = COMMON_ERROR**2 + law.scatter**2 / len(blocks) + float(mean @ law.covariance @ mean)
        clipped = np.clip(excess, middle - most, middle + most)
        found[sensor] = ReturnLevel(tuple((b[0], b[1]) for b in blocks), clipped, float(np.sqrt(variance)))
    return found


def return_evidence(
    machine: Machine,
    level: ReturnLevel,
    p: Proposal,
    size: float,
    seen: Sequence[tuple[Recording, TorqueRows]],
    rate_hz: float,
) -> float:
    """Return the evidence [nats] of return pressures for an error of a pressure sensor, against none.

    size: size of the error [Pa]
    """
    added = []
    for number, rows in level.blocks:
        recording, own = seen[number]
        t = recording.times(rate_hz)
        without = distorted(machine, [Imposed(p.group, p.at, p.where, (-size,))], recording.values, t)
        change = recording.values[:, p.where] - without[:, p.where]
        added.append(float(np.median(np.interp(own.t[rows], t, change))))
    wanted = np.array(added)
    usual = float(np.sqrt(np.mean(wanted**2)))
    if usual <= 0.0:
        return 0.0
    shown = float(wanted @ level.excess) / float(wanted @ wanted) * usual

    def loss(x: float) -> float:
        return min(0.5 * x * x, 0.5 * FARTHEST**2)

    return loss(shown / level.error) - loss((shown - usual) / level.error)
