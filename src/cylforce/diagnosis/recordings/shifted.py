"""Pressures that are shown at other times: of each joint the torque that masses and friction leave, when some pressure
sensors of its cylinders run on another clock than its angles.

Masses and friction are fitted anew for every clock, the data sheet with its tolerances as prior. Rows count as much as
they fit on one clock (Cauchy's distribution of the errors): a load or a contact makes some rows fit badly, two clocks
nearly all."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.columns.rows import BLOCK, CENTRE, RATE_HZ, Viewer
from cylforce.effects.fault import Place, places
from cylforce.estimation.filters import fours, mean
from cylforce.estimation.model import Model
from cylforce.signals.estimate import Array

LAWS = ("coulomb", "viscous")  # of friction, beside the masses
PIECE_S = 120.0  # of a recording that are judged together, about: what is computed in a second
EDGE_S = 2.0  # of a piece, at either end, that only lends its pressures
EVERY_S = 0.4  # a row: the period of the lowest low-pass of a service, 2.5 Hz
BLOCK_S = BLOCK / RATE_HZ  # of motion say one thing: within them errors are alike
MOVING = 0.9  # of the friction's direction must be known
ENOUGH_S = 10.0  # of motion of a joint: twice as many rows as parameters
ROUNDS = 15  # of reweighting
SLICE = 500  # clocks at once


class Clock(NamedTuple):
    """Rates (K,) and offsets (K,) [s] of pressures against motion, from times `since` (K,) [s] on; one clock before."""

    rate: Array
    offset: Array
    since: Array

    def only(self, k: slice | NDArray[np.intp]) -> "Clock":
        """Some of them."""
        return Clock(*(part[k] for part in self))

    def shown(self, t: Array) -> Array:
        """The times (K, T) [s] at which the pressures of times t (T,) are shown."""
        return np.where(t < self.since[:, None], t, self.rate[:, None] * t + self.offset[:, None])

    def lags(self, first: float, last: float) -> Array:
        """How late [s] the pressures are at two times (K, 2)."""
        ends = np.array([first, last])
        return np.asarray(self.shown(ends) - ends)


@dataclass(frozen=True)
class JointRows:
    """Rows of one joint while it moves: `columns` (T, P) in standard errors of the data sheet, what it `knows` (T,)
    [N m], `levers` (T, S) [N m/Pa] of its cylinders' `pressures` (F, S) [Pa], shown at all multiples of `every` [s];
    times `t` (T,) [s] from the piece's beginning; `names` of the sensors."""

    columns: Array
    knows: Array
    levers: Array
    t: Array
    pressures: Array
    every: float
    names: tuple[str, ...]

    @property
    def ends(self) -> float:
        """The last time [s] with a pressure."""
        return (len(self.pressures) - 1) * self.every

    def rows(self, clock: Clock) -> NDArray[np.intp]:
        """The number (K,) of rows, from the first on, that have a pressure on each clock."""
        return np.searchsorted(self.t, (self.ends - clock.offset) / clock.rate, side="right")

    @cached_property
    def choices(self) -> tuple[tuple[int, ...], ...]:
        """Sensors that may be on another clock together."""
        each = range(len(self.names))
        return tuple(own for n in each for own in combinations(each, n + 1))

    def wanted(self, own: Sequence[int], clock: Clock) -> Array:
        """What the pressures leave for the columns to explain (K, T), the sensors `own` on each clock."""
        place = np.clip(clock.shown(self.t) / self.every, 0.0, len(self.pressures) - 1.001)
        first = place.astype(np.intp)
        share, found = place - first, self._alone - self.knows + np.zeros_like(place)
        for s in own:
            later = self.pressures[first, s] * (1.0 - share) + self.pressures[first + 1, s] * share
            found += self.levers[:, s] * (later - self._now[:, s])
        return np.asarray(found)

    @cached_property
    def _now(self) -> Array:
        at = np.arange(len(self.pressures)) * self.every
        return np.stack([np.interp(self.t, at, pressure) for pressure in self.pressures.T], axis=-1)

    @cached_property
    def _alone(self) -> Array:
        return np.asarray(np.sum(self.levers * self._now, axis=1))

    @cached_property
    def noise(self) -> Array:
        """Standard deviation (T,) of each row on one clock, by Cauchy's distribution (reweighted least squares)."""
        wanted, weight = self._alone - self.knows, np.ones(len(self.t))
        scale = float(np.median(np.abs(wanted))) + 1.0
        for _ in range(ROUNDS):
            root = np.sqrt(weight) / scale
            columns = self.columns * root[:, None]
            gram = columns.T @ columns + np.eye(columns.shape[1])
            left = wanted - self.columns @ np.linalg.solve(gram, columns.T @ (wanted * root))
            weight = 2.0 / (1.0 + (left / scale) ** 2)
            scale = max(float(np.sqrt(np.mean(weight * left**2))), 1.0)
        return np.asarray(scale / np.sqrt(weight))

    @cached_property
    def _one(self) -> tuple[Array, Array, Array]:
        """On one clock the columns of rows of unit noise, and of the first 0..T rows the covariance (T+1, P, P) of what
        is fitted to them and the squares (T+1,) it leaves."""
        columns, wanted = self.columns / self.noise[:, None], (self._alone - self.knows) / self.noise
        gram, score = running(columns[:, :, None] * columns[:, None]), running(columns * wanted[:, None])
        covariance = np.asarray(np.linalg.inv(gram + np.eye(columns.shape[1])), dtype=np.float64)
        left = running(wanted**2) - np.einsum("tp,tpq,tq->t", score, covariance, score)
        return columns, covariance, left

    def gains(self, own: Sequence[int], clock: Clock) -> Array:
        """Evidence [nats] (K,) that the sensors `own` are on each clock."""
        parts = range(0, len(clock.rate), SLICE)
        return np.concatenate([self._gains(own, clock.only(slice(k, k + SLICE))) for k in parts])

    def _gains(self, own: Sequence[int], clock: Clock) -> Array:
        columns, covariance, left = self._one
        rows = self.rows(clock)
        wanted = self.wanted(own, clock) / self.noise * (np.arange(len(self.t)) < rows[:, None])
        score = wanted @ columns
        squares = np.sum(wanted**2, axis=1) - np.einsum("kp,kpq,kq->k", score, covariance[rows], score)
        gain = -0.5 * rows * EVERY_S / BLOCK_S * np.log(np.maximum(squares, 1e-9) / np.maximum(left[rows], 1e-9))
        return np.where(rows * EVERY_S > ENOUGH_S, gain, -np.inf)

    def best(self, clock: Clock) -> tuple[Array, NDArray[np.intp]]:
        """Of each clock the evidence (K,) of the sensors that fit it best, and which these are."""
        each = np.stack([self.gains(own, clock) for own in self.choices])
        return np.max(each, axis=0), np.argmax(each, axis=0)

    def energy(self, own: Sequence[int], clock: Clock) -> tuple[float, float]:
        """Squares [N^2 m^2] that are left of all rows with a pressure, on one clock and on the other."""
        count = int(self.rows(clock)[0])
        columns, found = self.columns[:count], []
        for wanted in ((self._alone - self.knows)[:count], self.wanted(own, clock)[0, :count]):
            scale = float(np.median(self.noise))
            gram = columns.T @ columns + np.eye(columns.shape[1]) * scale**2
            left = wanted - columns @ np.linalg.solve(gram, columns.T @ wanted)
            found.append(float(left @ left))
        return found[0], found[1]


def running(each: Array) -> Array:
    """Sums (T+1, ...) of the first 0..T of each (T, ...)."""
    return np.concatenate([np.zeros((1, *each.shape[1:])), np.cumsum(each, axis=0)])


def pieces(model: Model, recorded: Recorded) -> Iterator[tuple[float, list[JointRows]]]:
    """A recording's pieces, as long as PIECE_S or half as long again: when each begins [s], and its joints that
    move."""
    viewer = Viewer(replace(model, friction=LAWS), np.zeros(0))
    model, load, machine = viewer.slow, recorded.load, viewer.slow.machine
    thin, every = viewer.thinned(recorded.values), 1.0 / model.filters.rate_hz
    moved = model.channels.run(thin)
    momentum, static = model.empty.both_halves(moved.motion)
    columns = static + np.gradient(momentum, every, axis=0)
    prior = model.prior
    spread = np.sqrt(np.diag(prior.covariance) + bool(load) * (model.load[:, 1:] ** 2 @ np.square(CENTRE)))
    sensors = places(machine, Place.PRESSURE)
    pressures = mean(fours(model.channels.smoothed(thin[:, [k for _, k in sensors]])))
    areas = _areas(model, thin[0], [k for _, k in sensors])
    levers = moved.motion.lever[..., list(machine.rows)]
    knows = columns @ (prior.mean + model.load @ np.array([load, 0.0, 0.0, 0.0]))
    knows = knows - np.einsum("tc,tcr->tr", moved.motion.force - pressures @ areas, levers)
    direction = np.abs(np.tanh(moved.motion.speed / model.filters.direction_speed))
    certain = np.logical_and(moved.usable, direction > MOVING)
    count = max(round(len(columns) * every / PIECE_S), 1)
    step, edge = max(round(EVERY_S / every), 1), round(EDGE_S / every)
    for part in np.array_split(np.arange(len(columns)), count):
        joints = []
        for r, acting in enumerate(model.acting):
            own = np.flatnonzero(np.any(areas[:, list(acting)], axis=1))
            inside = part[edge : len(part) - edge : step]
            rows = inside[np.all(certain[inside][:, list(acting)], axis=1)]
            if len(rows) * step * every > ENOUGH_S and own.size:
                lever = np.einsum("sc,tc->ts", areas[own], levers[rows][..., r])
                names = tuple(sensors[s][0] for s in own)
                t, shown = (rows - part[0]) * every, pressures[part][:, own]
                joints.append(JointRows(columns[rows, r] * spread, knows[rows, r], lever, t, shown, every, names))
        if joints:
            yield recorded.begins + part[0] * every, joints


def _areas(model: Model, sample: Array, sensors: Sequence[int]) -> Array:
    """What each pressure sensor adds to each cylinder's force (S, C) [N/Pa]."""
    unit = 1e5
    values = np.tile(sample, (len(sensors) + 1, 1))
    values[np.arange(len(sensors)), list(sensors)] += unit
    forces = model.channels.read(values)[:, model.channels.forces]
    return np.asarray((forces[:-1] - forces[-1]) / unit)
