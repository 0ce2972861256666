"""Residual torque of joints for shifted clocks: some pressures run on another clock than the angles.

Masses and friction are fitted anew for every clock, with the data sheet and its tolerances as prior. Each row is
weighted by its fit on one clock (errors of Cauchy's distribution): a load or a contact makes some rows fit badly,
two clocks nearly all.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from cylforce.effects.fault import Place, places
from cylforce.estimation.filters import fours, mean
from cylforce.estimation.model import Model
from cylforce.readings.constants import BLOCK_ROWS, LOAD_CENTRE, ROWS_HZ
from cylforce.readings.recording import Recording, SlowRows
from cylforce.signals.estimate import Array

LAWS = ("coulomb", "viscous")  # of friction, beside the masses
PIECE_S = 120.0  # of a recording that is examined together, about: it takes a second to compute
EDGE_S = 2.0  # of a piece, at either end, of which only the pressures are used
EVERY_S = 0.4  # a row: the period of the lowest low-pass of a service, 2.5 Hz
BLOCK_S = BLOCK_ROWS / ROWS_HZ  # within which errors are alike
MOVING = 0.9  # least certainty of the friction's direction
ENOUGH_S = 10.0  # of motion of a joint: twice as many rows as parameters
REWEIGHTINGS = 15
SLICE = 500  # clocks at once


@dataclass(frozen=True)
class Clock:
    """Clocks of pressures against motion.

    rate:   (K,) seconds of the pressures' clock per second
    offset: (K,) offset of the pressures' clock [s]
    since:  (K,) time from which on the pressures' clock differs [s]
    """

    rate: Array
    offset: Array
    since: Array

    @property
    def flat(self) -> "Clock":
        """Clocks of a lattice in one row."""
        return Clock(self.rate.ravel(), self.offset.ravel(), self.since.ravel())

    def only(self, k: slice | NDArray[np.intp]) -> "Clock":
        """Return some of the clocks."""
        return Clock(self.rate[k], self.offset[k], self.since[k])

    def shown(self, t: Array) -> Array:
        """Return the times (K, T) [s] at which the pressures of times t (T,) are shown."""
        return np.where(t < self.since[:, None], t, self.rate[:, None] * t + self.offset[:, None])

    def lags(self, first: float, last: float) -> Array:
        """Return the lag of the pressures [s] at two times (K, 2)."""
        ends = np.array([first, last])
        return np.asarray(self.shown(ends) - ends)


@dataclass(frozen=True)
class JointRows:
    """Rows of one joint while it moves, T of them.

    columns:   (T, P) of masses and friction, in standard errors of the data sheet
    known:     (T,) torque of the data sheet less that of other forces than the pressures' [N m]
    levers:    (T, S) torque per pressure, for each pressure sensor of its cylinders [N m/Pa]
    t:         (T,) time since the beginning of the piece [s]
    pressures: (F, S) pressures [Pa], one row per `every`
    every:     period of the pressures [s]
    names:     of the sensors
    """

    columns: Array
    known: Array
    levers: Array
    t: Array
    pressures: Array
    every: float
    names: tuple[str, ...]

    @property
    def ends(self) -> float:
        """Last time [s] with a pressure."""
        return (len(self.pressures) - 1) * self.every

    def rows(self, clock: Clock) -> NDArray[np.intp]:
        """Return the number (K,) of rows, from the first on, that have a pressure on each clock."""
        return np.searchsorted(self.t, (self.ends - clock.offset) / clock.rate, side="right")

    @cached_property
    def choices(self) -> tuple[tuple[int, ...], ...]:
        """Sets of sensors that may be on another clock together."""
        each = range(len(self.names))
        return tuple(sensors for n in each for sensors in combinations(each, n + 1))

    def residual(self, sensors: Sequence[int], clock: Clock) -> Array:
        """Return the torque (K, T) [N m] that the columns must explain with some sensors on each clock."""
        return self._residual(sensors, self._changes(sensors, clock))

    def _residual(self, sensors: Sequence[int], changes: Mapping[int, Array]) -> Array:
        found = self._torque - self.known + np.zeros_like(changes[sensors[0]])
        for s in sensors:
            found += changes[s]
        return np.asarray(found)

    def _changes(self, sensors: Sequence[int], clock: Clock) -> dict[int, Array]:
        """Return the change of the torque (K, T) [N m] with each of some sensors on each clock."""
        place = np.clip(clock.shown(self.t) / self.every, 0.0, len(self.pressures) - 1.001)
        first = place.astype(np.intp)
        share, found = place - first, dict[int, Array]()
        for s in sensors:
            shown = self.pressures[first, s] * (1.0 - share) + self.pressures[first + 1, s] * share
            found[s] = self.levers[:, s] * (shown - self._on_time[:, s])
        return found

    @cached_property
    def _on_time(self) -> Array:
        """Pressures (T, S) of the rows on one clock."""
        at = np.arange(len(self.pressures)) * self.every
        return np.stack([np.interp(self.t, at, pressure) for pressure in self.pressures.T], axis=-1)

    @cached_property
    def _torque(self) -> Array:
        return np.asarray(np.sum(self.levers * self._on_time, axis=1))

    @cached_property
    def noise(self) -> Array:
        """Standard deviation (T,) [N m] of each row on one clock: reweighted least squares with Cauchy's weights."""
        torque, weight = self._torque - self.known, np.ones(len(self.t))
        scale = float(np.median(np.abs(torque))) + 1.0
        for _ in range(REWEIGHTINGS):
            root = np.sqrt(weight) / scale
            columns = self.columns * root[:, None]
            gram = columns.T @ columns + np.eye(columns.shape[1])
            residual = torque - self.columns @ np.linalg.solve(gram, columns.T @ (torque * root))
            weight = 2.0 / (1.0 + (residual / scale) ** 2)
            scale = max(float(np.sqrt(np.mean(weight * residual**2))), 1.0)
        return np.asarray(scale / np.sqrt(weight))

    @cached_property
    def _one_clock(self) -> tuple[Array, Array, Array]:
        """Columns, covariances and energies on one clock.

        Columns (T, P) are of rows of unit noise. The covariance of the parameters (T+1, P, P) and the energy of the
        residual (T+1,) are those of the first 0..T rows.
        """
        columns, torque = self.columns / self.noise[:, None], (self._torque - self.known) / self.noise
        gram, score = running_sums(columns[:, :, None] * columns[:, None]), running_sums(columns * torque[:, None])
        covariance = np.asarray(np.linalg.inv(gram + np.eye(columns.shape[1])), dtype=np.float64)
        energy = running_sums(torque**2) - np.einsum("tp,tpq,tq->t", score, covariance, score)
        return columns, covariance, energy

    def gains(self, choices: Sequence[Sequence[int]], clock: Clock) -> Array:
        """Return the evidence [nats] (C, K) that the sensors of each choice are on each clock."""
        parts = range(0, len(clock.rate), SLICE)
        return np.concatenate([self._gains(choices, clock.only(slice(k, k + SLICE))) for k in parts], axis=1)

    def _gains(self, choices: Sequence[Sequence[int]], clock: Clock) -> Array:
        columns, covariance, one_clock = self._one_clock
        rows, found = self.rows(clock), []
        inside, known = np.arange(len(self.t)) < rows[:, None], covariance[rows]
        changes = self._changes(sorted({s for sensors in choices for s in sensors}), clock)
        for sensors in choices:
            torque = self._residual(sensors, changes) / self.noise * inside
            score = torque @ columns
            energy = np.sum(torque**2, axis=1) - np.einsum("kp,kpq,kq->k", score, known, score)
            ratio = np.maximum(energy, 1e-9) / np.maximum(one_clock[rows], 1e-9)
            gain = -0.5 * rows * EVERY_S / BLOCK_S * np.log(ratio)
            found.append(np.where(rows * EVERY_S > ENOUGH_S, gain, -np.inf))
        return np.stack(found)

    def best(self, clock: Clock) -> tuple[Array, NDArray[np.intp]]:
        """Return the evidence (K,) of the best sensors for each clock, and the numbers of these choices."""
        each = self.gains(self.choices, clock)
        return np.max(each, axis=0), np.argmax(each, axis=0)

    def energy(self, sensors: Sequence[int], clock: Clock) -> tuple[float, float]:
        """Return the energies [N^2 m^2] of the residual of all rows with a pressure: on one clock, and on the other."""
        count = int(self.rows(clock)[0])
        columns, found = self.columns[:count], []
        for torque in ((self._torque - self.known)[:count], self.residual(sensors, clock)[0, :count]):
            scale = float(np.median(self.noise))
            gram = columns.T @ columns + np.eye(columns.shape[1]) * scale**2
            residual = torque - columns @ np.linalg.solve(gram, columns.T @ torque)
            found.append(float(residual @ residual))
        return found[0], found[1]


def running_sums(each: Array) -> Array:
    """Return the sums (T+1, ...) of the first 0..T of each (T, ...)."""
    return np.concatenate([np.zeros((1, *each.shape[1:])), np.cumsum(each, axis=0)])


def pieces(model: Model, recording: Recording) -> Iterator[tuple[float, list[JointRows]]]:
    """Yield the pieces of a recording: beginning [s], and the joints that move.

    A piece has PIECE_S to one and a half times as much.
    """
    rows = SlowRows(replace(model, friction=LAWS))
    model, load_kg, machine = rows.slow, recording.load_kg, model.machine
    thin, every = rows.thinned(recording.values), 1.0 / model.filters.rate_hz
    moved = model.channels.run(thin)
    momentum, static = model.empty.both_halves(moved.motion)
    columns = static + np.gradient(momentum, every, axis=0)
    prior = model.prior
    centre = bool(load_kg) * (model.load[:, 1:] ** 2 @ np.square(LOAD_CENTRE))
    spread = np.sqrt(np.diag(prior.covariance) + centre)
    sensors = places(machine, Place.PRESSURE)
    pressures = mean(fours(model.channels.smoothed(thin[:, [k for _, k in sensors]])))
    areas = _areas(model, thin[0], [k for _, k in sensors])
    levers = moved.motion.lever[..., list(machine.rows)]
    known = columns @ (prior.mean + model.load @ np.array([load_kg, 0.0, 0.0, 0.0]))
    known = known - np.einsum("tc,tcr->tr", moved.motion.force - pressures @ areas, levers)
    direction = np.abs(np.tanh(moved.motion.speed / model.filters.direction_speed))
    certain = np.logical_and(moved.usable, direction > MOVING)
    count = max(round(len(columns) * every / PIECE_S), 1)
    step, edge = max(round(EVERY_S / every), 1), round(EDGE_S / every)
    for piece in np.array_split(np.arange(len(columns)), count):
        joints = []
        for r, acting in enumerate(model.acting):
            acting_sensors = np.flatnonzero(np.any(areas[:, list(acting)], axis=1))
            inside = piece[edge : len(piece) - edge : step]
            chosen = inside[np.all(certain[inside][:, list(acting)], axis=1)]
            if len(chosen) * step * every > ENOUGH_S and acting_sensors.size:
                lever = np.einsum("sc,tc->ts", areas[acting_sensors], levers[chosen][..., r])
                names = tuple(sensors[s][0] for s in acting_sensors)
                t, shown = (chosen - piece[0]) * every, pressures[piece][:, acting_sensors]
                joints.append(JointRows(columns[chosen, r] * spread, known[chosen, r], lever, t, shown, every, names))
        if joints:
            yield recording.begins_s + piece[0] * every, joints


def _areas(model: Model, sample: Array, sensors: Sequence[int]) -> Array:
    """Return the contribution (S, C) [N/Pa] of each pressure sensor to the force of each cylinder."""
    unit = 1e5
    values = np.tile(sample, (len(sensors) + 1, 1))
    values[np.arange(len(sensors)), list(sensors)] += unit
    forces = model.channels.read(values)[:, model.channels.forces]
    return np.asarray((forces[:-1] - forces[-1]) / unit)
