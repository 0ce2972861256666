"""Whether pressures and angles are on one clock: asked before any effect is looked for, because all of them are fitted
to forces and motion that are taken to belong together; where they do not, what bends most explains most.

The force shown at rate t + offset is taken to belong to the motion at t, for rates and offsets far to either side of
one clock, or for an offset from some instant on. Each time masses and friction are fitted anew, the data sheet with its
tolerances as prior, and what they leave of the torques is compared with what they leave on one clock, on the same rows.
A slow sensor makes one joint fit better a little later, a contact makes some postures fit anywhere: on two clocks
nearly all rows fit badly."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.rows import CENTRE, Recorded, Viewer
from cylforce.estimation.model import Model
from cylforce.signals.estimate import Array

LAWS = ("coulomb", "viscous")  # of friction, beside the masses
PIECE_S = 120.0  # of a recording that are judged together, about
EVERY_S = 0.4  # a row
MOVING = 0.9  # of the friction's direction must be known
ENOUGH_S = 10.0  # of motion of a joint
OFFSET_S = 2.0  # at a piece's beginning, at most
FASTEST = 2.5  # of one clock as the other tells it
STEPS_S = (0.5, 0.5)  # between offsets, and between lags at the end, that are tried
JUMP_S = 5.0  # between instants of a jump that are tried
SLICE = 500  # candidates at once
REFINED = 10  # rounds
LEAST = 0.3  # of the rows must have a force
NONE = 9.0  # worse than anything
LATE_S = 0.1  # up to which the library's effect, linear in the lag, does as well
MOST, USUALLY = 0.5, 0.8  # of the squares, of the typical row, that may be left: a contact leaves more in most rows
BOTH = 0.15  # of the squares, times that: clock faults of 0.05 s leave 0.1, other faults 0.25 and more
ROUNDS = 10  # of reweighting
SMALL = 0.3  # of the typical row: what is smaller counts no more
PARTS = 8  # of a piece, left out one after the other


class Slip(NamedTuple):
    """A piece of the recording `name`, `begins` to `ends` [s], that is not on one clock: its pressures are `first` [s]
    late at its beginning, `last` [s] at its end, standard errors `errors` (2,); putting that right takes the share
    `closed` of the energy away that masses and friction leave unexplained."""

    name: str
    begins: float
    ends: float
    first: float
    last: float
    errors: Array
    closed: float

    @property
    def largest(self) -> tuple[float, float]:
        """The larger of the lags [s] and its standard error."""
        return max((self.first, float(self.errors[0])), (self.last, float(self.errors[1])), key=lambda lag: abs(lag[0]))


class _Clock(NamedTuple):
    """Rates (K,) and offsets (K,) [s] of forces against motion, from times `since` (K,) [s] on; one clock before."""

    rate: Array
    offset: Array
    since: Array

    def one(self, k: int) -> "_Clock":
        """The k-th alone."""
        return _Clock(*(part[k : k + 1] for part in self))

    def shown(self, t: Array) -> Array:
        """The times (K, T) [s] at which the forces of times t (T,) are shown."""
        return np.where(t < self.since[:, None], t, self.rate[:, None] * t + self.offset[:, None])


ONE = _Clock(np.ones(1), np.zeros(1), np.zeros(1))


def slips(model: Model, recordings: Sequence[Recorded]) -> list[Slip]:
    """Pieces of recordings whose pressures and angles are not on one clock, the largest lag first."""
    viewer = Viewer(replace(model, friction=LAWS), np.zeros(0))
    found = (_slip(recorded.name, piece) for recorded in recordings for piece in _pieces(viewer, recorded))
    return sorted((s for s in found if s), key=lambda s: -abs(s.largest[0]))


@dataclass(frozen=True)
class _Piece:
    """Rows of a stretch: `columns` (T, R, P) in standard errors of the data sheet, what it `knows` (T, R) [N m],
    `levers` (T, C, R) of the forces, all 0 where a row does not count (`counts`), and its time `t` (T,) [s]; `force`
    (F, C) [N] is shown at all multiples of `every` [s]."""

    columns: Array
    knows: Array
    levers: Array
    counts: NDArray[np.bool_]
    t: Array
    force: Array
    every: float
    begins: float

    @property
    def ends(self) -> float:
        """The last time [s] with a force."""
        return (len(self.force) - 1) * self.every

    def wanted(self, clock: _Clock) -> Array:
        """What the forces of each clock leave for the columns to explain (K, T, R)."""
        place = clock.shown(self.t) / self.every
        first = np.clip(place.astype(np.intp), 0, len(self.force) - 2)
        share = np.clip(place - first, 0.0, 1.0)[..., None]
        force = self.force[first] * (1.0 - share) + self.force[first + 1] * share
        return np.asarray(np.einsum("ktc,tcr->ktr", force, self.levers) - self.knows)

    def scaled(self) -> "_Piece":
        """The same, each joint's rows divided by the rms that one clock leaves."""
        unit = np.ones(self.knows.shape[1])
        for _ in range(2):
            left = (self.wanted(ONE)[0] - self.columns @ self._fitted(unit)) * self.counts
            unit = np.sqrt(np.sum(left**2, axis=0) / np.sum(self.counts, axis=0)) + 1.0
        parts = (self.columns / unit[:, None], self.knows / unit, self.levers / unit)
        return replace(self, columns=parts[0], knows=parts[1], levers=parts[2])

    def _fitted(self, unit: Array) -> Array:
        columns, wanted = self.columns / unit[:, None], self.wanted(ONE)[0] / unit
        gram = np.einsum("trp,trq->pq", columns, columns) + np.eye(columns.shape[2])
        return np.asarray(np.linalg.solve(gram, np.einsum("trp,tr->p", columns, wanted)))

    def without(self, rows: NDArray[np.bool_]) -> "_Piece":
        """The same without some rows (T,)."""
        kept = np.logical_not(rows)[:, None]
        parts = (self.columns * kept[..., None], self.knows * kept, self.levers * kept[..., None])
        return replace(self, columns=parts[0], knows=parts[1], levers=parts[2], counts=self.counts & kept)

    def rows(self, clock: _Clock) -> NDArray[np.intp]:
        """The number (K,) of rows, from the first on, for which a clock has a force."""
        return np.searchsorted(self.t, (self.ends - clock.offset) / clock.rate, side="right")

    @cached_property
    def _known(self) -> tuple[Array, Array, Array]:
        """Of the first 0..T rows the covariance (T+1, P, P) of what is fitted to them, what it leaves of them on one
        clock (T+1,), squares, and how many count."""
        wanted, columns = self.wanted(ONE)[0], self.columns
        gram = _running(np.einsum("trp,trq->tpq", columns, columns))
        score, squares = _running(np.einsum("trp,tr->tp", columns, wanted)), _running(np.sum(wanted**2, axis=1))
        covariance = np.asarray(np.linalg.inv(gram + np.eye(columns.shape[2])), dtype=np.float64)
        left = squares - np.einsum("tp,tpq,tq->t", score, covariance, score)
        return covariance, left, _running(np.sum(self.counts, axis=1, dtype=np.float64))

    def share(self, clock: _Clock) -> Array:
        """What each clock (K,) leaves (squares) of what one clock leaves of the same rows."""
        covariance, left, counted = self._known
        rows, wanted = self.rows(clock), self.wanted(clock)
        wanted = wanted * (np.arange(len(self.t)) < rows[:, None])[..., None]
        score = wanted.reshape(len(rows), -1) @ self.columns.reshape(-1, self.columns.shape[2])
        squares = np.einsum("ktr,ktr->k", wanted, wanted)
        squares = squares - np.einsum("kp,kpq,kq->k", score, covariance[rows], score)
        return np.where(counted[rows] > LEAST * counted[-1], squares / np.maximum(left[rows], 1e-9), NONE)


def _running(each: Array) -> Array:
    """Sums (T+1, ...) of the first 0..T of each (T, ...)."""
    return np.concatenate([np.zeros((1, *each.shape[1:])), np.cumsum(each, axis=0)])


def _pieces(viewer: Viewer, recorded: Recorded) -> Iterator[_Piece]:
    """A recording's pieces, as long as PIECE_S or half as long again."""
    model, load = viewer.slow, recorded.load
    moved = model.channels.run(viewer.thinned(recorded.values))
    motion, every = moved.motion, 1.0 / model.filters.rate_hz
    momentum, static = model.empty.both_halves(motion)
    columns = static + np.gradient(momentum, every, axis=0)
    prior, carried = model.prior, model.load @ np.array([load, 0.0, 0.0, 0.0])
    spread = np.sqrt(np.diag(prior.covariance) + bool(load) * (model.load[:, 1:] ** 2 @ np.square(CENTRE)))
    counts = _counts(model, moved.usable, motion.speed)
    levers = motion.lever[..., list(model.machine.rows)] * counts[:, None]
    knows, columns = columns @ (prior.mean + carried) * counts, columns * spread * counts[..., None]
    count = max(round(len(columns) * every / PIECE_S), 1)
    step, edge = max(round(EVERY_S / every), 1), round(OFFSET_S / every)
    for part in np.array_split(np.arange(len(columns)), count):
        rows = part[edge : len(part) - edge : step]
        joints = np.flatnonzero(np.sum(counts[rows], axis=0) * step * every > ENOUGH_S)
        if joints.size:
            t = (rows - part[0]) * every
            each = (columns[rows][:, joints], knows[rows][:, joints], levers[rows][..., joints])
            begins = recorded.begins + part[0] * every
            yield _Piece(*each, counts[rows][:, joints], t, motion.force[part], every, begins)


def _counts(model: Model, usable: Array, speed: Array) -> NDArray[np.bool_]:
    """Rows (T, R) whose levers carry and whose cylinders move."""
    certain = np.logical_and(usable, np.abs(np.tanh(speed / model.filters.direction_speed)) > MOVING)
    return np.stack([np.all(certain[:, list(acting)], axis=1) for acting in model.acting], axis=-1)


def _slip(name: str, piece: _Piece) -> Slip | None:
    """What the piece's clocks do, if they are not one."""
    scaled = piece.scaled()
    clock = _searched(scaled)
    count, (first, last) = int(scaled.rows(clock)[0]), _lags(scaled, clock)
    left = float(scaled.share(clock)[0])
    if max(abs(first), abs(last)) < LATE_S or left > MOST:
        return None
    typical = _typical(scaled, clock, count)
    if typical > USUALLY or typical * left > BOTH:
        return None
    times = scaled.begins + scaled.t[[0, count - 1]]
    return Slip(name, float(times[0]), float(times[1]), first, last, _errors(scaled, clock), 1.0 - left)


def _lags(piece: _Piece, clock: _Clock) -> tuple[float, float]:
    """How late [s] the pressures are at the first row and at the last that has a force."""
    ends = piece.t[[0, int(piece.rows(clock)[0]) - 1]]
    first, last = clock.shown(ends)[0] - ends
    return float(first), float(last)


def _errors(piece: _Piece, clock: _Clock) -> Array:
    """Standard errors (2,) of these, by leaving out one part of the rows after the other (jackknife)."""
    parts = np.arange(len(piece.t)) * PARTS // len(piece.t)
    lags = [_lags(piece, _refined(piece.without(parts == k), clock)) for k in range(PARTS)]
    return np.asarray(np.std(lags, axis=0) * np.sqrt(PARTS - 1.0))


def _searched(piece: _Piece) -> _Clock:
    """The best of all clocks that are tried: any rate, or a jump."""
    short, step = STEPS_S[0], STEPS_S[1] / piece.ends
    slower = np.arange(1.0 - step, 1.0 / FASTEST, -step)
    rates = np.concatenate([slower, np.exp(np.arange(0.0, np.log(FASTEST), step))])
    offsets, jumps = np.arange(-OFFSET_S, OFFSET_S + short / 2.0, short), np.arange(JUMP_S, piece.ends, JUMP_S)
    families = (np.meshgrid(rates, offsets, [0.0]), np.meshgrid([1.0], offsets, jumps))
    best = [_refined(piece, _best(piece, _Clock(*(part.ravel() for part in family)))) for family in families]
    return min(best, key=lambda clock: float(piece.share(clock)[0]))


def _best(piece: _Piece, clock: _Clock) -> _Clock:
    """The one that leaves least."""
    parts = [_Clock(*(part[k : k + SLICE] for part in clock)) for k in range(0, len(clock.rate), SLICE)]
    return clock.one(int(np.argmin(np.concatenate([piece.share(part) for part in parts]))))


def _refined(piece: _Piece, clock: _Clock) -> _Clock:
    """The best clock near one, by smaller and smaller steps; the rate turns about the middle of the rows, or it is the
    jump that moves."""
    near, middle = np.array([-1.0, 0.0, 1.0]), float(piece.t[int(piece.rows(clock)[0]) // 2])
    jumps = bool(clock.since[0] > 0.0)
    short, other = STEPS_S[0] / 2.0, JUMP_S / 2.0 if jumps else STEPS_S[1] / piece.ends / 2.0
    for _ in range(REFINED):
        turned, moved = (x.ravel() for x in np.meshgrid(other * near, short * near))
        rate = clock.rate + turned * (not jumps)
        offset = np.clip(clock.offset + moved - (rate - clock.rate) * middle, -OFFSET_S, OFFSET_S)
        some = _Clock(rate, offset, np.maximum(clock.since + turned * jumps, 0.0))
        best = int(np.argmin(piece.share(some)))
        clock = some.one(best)
        if best == len(turned) // 2:
            short, other = short / 2.0, other / 2.0
    return clock


def _typical(piece: _Piece, clock: _Clock, rows: int) -> float:
    """What the clock leaves of the typical row of what one clock leaves, each fitted so that sums of magnitudes are
    least: the geometric mean of the joints."""
    counts = piece.counts[:rows]
    medians = [_median(piece.columns[:rows], piece.wanted(c)[0, :rows], counts) for c in (clock, ONE)]
    number = np.sum(counts, axis=0)
    return float(np.exp(np.sum(number * np.log(medians[0] / medians[1])) / np.sum(number)))


def _median(columns: Array, wanted: Array, counts: NDArray[np.bool_]) -> Array:
    """The median (R,) of the magnitudes that are left, by reweighted least squares."""
    weight, typical = counts.astype(np.float64), np.ones(counts.shape[1])
    for _ in range(ROUNDS):
        gram = np.einsum("trp,tr,trq->pq", columns, weight, columns, optimize=True) + np.eye(columns.shape[2])
        values = np.linalg.solve(gram, np.einsum("trp,tr,tr->p", columns, weight, wanted, optimize=True))
        left = np.abs(wanted - columns @ values)
        typical = np.array([np.median(left[own, r]) if np.any(own) else 1.0 for r, own in enumerate(counts.T)]) + 1e-6
        weight = counts / (typical * np.maximum(left, SMALL * typical))
    return typical
