"""A recording as the diagnosis sees it: what the model leaves of the torques, and what each effect would add to them.

Everything is computed at a fifth of the sampling rate, after the low-pass that the service itself applies first."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from cylforce.diagnosis.columns.recorded import GapRows, Recorded, RecordedRun
from cylforce.diagnosis.columns.riding import Carried, quiet
from cylforce.effects.effect import Effect, Halves, Parameter
from cylforce.effects.fault import (
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
from cylforce.effects.library import Proposal
from cylforce.effects.loads.rocker_weight import RockerWeight
from cylforce.effects.loads.slew import Slew
from cylforce.effects.loads.tip_force import TipForce
from cylforce.estimation.channels import Moved
from cylforce.estimation.filters import Filter, second_order
from cylforce.estimation.model import Model
from cylforce.estimation.observation import REST_SHARE, unusable
from cylforce.estimation.regressor import FilteredRegressor, Regressor
from cylforce.estimation.sensitivity import Sensitivity
from cylforce.mechanics.machine import Machine, with_parameters
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array

RATE_HZ = 20.0
BLOCK = 60  # rows that are judged as one: three seconds
DEAD_SLEW = 0.01  # rad/s, below which a slew sensor may be dead
ROCKER = 100.0  # kg m: how little is known of a linkage's bars
CENTRE = (300.0, 300.0, 600.0)  # kg m, kg m, kg m^2: how little is known of a load but its mass


def shapes(share: Array) -> Array:
    """Level, slope, bend, ... (SHAPES, T) at `share` (T,) 0..1 of a block: Legendre's polynomials, of mean square
    one."""
    return np.asarray(legvander(2.0 * share - 1.0, SHAPES - 1).T * np.sqrt(2.0 * np.arange(SHAPES) + 1.0)[:, None])


@dataclass(frozen=True)
class _Laws:
    """Laws of force and torque at their places, as one effect of the regressor."""

    laws: tuple[tuple[ForceLaw | JointLaw, int], ...]
    t: Array

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """One of each."""
        return tuple(Parameter(f"{k}.{law.about.name}", law.about.unit) for k, (law, _) in enumerate(self.laws))

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Columns (T, N, E)."""
        each = [acting(law, machine, moving, self.t, where) for law, where in self.laws]
        return Halves(None, np.stack(each, axis=-1))


@dataclass(frozen=True)
class Viewer:
    """Turns recordings into rows for one model with given tares (P,) [values of the model's parameters]."""

    model: Model
    tares: Array

    @cached_property
    def _thin(self) -> int:
        return max(round(self.model.filters.rate_hz / RATE_HZ), 1)

    @property
    def rows_hz(self) -> float:
        """Rows a second: RATE_HZ, or next to it where the machine's rate is no multiple of that."""
        return self.model.filters.rate_hz / self._thin

    @cached_property
    def weighed(self) -> Machine:
        """The machine with the masses that its tares tell: some readings err by what hangs there."""
        return with_parameters(self.model.machine, self.tares[: 3 * self.model.machine.size])

    @cached_property
    def slow(self) -> Model:
        """The model at the diagnosis' rate."""
        filters = self.model.filters._replace(rate_hz=self.rows_hz)
        return Model(self.model.machine, filters, self.model.friction)

    def thinned(self, values: Array) -> Array:
        """Samples (T', S) at the diagnosis' rate, low-passed."""
        return self._sensitivity(values, self.tares).thinned

    @cached_property
    def _low(self) -> Filter:
        return second_order(self.model.filters.channel_hz, 1.0 / self.model.filters.rate_hz)

    def _sensitivity(self, values: Array, tares: Array) -> Sensitivity:
        return Sensitivity(self.slow, tares, values, self._low, self._thin)

    @cached_property
    def regressor(self) -> FilteredRegressor:
        """The columns of the model's parameters and of linkages' bars."""
        return self._filtered(*self._bars)

    @property
    def _bars(self) -> list[Effect]:
        known = "rocker" in self.model.friction or not RockerWeight().parameters(self.model.machine)
        return [] if known else [RockerWeight()]

    def _filtered(self, *more: Effect) -> FilteredRegressor:
        f, effects = self.slow.filters, (*self.slow.empty.effects, *more)
        return FilteredRegressor(Regressor(self.slow.machine, effects), 1.0 / f.rate_hz, f.regressor_hz, f.smoothing_hz)

    @property
    def channel_lag(self) -> float:
        """By how much a motion comes after its samples [s]."""
        return self._low.delay / self.model.filters.rate_hz + self.slow.channels.smooth.delay * self.slow.channels.dt

    @property
    def filter_lag(self) -> float:
        """By how much a row comes after its motion [s]."""
        return self.regressor.delay

    @property
    def lag(self) -> float:
        """By how much a row comes after its samples [s]."""
        return self.channel_lag + self.filter_lag

    def rows(self, recorded: Recorded, wanted: Sequence[Proposal], lost: NDArray[np.bool_] | None = None) -> GapRows:
        """The rows of a recording, effects' columns in the order of `wanted`; `lost` (T', R): which rows are not
        usable, if that is known already."""
        values, late = recorded.values, slice(self.slow.settle_steps, None)
        moved = self.slow.channels.run(self.thinned(values))
        steps = np.arange(len(moved.motion.q), dtype=np.float64)
        t = recorded.begins + (steps - 0.5) / self.slow.filters.rate_hz  # the middle of four samples
        laws = tuple((e, p.where) for p in wanted for e in p.group if isinstance(e, ForceLaw | JointLaw))
        found = self._filtered(*([_Laws(laws, t)] if laws else []), *self._bars).run(moved.motion)
        size = len(self.tares)
        base, left = found.columns[..., :size], found.torque - found.columns[..., :size] @ self.tares
        forces = iter(np.moveaxis(found.columns[..., size : size + len(laws)], -1, 0))
        lasting = [(p, e) for p in wanted for e in p.group if not isinstance(e, Incident)]
        left = np.where(self._lost(moved) if lost is None else np.pad(lost, self._before(lost, left)), np.nan, left)
        tares = self.tares + self._carried(recorded.load, base[late], left[late])
        still = quiet(self.model.machine, values, self.model.filters.rate_hz)
        turning = self.slow.channels.turning(self.thinned(still))
        loaded = RecordedRun(recorded, tares, self._sensitivity(values, tares), turning)
        each = (self._columns(p, e, loaded, base, forces)[late] for p, e in lasting)
        parts = [np.where(np.isfinite(part), part, 0.0) for part in each]
        effects = np.concatenate([np.zeros((*base[late].shape[:2], 0)), *parts], axis=-1)
        if recorded.counts is not None:
            left[late][~recorded.counts[: len(t[late])]] = np.nan
        m = moved.motion
        posture = np.diff(m.a, axis=1, prepend=0.0)
        return GapRows(
            base[late].copy(),  # without the columns that stand beside it
            effects,
            self._incidental(loaded, moved, base)[late],
            left[late],
            found.columns[late, :, size + len(laws) :].copy(),
            t[late],
            m.speed[late],
            m.force[late],
            posture[late],
            turning[late],
        )

    def left(self, recorded: Recorded, lost: NDArray[np.bool_]) -> Array:
        """What is left (T', R) of a recording alone, its known load taken off; `lost` (T'', R): which rows are not
        usable, of as many or more."""
        moving = self.slow.channels.run(self.thinned(recorded.values)).motion
        tares = self.tares + self.model.load[:, 0] * recorded.load
        found = self._filtered().left(moving, tares)[self.slow.settle_steps :]
        return np.where(lost[: len(found)], np.nan, found)

    @staticmethod
    def _before(late: NDArray[np.bool_], whole: Array) -> tuple[tuple[int, int], tuple[int, int]]:
        """What settles before the rows begin."""
        return (len(whole) - len(late), 0), (0, 0)

    def _carried(self, load: float, base: Array, left: Array) -> Array:
        """What a known load [kg] adds to the tares (P,): it matters for what an error of the sensors does. Its moments
        and inertia by least squares of what is left (T, R), every row counted by its rms."""
        if not load:
            return np.zeros_like(self.tares)
        each, good = base @ self.model.load, np.isfinite(left)
        squares = np.sum(np.where(good, left, 0.0) ** 2, axis=0)
        scale = np.sqrt(squares / np.maximum(np.sum(good, axis=0), 1)) + 1e-9
        columns = (each / scale[:, None])[good]
        rest = (left / scale)[good] - columns[:, 0] * load
        prior = np.diag(np.array(CENTRE) ** -2.0)
        moments = np.linalg.solve(columns[:, 1:].T @ columns[:, 1:] + prior, columns[:, 1:].T @ rest)
        return np.asarray(self.model.load @ np.array([load, *moments]))

    def _incidental(self, loaded: RecordedRun, moved: Moved, base: Array) -> Array:
        """Columns (T', R, I) of incidents; a slew that is measured is none."""
        machine, f = self.model.machine, self.slow.filters
        turning = moved.motion._replace(slew=np.ones_like(moved.motion.slew))
        plain = Regressor(machine, (TipForce(), Slew()))
        found = FilteredRegressor(plain, 1.0 / f.rate_hz, f.regressor_hz, f.smoothing_hz).run(turning).columns
        known = dict(zip((p.name for p in self.model.parameters), loaded.tares.tolist(), strict=True))
        slew = found[..., 3:] @ np.array([known.get(name, 0.0) for name in plain.names[3:]])
        dead = np.abs(moved.motion.slew) < DEAD_SLEW
        local = np.concatenate([found[..., :2], (slew * dead[:, None])[..., None]], axis=-1)
        steps = np.arange(len(base)) - self.slow.settle_steps
        within = shapes((steps % BLOCK + 0.5) / BLOCK)
        shaped = [local * shape[:, None, None] for shape in within]
        alone = np.eye(len(machine.rows))[None, :, :, None] * within.T[:, None, None, :]
        torques = alone.reshape(*alone.shape[:2], -1)  # (T, R, R SHAPES), joint by joint
        return np.concatenate([base @ self.model.load, self._late(loaded), *shaped, torques], axis=-1)

    def _late(self, loaded: RecordedRun) -> Array:
        """What all pressures' being late by a second would leave (T', R, 1), from a hundredth of it."""
        step, t = 0.01, np.arange(len(loaded.recorded.values)) / self.model.filters.rate_hz
        pressures = [k for _, k in places(self.model.machine, Place.PRESSURE)]

        def shifted(by: float) -> Array:
            values = loaded.recorded.values.copy()
            for k in pressures:
                values[:, k] = np.interp(t - by, t, loaded.recorded.values[:, k])
            return values

        return np.asarray(loaded.change.of_readings(shifted(step), shifted(-step))[..., None] / (2.0 * step))

    def _lost(self, moved: Moved) -> NDArray[np.bool_]:
        share = self.slow.share_at_rest(self.slow.filtered.run(moved.motion).columns)
        return np.asarray(np.logical_or(unusable(self.slow, moved), share > REST_SHARE))

    def _columns(self, p: Proposal, effect: Fault, loaded: RecordedRun, base: Array, forces: Iterator[Array]) -> Array:
        """Columns (T', R, M) of one effect at its place."""
        if isinstance(effect, ForceLaw | JointLaw):
            return next(forces)[..., None]
        if isinstance(effect, MassChange):
            t = self._times(loaded, base)
            grown = effect.grown(t)[:, None, None] if isinstance(effect, GrowingMass) else np.ones(1)
            rigid = base[..., : 3 * self.model.machine.size]
            return np.asarray(rigid @ effect.change(self.model.machine, p.where) * grown)
        if isinstance(effect, Share):
            return self._known_friction(p, effect, base, self._times(loaded, base))
        if isinstance(effect, BaseMotion):
            return self._base_motion(effect, loaded)
        return self._difference(p, effect, loaded)

    def _known_friction(self, p: Proposal, effect: Share, base: Array, t: Array) -> Array:
        cylinders = self.model.machine.cylinders
        own = [cylinders[c].name for c in rubbing(effect, p.where, len(cylinders))]
        names = [f"{name}.{law}" for name in own for law in effect.laws]
        chosen = [k for k, parameter in enumerate(self.model.parameters) if parameter.name in names]
        return np.asarray((base[..., chosen] @ self.tares[chosen] * effect.course(t)[:, None])[..., None])

    def _times(self, loaded: RecordedRun, base: Array) -> Array:
        """Times (T',) [s] of a recording's rows since its start."""
        return np.asarray(loaded.recorded.begins + (np.arange(len(base)) - 0.5) / self.slow.filters.rate_hz)

    def _base_motion(self, effect: BaseMotion, loaded: RecordedRun) -> Array:
        """Columns (T', R, M) of a base that moves as its pitch tells."""
        f, machine = self.slow.filters, self.model.machine
        carried = Carried(effect, loaded.turning, loaded.tares[: 3 * machine.size].reshape(-1, 3))
        plain = FilteredRegressor(Regressor(machine, (carried,)), 1.0 / f.rate_hz, f.regressor_hz, f.smoothing_hz)
        return plain.run(loaded.change.motion).columns

    def _difference(self, p: Proposal, effect: Fault, loaded: RecordedRun) -> Array:
        """Change of what is left with the size, by central difference: measured = true + error, so that an error of
        the readings adds what distorting them once more adds, an error of the machine file what the true machine
        takes off."""
        step = np.sqrt(effect.about.low * effect.about.high)
        machine, values = self.model.machine, loaded.recorded.values
        if isinstance(effect, Distortion):
            t = loaded.recorded.begins + np.arange(len(values)) / self.model.filters.rate_hz
            read = [effect.distorted(self.weighed, values, t, p.where, s * step) for s in (1.0, -1.0)]
            found = loaded.change.of_readings(*read)
        elif isinstance(effect, Alteration):
            true = [effect.altered(machine, p.where, s * step) for s in (-1.0, 1.0)]
            found = loaded.change.of_machines(*true)
        else:
            raise TypeError(f"{effect!r} is no force law, distortion, alteration or weight")
        return np.asarray(found[..., None] / (2.0 * step))
