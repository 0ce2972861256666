"""The healthy machine, with which a diagnosis compares recordings.

Recordings of the healthy machine (references), recordings of the user's own simulator, an identification and a data
sheet are four sources of the same object. It holds parameters and columns with mean and covariance, the noise floor,
the level of the model discrepancy, the run-to-run variation, and the sensor noise of a healthy machine.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from cylforce.diagnosis.constants import CREEP_CHANGE, DETECTABLE, SAME_MACHINE, STATIC_CHANGE, VARYING_CHANGE
from cylforce.diagnosis.likelihood import (
    Form,
    Likelihood,
    MachineKnowledge,
    ResidualNoise,
    largest_discrepancy,
    settled_noise,
)
from cylforce.diagnosis.regressors import (
    BARS,
    CLOCK_COLUMN,
    Regressors,
    ReturnLaw,
    TorqueRows,
    return_laws,
    typical_incidents,
)
from cylforce.diagnosis.statistics import Blocks, Gram, Mask, NoiseFloor, SharedNoise, in_blocks, rms
from cylforce.effects.fault import INCIDENTAL, SHAPES, TORQUES, BaseMotion, Place, RunToRun, TimeCourse
from cylforce.effects.incidents.payload_spill import PayloadSpill
from cylforce.effects.library import Proposal
from cylforce.effects.loads.rocker_weight import RockerWeight
from cylforce.effects.loads.tip_force import TipForce
from cylforce.estimation.model import Model
from cylforce.readings.constants import BLOCK_ROWS, LOAD_CENTRE
from cylforce.readings.recording import Recording
from cylforce.signals.estimate import Array
from cylforce.signals.parallel import ParallelMap, sequential_map

GROWTH_S = 100.0  # s in which a clock that drifts becomes late by the second of its sizes
CENTRE = len(LOAD_CENTRE)
FOLDS = 4  # parts of the references, each predicted from the others
FRICTION_MAGNITUDES = ("coulomb", "viscous", "load_dependent")  # laws with one magnitude for both directions
FIRST_GUESS = 0.1  # of the torque's rms: noise in the first round
NOISE_S = 120.0  # s of each recording on which shared sensor noise is simulated
STEADY_BASE = 5e-4  # rad/s, rms: apparent rate of a base at rest; physics: noise of inclinometers, filtered
FEWEST_REFERENCES = 2  # recordings, from which on the run-to-run variation is learnt
VARIATION_TIMES = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # factors on the stated variation; a factor of two is one sigma
PRIOR_SHARES = (1.0, 0.5, 0.25, 0.125, 0.06)  # factors on the healthy spread of effects that are tried
UNSEEN_WIDTH = 3.0  # factor on the spread of a noise that no reference shows
RUN_TO_RUN_CHANGE = {  # run-to-run variation, in least plausible magnitudes
    RunToRun.STATIC: STATIC_CHANGE,
    RunToRun.VARYING: VARYING_CHANGE,
    RunToRun.CREEP: CREEP_CHANGE,
    RunToRun.EACH_START: VARYING_CHANGE,
}
LEARNT = (RunToRun.VARYING, RunToRun.CREEP)  # kinds of variation that references of one day show
PHASE = 6.0**-0.5  # of a sampling period: standard deviation of the difference of the ages of two readings (uniform)


class KnowledgeSource(StrEnum):
    """Source of the statistics of a healthy machine."""

    REFERENCES = "recordings of the healthy machine"
    SIMULATION = "recordings of a simulation"
    IDENTIFICATION = "an identification"
    DATA_SHEET = "a data sheet"

    @property
    def has_temperature(self) -> bool:
        """Whether oil and sensors had a temperature: not those of a simulation and of a data sheet."""
        return self in (KnowledgeSource.REFERENCES, KnowledgeSource.IDENTIFICATION)


@dataclass(frozen=True)
class ColumnLayout:
    """Order of the columns: [parameters | bars | effects | clock, growth of the clock], K in all, then incidental ones.

    model:      the machine's model
    proposals:  all effects that may be a cause, at their locations, in their forms
    base_moves: whether the base of the healthy machine moves
    """

    model: Model
    proposals: tuple[Proposal, ...]
    base_moves: bool = False

    @cached_property
    def first(self) -> int:
        """Number of the first effect's column."""
        bars = 0 if "rocker" in self.model.friction else len(RockerWeight().parameters(self.model.machine))
        return len(self.model.parameters) + bars

    @cached_property
    def clock(self) -> int:
        """Number of the clock's column; its growth follows."""
        return self.first + sum(len(p.usual) for p in self.proposals)

    @property
    def size(self) -> int:
        """K, number of the lasting columns."""
        return self.clock + 2

    @property
    def width(self) -> int:
        """K+I+1, number of the lasting and incidental columns and the residual."""
        return self.size + len(self.typical) + 1

    @cached_property
    def places(self) -> tuple[tuple[int, ...], ...]:
        """Columns of each proposal: numbers below K if it lasts, from K on of an incident, () of a change of load."""
        found, k = list[tuple[int, ...]](), self.first
        for p in self.proposals:
            if p.course is TimeCourse.CLOCK:
                found.append((self.clock, self.clock + 1))
            elif p.course is TimeCourse.AFTER:
                found.append(())
            elif p.course is TimeCourse.WINDOWS:
                found.append(self.incident(p))
            else:
                found.append(tuple(range(k, k + len(p.usual))))
                k += len(p.usual)
        return tuple(found)

    def incident(self, p: Proposal) -> tuple[int, ...]:
        """Return the incidental columns (from K on) of an incident."""
        if p.incidents == TORQUES:
            first = self.size + len(INCIDENTAL) + SHAPES * self.model.machine.rows.index(p.where)
            return tuple(range(first, first + SHAPES))
        return tuple(self.size + INCIDENTAL.index(name) for name in p.incidents)

    @cached_property
    def typical(self) -> Array:
        """Typical sizes (I,) of the incidental columns."""
        return typical_incidents(self.model.machine)

    @cached_property
    def unit(self) -> Array:
        """Typical sizes (K,) of the columns, the units of all computations."""
        known = np.sqrt(np.diag(self.model.prior.covariance))
        effects = [size for p in self.proposals for size in p.usual]
        clock = [self.typical[CLOCK_COLUMN]] * 2
        return np.concatenate([known, np.full(self.first - len(known), BARS), effects, clock])

    @cached_property
    def healthy(self) -> Array:
        """Standard deviations (K,) of the columns on healthy machines, in units of their typical sizes."""
        effects = []
        for p in self.proposals:
            moving = self.base_moves and isinstance(p.group[0], BaseMotion)
            effects += list(p.usual if moving else p.unnoticed)
        clock = next((p.about.low for p in self.proposals if p.clock), 1e-6 * self.typical[CLOCK_COLUMN])
        return np.concatenate([self.unit[: self.first], effects, [clock, clock]]) / self.unit

    @cached_property
    def static(self) -> Mask:
        """True where columns (K,) are errors of sensors, geometry or masses, which do not change from run to run."""
        found = np.zeros(self.size, dtype=np.bool_)
        for p, columns in zip(self.proposals, self.places, strict=True):
            if not p.course and p.about.varies not in LEARNT and (p.bends or p.weighs):
                found[list(columns)] = True
        return found

    @cached_property
    def mechanical(self) -> list[int]:
        """Columns of the machine that contain no reading: parameters, bars, each law of friction once.

        Columns of sensors contain the readings, noise included: least squares would cancel noise with noise.
        """
        seen, found = set[tuple[str, str]](), [*range(self.first)]
        for p, columns in zip(self.proposals, self.places, strict=True):
            if p.rubs and not p.course and (p.name, p.at) not in seen:
                seen.add((p.name, p.at))
                found += columns
        return found

    def columns(self, rows: TorqueRows, recording: Recording) -> Array:
        """Return [K columns | incidental | residual] (T, R, K+I+1) of a recording, the mass of its known load
        subtracted.
        """
        residual = rows.residual
        if recording.load_kg:
            residual = residual - (rows.base @ self.model.load[:, 0]) * recording.load_kg
        clock = rows.incidental[..., [CLOCK_COLUMN]]
        growth = clock * (rows.t / GROWTH_S)[:, None, None]
        parts = (rows.base, rows.bars, rows.effects, clock, growth, rows.incidental, residual[..., None])
        return np.concatenate(parts, axis=-1)

    def largest(self, p: Proposal, dry: Array | None) -> float:
        """Return the largest plausible magnitude of an effect.

        dry: (C,) modelled dry friction [N] of the cylinders; None without a Coulomb law
        """
        if p.of_dry and dry is not None:
            return min(p.of_dry * float(dry[p.where]), p.about.high)
        return p.about.high


@dataclass(frozen=True)
class Seen:
    """Recording with its rows.

    recording: the recording
    rows:      its rows
    blocks:    [K columns | incidental | residual], whitened
    added:     change of the first blocks from sensor noise that is added to the readings
    twin:      (T', S) first samples with that noise
    """

    recording: Recording
    rows: TorqueRows
    blocks: Blocks
    added: Blocks
    twin: Array

    def shared(self, columns: Sequence[int]) -> SharedNoise:
        """Return the sensor noise that columns share with the residual."""
        return SharedNoise.of(self.added, columns)


@dataclass(frozen=True)
class HealthyMachine:
    """Statistics of a healthy machine; the argument of every diagnosis.

    regressors:    model and parameters
    layout:        order of the columns
    source:        source of the statistics
    floor:         noise floor of each joint
    known:         (R,) whether the source shows the floor of this joint
    machine:       mean, covariance and run-to-run variation of the columns, noise of the residual
    values:        (K,) columns of the machine by least squares, in SI units: they define the reported residual
    floor_seen:    (B, R) mean squares of the references' blocks that were fitted [N^2 m^2]
    floor_unseen:  (B, R) mean squares of the blocks, each fold predicted from the others [N^2 m^2]
    regimes:       (regimes, R) rms by regime, predicted likewise [N m]; None without references
    sensor_noise:  (S,) white noise of every sensor; NaN of a sensor without a figure
    base_rate:     rms rate of the base [rad/s]
    references:    number of recordings
    loaded:        whether one of them has a known load
    returns:       laws of the return pressures, by signal
    """

    regressors: Regressors
    layout: ColumnLayout
    source: KnowledgeSource
    floor: NoiseFloor
    known: Mask
    machine: MachineKnowledge
    values: Array
    floor_seen: Array
    floor_unseen: Array
    regimes: Array | None
    sensor_noise: Array
    base_rate: float
    references: int
    loaded: bool = False
    returns: dict[int, ReturnLaw] = field(default_factory=dict)

    @property
    def spread(self) -> float:
        """Energy by which two of its recordings may differ at the worst joint, in squared floors."""
        return float(np.max(self.spread_of_joints))

    @cached_property
    def spread_of_joints(self) -> Array:
        """Energy (R,) by which two of its recordings may differ, in squared floors.

        At least that of any two recordings of a healthy machine; more where a part of its own recordings leaves
        more, each block predicted from others: one minute of strokes does not predict other motion.
        """
        floors = np.where(self.known & (self.floor.rms > 0.0), self.floor.rms**2, np.inf)
        parts = [np.ma.masked_invalid(part / floors).mean(axis=0) for part in np.array_split(self.floor_unseen, FOLDS)]
        return np.asarray(np.maximum(SAME_MACHINE, np.max(np.ma.stack(parts).filled(0.0), axis=0) - 1.0))


def fitted_parameters(model: Model, recordings: Sequence[Recording]) -> Array:
    """Return the parameters (P,) of recordings by least squares, the data sheet as prior.

    Friction opposes motion: its magnitudes are at least zero. Each row is weighted by the residual of the first round.
    The centres of known loads are fitted with the parameters.
    """
    regressors, count = Regressors(model, np.zeros(len(model.parameters))), len(model.parameters)
    layout = ColumnLayout(model, ())
    columns, size = [], layout.size
    for k, each in enumerate(recordings):
        whole = layout.columns(regressors.rows(each, ()), each)
        centre = np.zeros((*whole.shape[:2], CENTRE * len(recordings)))
        if each.load_kg:
            centre[..., CENTRE * k : CENTRE * (k + 1)] = whole[..., size + 1 : size + 1 + CENTRE]
        columns.append(np.concatenate([whole[..., :count], centre, whole[..., -1:]], axis=-1))
    prior = np.diag(np.concatenate([layout.unit[:count], np.tile(LOAD_CENTRE, len(recordings))]) ** -2.0)
    prior[:count, :count] = np.linalg.inv(model.prior.covariance)
    mean = np.zeros(len(prior))
    mean[:count] = model.prior.mean
    least = np.full(len(prior), -np.inf)
    least[[k for k, p in enumerate(model.parameters) if p.name.rpartition(".")[2] in FRICTION_MAGNITUDES]] = 0.0
    scale = FIRST_GUESS * rms([c[..., -1] for c in columns]) + 1e-9
    values: Array = mean
    for _ in range(2):
        gram = _weighted_gram(columns, scale)
        root, unit = np.linalg.cholesky(gram[:-1, :-1] + prior), np.diag(prior) ** -0.5
        target = np.linalg.solve(root, gram[:-1, -1] + prior @ mean)
        values = unit * lsq_linear(root.T * unit, target, (least, np.inf)).x
        scale = rms([c[..., -1] - c[..., :-1] @ values for c in columns]) + 1e-9
    return np.asarray(values[:count])


def _weighted_gram(columns: Sequence[Array], scale: Array) -> Array:
    """Return the Gram matrix (K+1, K+1) of columns (T, R, K+1), each joint in units of its scale (R,)."""
    found = np.zeros((columns[0].shape[-1], columns[0].shape[-1]))
    for each in columns:
        for r in range(each.shape[1]):
            rows = each[np.all(np.isfinite(each[:, r]), axis=1), r] / scale[r]
            found += rows.T @ rows
    return found


# Learning from recordings


@dataclass(frozen=True)
class _Least:
    """Least squares of the mechanical columns, for the reported residual and the noise floor.

    values: (K,) in SI units
    seen:   residuals (T, R) of each recording, all recordings fitted
    unseen: residuals (T, R), each fold predicted from the others
    """

    values: Array
    seen: list[Array]
    unseen: list[Array]


def _least_squares(layout: ColumnLayout, columns: Sequence[Array], loads: Sequence[bool], scale: Array) -> _Least:
    """Fit the mechanical columns and the centres of known loads to recordings (T, R, K+I+1)."""
    own, extra = layout.mechanical, [k for k, loaded in enumerate(loads) if loaded]
    parts = []
    for k, whole in enumerate(columns):
        centre = np.zeros((*whole.shape[:2], CENTRE * len(extra)))
        if k in extra:
            at = CENTRE * extra.index(k)
            centre[..., at : at + CENTRE] = whole[..., layout.size + 1 : layout.size + 1 + CENTRE]
        parts.append(np.concatenate([whole[..., own], centre, whole[..., -1:]], axis=-1))
    spread = np.concatenate([(layout.healthy * layout.unit)[own], np.tile(LOAD_CENTRE, len(extra))])
    blocks = [-(-len(p) // BLOCK_ROWS) for p in parts]
    fold = np.split(np.arange(sum(blocks)) * 4 * FOLDS // max(sum(blocks), 1) % FOLDS, np.cumsum(blocks)[:-1])
    folds = [np.repeat(f, BLOCK_ROWS)[: len(p)] for f, p in zip(fold, parts, strict=True)]
    grams = [_weighted_gram([p[f == k] for p, f in zip(parts, folds, strict=True)], scale) for k in range(FOLDS)]

    def solved(gram: Array) -> Array:
        return np.append(-np.linalg.solve(gram[:-1, :-1] + np.diag(spread**-2.0), gram[:-1, -1]), 1.0)

    whole, total = solved(np.sum(grams, axis=0)), np.sum(grams, axis=0)
    seen = [p @ whole for p in parts]
    unseen = [np.full_like(e, np.nan) for e in seen]
    for k in range(FOLDS):
        other = solved(total - grams[k])
        for e, p, f in zip(unseen, parts, folds, strict=True):
            e[f == k] = p[f == k] @ other
    values = np.zeros(layout.size)
    values[own] = -whole[: len(own)]
    return _Least(values, seen, unseen)


def learnt(
    regressors: Regressors,
    proposals: tuple[Proposal, ...],
    recordings: Sequence[Recording],
    sensor_noise: Array,
    rng: np.random.Generator,
    source: KnowledgeSource = KnowledgeSource.REFERENCES,
    shares: Sequence[float] = PRIOR_SHARES,
    parallel_map: ParallelMap = sequential_map,
) -> HealthyMachine:
    """Learn a healthy machine from its recordings.

    sensor_noise: (S,) white noise of every sensor, which columns and residual share
    shares:       factors on the healthy spread of effects that are tried
    parallel_map: maps a function, perhaps in parallel
    """
    twins = [noisy_twin(each, regressors, sensor_noise, rng) for each in recordings]
    rows = parallel_map(lambda each: regressors.rows(each, proposals), [*recordings, *twins])
    rows, noisy = rows[: len(recordings)], rows[len(recordings) :]
    settle = regressors.slow.settle_steps
    rates = [regressors.base_rate(each.values)[settle:] for each in recordings]
    base_rate = float(np.sqrt(np.mean(np.concatenate(rates) ** 2)))
    layout = ColumnLayout(regressors.model, proposals, base_rate > STEADY_BASE)
    counted = quiet_blocks(layout, rows, recordings)
    rows = [_without_blocks(r, kept) for r, kept in zip(rows, counted, strict=True)]
    columns = [layout.columns(r, each) for r, each in zip(rows, recordings, strict=True)]
    loads = [each.load_kg > 0.0 for each in recordings]
    scale = FIRST_GUESS * rms([c[..., -1] for c in columns]) + 1e-9
    least = _least_squares(layout, columns, loads, scale)
    for _ in range(2):
        floor = NoiseFloor.of(least.seen)
        least = _least_squares(layout, columns, loads, floor.rms)
    floor = NoiseFloor.of(least.seen)
    known = np.sum([np.sum(np.isfinite(e), axis=0) for e in least.seen], axis=0) > 0
    if source is KnowledgeSource.SIMULATION:  # a simulation without noise would make every residual a gap
        floor = _with_sensor_noise(regressors, recordings, rows, floor, sensor_noise, rng)
    own = [*range(layout.size)]
    seen = [with_noise(layout, floor, *each) for each in zip(recordings, rows, twins, noisy, strict=True)]
    grams = _by_recording(layout, seen, own)
    machine = _learnt_machine(layout, grams, regressors.model.filters.rate_hz, shares)
    fitted, predicted = (np.concatenate([_mean_squares(e) for e in each]) for each in (least.seen, least.unseen))
    return HealthyMachine(
        regressors,
        layout,
        source,
        floor,
        known,
        machine,
        least.values,
        fitted,
        predicted,
        regime_rms(layout.model, rows, recordings, least.unseen),
        sensor_noise,
        base_rate,
        len({each.name for each in recordings}),
        any(loads),
        return_laws(
            regressors.model.machine, list(zip(recordings, rows, strict=True)), regressors.model.filters.rate_hz
        ),
    )


def _by_recording(layout: ColumnLayout, seen: Sequence[Seen], own: list[int]) -> list[Gram]:
    """Return one Gram per recording, with columns of its own for the centre of each load.

    These columns are marginalised later by slicing.
    """
    names = list(dict.fromkeys(s.recording.name for s in seen))
    loaded = [name for name in names if any(s.recording.load_kg for s in seen if s.recording.name == name)]
    found = []
    for name in names:
        parts = [gram_with_loads(layout, s, own, loaded) for s in seen if s.recording.name == name]
        found.append(Gram.total(parts))
    return found


def gram_with_loads(
    layout: ColumnLayout, seen: Seen, own: list[int], loaded: Sequence[str], mask: Mask | None = None
) -> Gram:
    """Return the Gram of a recording with columns `own`, then the centre of the load of each loaded recording.

    loaded: names of the loaded recordings
    mask:   blocks (B,) that count; None: all
    """
    blocks = seen.blocks if mask is None else seen.blocks.masked(mask)
    columns, unit = list(own), layout.unit[own]
    centre = [layout.size + k for k in range(1, 1 + CENTRE)]
    rows = blocks.rows[..., [*columns, *centre * len(loaded), -1]]
    for k, name in enumerate(loaded):
        if name != seen.recording.name or not seen.recording.load_kg:
            rows[..., len(columns) + CENTRE * k : len(columns) + CENTRE * (k + 1)] = 0.0
    noise = _padded(seen.shared(columns), len(columns), CENTRE * len(loaded), seen.blocks.usable.shape[2])
    units = np.concatenate([unit, np.tile(LOAD_CENTRE, len(loaded))])
    return Gram.of(Blocks(rows, blocks.usable), range(rows.shape[-1] - 1), units, noise)


def _padded(noise: SharedNoise, own: int, more: int, joints: int) -> SharedNoise:
    """Return the shared noise with further columns that share none."""
    if not len(noise.products):
        return SharedNoise.none(joints, own + more + 1)
    found = np.zeros((*noise.products.shape[:-1], own + more + 1))
    found[..., :own], found[..., -1] = noise.products[..., :-1], noise.products[..., -1]
    return SharedNoise(found, noise.counts)


def noisy_twin(
    recording: Recording, regressors: Regressors, sensor_noise: Array, rng: np.random.Generator
) -> Recording:
    """Return the first NOISE_S of a recording with the sensors' noise (S,) added once more."""
    values = recording.values[: round(NOISE_S * regressors.model.filters.rate_hz)]
    return replace(recording, values=values + sensor_noise * rng.standard_normal(values.shape))


def with_noise(
    layout: ColumnLayout, floor: NoiseFloor, recording: Recording, rows: TorqueRows, twin: Recording, noisy: TorqueRows
) -> Seen:
    """Return a recording with its blocks and the sensor noise that its columns share with the residual.

    The change of the rows by added sensor noise is the noise in both.
    twin:  first samples with that noise
    noisy: its rows
    """
    columns = layout.columns(rows, recording)
    change = layout.columns(noisy, twin) - columns[: len(noisy.t)]
    return Seen(recording, rows, Blocks.whitened(columns, floor), Blocks.whitened(change, floor), twin.values)


def _with_sensor_noise(
    regressors: Regressors,
    recordings: Sequence[Recording],
    rows: Sequence[TorqueRows],
    floor: NoiseFloor,
    sensor_noise: Array,
    rng: np.random.Generator,
) -> NoiseFloor:
    """Return the floor with the sensors' noise added, in the colour of that noise."""
    noise = noise_of_sensors(regressors, recordings, rows, sensor_noise, rng)
    return noise.scaled(np.hypot(noise.rms, floor.rms))


def noise_of_sensors(
    regressors: Regressors,
    recordings: Sequence[Recording],
    rows: Sequence[TorqueRows],
    sensor_noise: Array,
    rng: np.random.Generator,
) -> NoiseFloor:
    """Return the noise of the residual that comes from the sensors' noise alone."""
    changes = []
    for recording, own in zip(recordings, rows, strict=True):
        noisy = regressors.rows(noisy_twin(recording, regressors, sensor_noise, rng), ()).residual
        changes.append(noisy - own.residual[: len(noisy)])
    return NoiseFloor.of(changes)


def _mean_squares(residual: Array) -> Array:
    """Return the mean squares (B, R) of the blocks of a residual (T, R); NaN where a block has no rows."""
    good = in_blocks(np.isfinite(residual))
    counts = good.sum(axis=1)
    energy = np.sum(in_blocks(np.where(np.isfinite(residual), residual, 0.0)) ** 2, axis=1)
    return np.where(counts > 0, energy / np.maximum(counts, 1), np.nan)


mean_squares = _mean_squares


def _learnt_machine(
    layout: ColumnLayout, grams: Sequence[Gram], rate_hz: float, shares: Sequence[float]
) -> MachineKnowledge:
    """Return the statistics of the columns from recordings.

    Empirical Bayes: the healthy spread of effects is multiplied by the share that makes the recordings most probable,
    first of errors of sensors, geometry and masses, then of laws of force.
    """
    size, total = layout.size, Gram.total(grams)
    more = np.ones(total.whole.shape[-1] - 1 - size)
    effects = np.arange(size) >= layout.first
    healthy = np.concatenate([layout.healthy, more])
    best = (*_posterior_of(total, healthy), healthy)
    for group in (layout.static, effects & ~layout.static):
        before = best[4]
        for share in shares[1:]:
            trial = before * np.concatenate([np.where(group, share, 1.0), more])
            fit = (*_posterior_of(total, trial), trial)
            if fit[3] <= best[3]:
                break
            best = fit
    noise, mean, covariance, _, healthy = best
    variation = _stated_variation(layout, rate_hz)
    covariance = _unsure_signs(forms_of(layout), layout.unit, mean[:size], covariance[:size, :size])
    found = MachineKnowledge(mean[:size], covariance, variation, noise)
    if len(grams) >= FEWEST_REFERENCES:
        found = replace(found, variation=_learnt_variation(layout, grams, healthy, variation))
    return found


def _posterior_of(total: Gram, healthy: Array) -> tuple[ResidualNoise, Array, Array, float]:
    """Return noise, mean (K,), covariance (K, K) and log evidence of recordings.

    healthy: (K,) prior standard deviations of the columns
    """
    joints = len(total.rows)
    noise, precision = ResidualNoise(np.ones(joints), np.ones(joints)), healthy**-2.0
    mean, covariance = np.zeros(len(healthy)), np.diag(healthy**2)
    energies = np.zeros(joints), np.zeros((joints, total.smooth.shape[1]))
    for _ in range(6):
        information, (shared, unsure) = noise.information(total), noise.shared(total)
        covariance, mean = _posterior(information[:-1, :-1], information[:-1, -1] - shared, unsure, precision)
        energies = total.energies(np.append(-mean, 1.0), covariance)
        noise = _where_shown(settled_noise(total, energies, None), total.rows)
    level = np.where(total.rows > 0.0, largest_discrepancy(total, *energies), noise.discrepancy)
    machine = MachineKnowledge(np.zeros(len(healthy)), np.diag(healthy**2), np.zeros(len(healthy)), noise)
    case = Likelihood(total, np.ones(len(healthy)), (), machine)
    return replace(noise, discrepancy=level), mean, covariance, case.state(noise).log


def _posterior(information: Array, score: Array, unsure: Array, precision: Array) -> tuple[Array, Array]:
    """Return covariance (K, K) and mean (K,) of sizes with prior precision (K,).

    The uncertainty of the score beyond the noise has samples `unsure` (S, K), of covariance V: the information I
    becomes I (I + V)^-1 I.
    """
    unit = precision**-0.5
    values, vectors = np.linalg.eigh(information * np.outer(unit, unit))
    root = np.sqrt(np.maximum(values, 0.0))
    back = np.where(values > 1e-6, 1.0 / np.maximum(root, 1e-6), 0.0)
    samples = (unsure * unit) @ vectors * back
    less = np.linalg.inv(np.eye(len(unit)) + samples.T @ samples)
    known = vectors * root
    covariance = np.linalg.inv(np.eye(len(unit)) + known @ less @ known.T)
    mean = covariance @ (known @ (less @ (back * (vectors.T @ (score * unit)))))
    return np.asarray(covariance * np.outer(unit, unit)), np.asarray(mean * unit)


def _where_shown(noise: ResidualNoise, rows: Array) -> ResidualNoise:
    """Return the noise, with a wide prior for joints (R,) that move in no reference."""
    shown = rows > 0.0
    return ResidualNoise(
        np.where(shown, noise.discrepancy, 1.0), np.where(shown, noise.white, 1.0), np.where(shown, 1.0, UNSEEN_WIDTH)
    )


def forms_of(layout: ColumnLayout, dry: Array | None = None) -> tuple[Form, ...]:
    """Return one form of each lasting proposal; the search adds the columns () of a change of load."""
    found = []
    for p, columns in zip(layout.proposals, layout.places, strict=True):
        if p.course is TimeCourse.WINDOWS:
            continue
        found.append(form_of(layout, p, columns, dry))
    return tuple(found)


def form_of(layout: ColumnLayout, p: Proposal, columns: tuple[int, ...], dry: Array | None = None) -> Form:
    """Return the form of a proposal with its columns."""
    about, high = p.about, max(layout.largest(p, dry), p.about.low)
    return Form(p.name, p.at, columns, about.low, high, about.sign, about.axes, p.bends, about.form, about.torque_error)


def lasting(layout: ColumnLayout) -> list[Proposal]:
    """Return the proposals of `forms_of`, in its order."""
    return [p for p in layout.proposals if p.course is not TimeCourse.WINDOWS]


def _stated_variation(layout: ColumnLayout, rate_hz: float) -> Array:
    """Return the run-to-run variation (K,) from constants of the effects' physics."""
    found = np.zeros(layout.size)
    for p, columns in zip(layout.proposals, layout.places, strict=True):
        if p.course is TimeCourse.WINDOWS or not columns:
            continue
        own, change = list(columns), RUN_TO_RUN_CHANGE[p.about.varies]
        if p.about.varies is RunToRun.EACH_START:
            change = max(change, PHASE / rate_hz / p.about.low)
        found[own] = np.maximum(found[own], change * p.about.low / layout.unit[own[0]])
    if layout.base_moves:  # another slope, another stiffness of the ground
        for p, columns in zip(layout.proposals, layout.places, strict=True):
            if isinstance(p.group[0], BaseMotion):
                found[list(columns)] = 1.0
    return found


def _unsure_signs(forms: Sequence[Form], unit: Array, mean: Array, covariance: Array) -> Array:
    """Return the covariance, increased by the square of errors that references show with an impossible sign.

    A sensor with a negative latency indicates another cause, such as a law of friction that is not modelled.
    """
    groups: dict[tuple[str, str, int], set[int]] = {}
    for form in forms:
        if form.sensor and form.sign:
            groups.setdefault((form.name, form.at, form.sign), set()).update(form.columns)
    found, sizes = covariance.copy(), unit * mean
    for (*_, sign), columns in groups.items():
        own = sorted(columns)
        if sign * np.sum(sizes[own]) < 0.0:
            found[np.ix_(own, own)] += np.outer(mean[own], mean[own])
    return found


def _learnt_variation(layout: ColumnLayout, grams: Sequence[Gram], healthy: Array, stated: Array) -> Array:
    """Return the run-to-run variation (K,) that makes each recording most probable given the others.

    Friction, creep and pressure zeros vary by their nature. The factor of each is chosen by itself, in this order:
    friction that differs between two motions does not imply that zeros differ. Geometry, masses and gains do not vary:
    where they seem to, recordings of different motion predict each other badly by model error.
    """
    fits = [_posterior_of(Gram.total([g for j, g in enumerate(grams) if j != k]), healthy) for k in range(len(grams))]
    more, found = np.zeros(len(healthy) - layout.size), stated

    def log_probability(variation: Array) -> float:
        log = 0.0
        for gram, (noise, mean, covariance, _) in zip(grams, fits, strict=True):
            knowledge = MachineKnowledge(mean, covariance, np.append(variation, more), noise)
            log += Likelihood(gram, np.ones(len(healthy)), (), knowledge).hypothesis((), noise).log
        return log

    for varying in _varying(layout):
        trials = [np.where(varying, times * stated, found) for times in VARIATION_TIMES]
        logs = [log_probability(v) - 0.5 * np.log2(t) ** 2 for v, t in zip(trials, VARIATION_TIMES, strict=True)]
        found = trials[int(np.argmax(logs))]
    return found


def _varying(layout: ColumnLayout) -> list[Mask]:
    """Return the columns (K,) of friction, of creep and of pressure zeros, the quantities that vary from run to run."""
    friction, creep, zeros = (np.zeros(layout.size, dtype=np.bool_) for _ in range(3))
    for p, columns in zip(layout.proposals, layout.places, strict=True):
        if p.course is TimeCourse.WINDOWS or p.about.varies not in LEARNT:
            continue
        if p.about.varies is RunToRun.CREEP:
            creep[list(columns)] = True
        elif p.about.place is Place.PRESSURE:
            zeros[list(columns)] = True
        else:
            friction[list(columns)] = True
    return [friction, creep, zeros]


# From an identification


def identified(
    regressors: Regressors,
    proposals: tuple[Proposal, ...],
    covariance: Array,
    unexplained: Array,
    field: Sequence[Recording],
    sensor_noise: Array,
    rng: np.random.Generator,
) -> HealthyMachine:
    """Return the healthy machine of an identification without statistics of its recordings.

    The noise floor has the rms of the identification's residual. Its colour is that of the sensors' noise, filtered as
    the field recording: a fit to the field recording would whiten the fault away.
    covariance:  (P, P) of the parameters
    unexplained: (R,) residual torque [N m, rms]
    """
    layout = ColumnLayout(regressors.model, proposals)
    rows = [regressors.rows(each, ()) for each in field]
    floor = noise_of_sensors(regressors, field, rows, sensor_noise, rng).scaled(unexplained)
    count, joints = len(covariance), len(unexplained)
    known = np.zeros(layout.size)
    known[: layout.first] = layout.healthy[: layout.first] ** 2
    whole = np.diag(known)
    whole[:count, :count] = covariance / np.outer(layout.unit[:count], layout.unit[:count])
    noise = ResidualNoise(np.ones(joints), np.ones(joints), np.full(joints, UNSEEN_WIDTH))
    variation = _stated_variation(layout, regressors.model.filters.rate_hz)
    machine = MachineKnowledge(np.zeros(layout.size), whole, variation, noise)
    squares = np.tile(unexplained**2, (FOLDS, 1))
    return HealthyMachine(
        regressors,
        layout,
        KnowledgeSource.IDENTIFICATION,
        floor,
        np.ones(joints, dtype=np.bool_),
        machine,
        np.zeros(layout.size),
        squares,
        squares,
        None,
        sensor_noise,
        0.0,
        0,
    )


# Changes of the statistics


def with_proposals(machine: HealthyMachine, more: Sequence[Proposal]) -> HealthyMachine:
    """Return a healthy machine with further effects that its recordings do not show, such as the jumps of a reading."""
    old, whole = machine.layout, machine.machine
    if not more:
        return machine
    layout = replace(old, proposals=(*old.proposals, *more))
    new = range(old.clock, layout.clock)
    at, zeros = [old.clock] * len(new), np.zeros(len(new))
    mean = np.insert(whole.mean, at, zeros)
    covariance = np.insert(np.insert(whole.covariance, at, 0.0, axis=0), at, 0.0, axis=1)
    covariance[new, new] = layout.healthy[new] ** 2
    stated = _stated_variation(layout, machine.regressors.model.filters.rate_hz)
    variation = np.insert(whole.variation, at, stated[new])
    known = replace(whole, mean=mean, covariance=covariance, variation=variation)
    return replace(machine, layout=layout, machine=known, values=np.insert(machine.values, at, zeros))


def with_variation(machine: HealthyMachine, everyday: Mapping[str, float]) -> HealthyMachine:
    """Return a healthy machine with another run-to-run variation.

    everyday: variation of effects by name, in least plausible magnitudes
    """
    layout, variation = machine.layout, machine.machine.variation.copy()
    for p, columns in zip(layout.proposals, layout.places, strict=True):
        if p.name in everyday and not p.course:
            variation[list(columns)] = everyday[p.name] * p.about.low / layout.unit[list(columns)]
    return replace(machine, machine=replace(machine.machine, variation=variation))


# Blocks of references in which the machine works


def quiet_blocks(layout: ColumnLayout, rows: Sequence[TorqueRows], recordings: Sequence[Recording]) -> list[Mask]:
    """Return the blocks (B,) of each recording without contact and unknown loads.

    Least trimmed squares (Rousseeuw & Van Driessen 2006): the model's parameters are fitted to the quarter of the
    blocks with the least residual, starting from many single blocks. Then all blocks count in which no plausible load
    or force at the teeth is significant. If no block would remain, all count.
    """
    loaded, blocks = list(dict.fromkeys(each.name for each in recordings if each.load_kg)), []
    for r, each in zip(rows, recordings, strict=True):
        whole = layout.columns(r, each)
        centre = whole[..., layout.size + 1 : layout.size + 1 + CENTRE]
        centres = [centre * float(name == each.name) for name in loaded]
        own = np.concatenate([whole[..., : layout.first], *centres, whole[..., layout.size :]], axis=-1)
        blocks.append(np.asarray(in_blocks(np.where(np.all(np.isfinite(own), axis=-1, keepdims=True), own, 0.0))))
    kept = _Trimmed(layout, len(loaded), np.concatenate(blocks)).kept()
    ends = np.cumsum([len(b) for b in blocks])[:-1]
    return [np.asarray(part) for part in np.split(kept if np.any(kept) else np.ones_like(kept), ends)]


def _without_blocks(rows: TorqueRows, kept: Mask) -> TorqueRows:
    """Return the rows with NaN residuals in the blocks (B,) that are not kept."""
    on = np.repeat(kept, BLOCK_ROWS)[: len(rows.t)]
    return replace(rows, residual=np.where(on[:, None], rows.residual, np.nan))


QUIET_SHARE = (
    0.25  # of the rows, with which the search begins: so much of its time a digging machine is empty (physics)
)
STARTS = 64  # single blocks from which the search begins, at most
TRIM_ROUNDS = 20


@dataclass(frozen=True)
class _Trimmed:
    """Least trimmed squares of blocks.

    layout: order of the columns
    loads:  number of recordings with a known load, each with a centre of its own
    blocks: (B, BLOCK_ROWS, R, P' + I + 1) own columns and centres of loads, incidental columns, the residual
    """

    layout: ColumnLayout
    loads: int
    blocks: Array

    @cached_property
    def _size(self) -> int:
        return self.layout.first + CENTRE * self.loads

    @cached_property
    def _products(self) -> Array:
        own = self.blocks[..., [*range(self._size), -1]]
        return np.asarray(np.einsum("btri,btrj->brij", own, own, optimize=True))

    @cached_property
    def _rows(self) -> Array:
        return np.asarray(np.sum(self.blocks[..., -1] != 0.0, axis=1, dtype=np.float64))

    @cached_property
    def _prior(self) -> Array:
        spread = np.concatenate([self.layout.unit[: self.layout.first], np.tile(LOAD_CENTRE, self.loads)])
        return np.diag(spread**-2.0)

    def kept(self) -> Mask:
        """Return the blocks (B,) that count; blocks without usable rows are included."""
        usable = np.any(self._rows > 0.0, axis=1)
        if not np.any(usable):
            return np.asarray(~usable)
        starts = np.flatnonzero(usable)[:: -(-int(np.sum(usable)) // STARTS)]
        kept, _ = min((self._quietest(np.arange(len(usable)) == s) for s in starts), key=lambda found: found[1])
        for _ in range(TRIM_ROUNDS):
            now = usable & ~self._working(kept)
            if np.array_equal(now, kept) or not np.any(now):
                break
            kept = now
        return np.asarray(kept | ~usable)

    def _fit(self, kept: Mask) -> tuple[Array, Array]:
        """Return values (P',) of some blocks, and their residual, rms (R,); infinite with too few rows."""
        products, rows = self._products[kept].sum(axis=0), self._rows[kept].sum(axis=0)
        rows = np.where(rows > self._size, rows, 0.0)
        scale, values = _root(products[:, -1, -1], rows), np.zeros(self._size)
        for _ in range(2):
            whole = np.einsum("rij,r->ij", products, scale**-2.0)
            values = np.linalg.solve(whole[:-1, :-1] + self._prior, whole[:-1, -1])
            scale = _root(_energy(products, values), rows)
        return values, scale

    def _quietest(self, kept: Mask) -> tuple[Mask, float]:
        """Return the blocks with QUIET_SHARE of the rows and the least residual, and the log of their residual.

        kept: blocks to which the first fit is made
        """
        rows, scale = self._rows.sum(axis=1), np.ones(self._rows.shape[1])
        enough = self._rows.sum(axis=0) > self._size
        for _ in range(TRIM_ROUNDS):
            values, scale = self._fit(kept)
            order = np.argsort(_energy(self._products, values) @ scale**-2.0 / np.where(rows > 0.0, rows, np.nan))
            now = np.zeros_like(kept)
            now[order] = np.cumsum(rows[order]) <= QUIET_SHARE * np.sum(rows)
            if np.array_equal(now, kept) or not np.any(now):
                break
            kept = now
        return kept, float(np.sum(np.log(scale[enough])))

    def _working(self, kept: Mask) -> Mask:
        """Return the blocks (B,) in which a load or a force at the teeth is plausible and significant.

        Significance is relative to the residual and to the uncertainty of the machine fitted to the kept blocks. All
        samples of a block are assumed to have the same error.
        """
        values, scale = self._fit(kept)
        unit, size = scale * np.sqrt(BLOCK_ROWS), self._size
        own = self.blocks[..., :size] / unit[:, None]
        residual = (self.blocks[..., -1] - self.blocks[..., :size] @ values) / unit
        each = np.einsum("brij,r->bij", self._products[..., :-1, :-1], unit**-2.0)
        outside = ~kept[:, None, None]  # these are not in the fit of the machine yet
        whole = each[kept].sum(axis=0) + self._prior + np.where(outside, each, 0.0)
        own_residual = np.where(outside, np.einsum("btri,btr->bi", own, residual, optimize=True)[..., None], 0.0)
        found = np.zeros(len(self.blocks), dtype=np.bool_)
        for columns, magnitude, least in self._disturbances():
            typical = self.layout.typical[columns]
            mine = self.blocks[..., [size + k for k in columns]] * typical / unit[:, None]
            across = np.einsum("btri,btrj->bij", own, mine, optimize=True)
            gram = np.einsum("btri,btrj->bij", mine, mine, optimize=True) + np.eye(len(columns))
            pull = np.einsum("btri,btr->bi", mine, residual, optimize=True)[..., None]
            beside = np.swapaxes(across, 1, 2) @ np.linalg.solve(whole, np.concatenate([across, own_residual], axis=-1))
            gram, pull = gram - beside[..., :-1], pull - beside[..., -1:]
            sizes = np.linalg.solve(gram, pull)
            gain = np.sum(pull * sizes, axis=(1, 2))
            large = np.linalg.norm((sizes[..., 0] * typical)[:, magnitude], axis=1) >= least
            found |= large & (gain >= DETECTABLE**2)
        return found

    @staticmethod
    def _disturbances() -> list[tuple[list[int], slice, float]]:
        """Return the columns of a load and of a tool force, with the slice of the magnitude and its least plausible
        value.
        """
        loads = [INCIDENTAL.index(name) for name in ("load.mass", "load.X", "load.Z")]
        tips = [INCIDENTAL.index(f"tip.{axis}.{k}") for k in range(SHAPES) for axis in "xz"]
        return [(loads, slice(0, 1), PayloadSpill().about.low), (tips, slice(None), TipForce().about.low)]


def _energy(products: Array, values: Array) -> Array:
    """Return the sums of squares (..., R) of the residual with values (P,)."""
    left = np.append(-values, 1.0)
    return np.asarray(np.maximum(products @ left @ left, 0.0))


def _root(squares: Array, rows: Array) -> Array:
    return np.asarray(np.sqrt(np.divide(squares, rows, out=np.full(rows.shape, np.inf), where=rows > 0.0))) + 1e-9


# Regimes


SLOW, FAST = 0.03, 0.10  # m/s
REGIMES = (
    "extending",
    "retracting",
    "slow",
    "fast",
    "empty",
    "loaded",
    "first half",
    "second half",
    "angle low",
    "angle high",
)


def regime(name: str, rows: TorqueRows, recording: Recording, cylinder: int, joint: int) -> Mask:
    """Return the rows (T,) in a regime of a joint and its cylinder."""
    speed, angle = rows.speed[:, cylinder], rows.posture[:, joint]
    loaded = np.full(len(rows.t), recording.load_kg > 0.0)
    found: Mapping[str, NDArray[np.bool_]] = {
        "extending": speed > 0.0,
        "retracting": speed < 0.0,
        "slow": np.abs(speed) < SLOW,
        "fast": np.abs(speed) > FAST,
        "empty": ~loaded,
        "loaded": loaded,
        "first half": rows.t < np.median(rows.t),
        "second half": rows.t >= np.median(rows.t),
        "angle low": angle < np.median(angle),
        "angle high": angle >= np.median(angle),
    }
    return found[name]


def regime_rms(
    model: Model, rows: Sequence[TorqueRows], recordings: Sequence[Recording], residuals: Sequence[Array]
) -> Array:
    """Return the rms (regimes, R) [N m] of residuals (T, R) by regime; NaN where a regime does not occur."""
    found = np.full((len(REGIMES), len(model.machine.rows)), np.nan)
    for k, name in enumerate(REGIMES):
        for r, joint in enumerate(model.machine.rows):
            parts = [
                e[regime(name, own, each, model.acting[r][0], joint), r]
                for own, each, e in zip(rows, recordings, residuals, strict=True)
            ]
            values = np.concatenate(parts)
            values = values[np.isfinite(values)]
            if len(values):
                found[k, r] = float(np.sqrt(np.mean(values**2)))
    return found
