"""What the chamber that lets oil out says: while the pump drives a cylinder evenly, the pressure on the other side is
what the valve and the return line make at that speed, whatever the load. A torque cannot tell the zero of the head side
from that of the rod side, nor both from friction that differs between the directions; this can."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from cylforce.diagnosis.columns.recorded import GapRows, Recorded
from cylforce.diagnosis.columns.rows import BLOCK
from cylforce.effects.imposed import Imposed, distorted
from cylforce.effects.library import Group
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

MOVING = 0.03  # m/s
EVEN, JITTER = 0.15, 0.003  # of the speed, m/s: what it may change by within
SPAN = 8  # rows, on either side
FEW = 6  # rows of a block, blocks of a group
COMMON = 0.2e5  # Pa: by which a level differs from one recording to the next on a machine in order
EXACT, SHARP = 0.3e5, 1.5e5  # Pa: what a level scatters at least; one that scatters more is none
USUAL, STEEP = 0.1, 20e5  # m/s, Pa: a usual speed, and what its pressure loss may be
FARTHEST = 5.0  # standard errors, beyond which a level says no more
HUBER, WILD, ROUNDS = 1.5, 3.0, 15
OUT = {Kind.HEAD_PRESSURE: -1.0, Kind.ROD_PRESSURE: 1.0}  # the direction in which a chamber lets oil out


@dataclass(frozen=True)
class _Level:
    """Of one pressure sensor: (recording, rows (n,)) of every faulty block that tells something, by how much the
    pressure is above what clean recordings have at that speed, `excess` (B,) [Pa], and its standard error."""

    where: tuple[tuple[int, NDArray[np.intp]], ...]
    excess: Array
    error: float


@dataclass(frozen=True)
class Returns:
    """The faulty recordings' return pressures beside the clean ones'; each with its rows."""

    machine: Machine
    clean: Sequence[tuple[Recorded, GapRows]]
    faulty: Sequence[tuple[Recorded, GapRows]]
    rate_hz: float

    def support(self, group: Group, where: int, size: float) -> float:
        """Evidence [nats] for an error of a pressure sensor, of that size, against none: 0 where nothing tells."""
        level = self._levels.get(where)
        wanted = size * self._wanted(group, where, level.where) if level else np.zeros(1)
        usual = float(np.sqrt(np.mean(wanted**2)))
        if level is None or usual <= 0.0:
            return 0.0
        told = float(wanted @ level.excess) / float(wanted @ wanted) * usual
        return _loss(told / level.error) - _loss((told - usual) / level.error)

    def _wanted(self, group: Group, where: int, places: tuple[tuple[int, NDArray[np.intp]], ...]) -> Array:
        """What the error adds in every block (B,) per unit of its size, once computed."""
        key = (repr(group), where)
        if key not in self._known:
            step = group[0].about.low
            each = [np.median(self._added(group, where, step, n, rows)) for n, rows in places]
            self._known[key] = np.array(each) / step
        return self._known[key]

    @cached_property
    def _known(self) -> dict[tuple[str, int], Array]:
        return {}

    def _added(self, group: Group, where: int, size: float, number: int, rows: NDArray[np.intp]) -> Array:
        """What the error adds to the sensor's pressure in some rows of a faulty recording [Pa]."""
        recorded = self.faulty[number][0]
        values = recorded.values
        t = recorded.begins + np.arange(len(values)) / self.rate_hz
        less = distorted(self.machine, [Imposed(group, "", where, (-size,))], values, t)
        change = values[:, where] - less[:, where]
        return np.interp(self.faulty[number][1].t[rows], t, change)

    @cached_property
    def _levels(self) -> dict[int, _Level]:
        each = ((k, self._level(k)) for k, s in enumerate(self.machine.signals) if s.kind in OUT)
        return {k: level for k, level in each if level is not None}

    def _level(self, k: int) -> _Level | None:
        own, here = (_blocks(self._steady(k, *one) for one in group) for group in (self.clean, self.faulty))
        if len(own) < FEW or len(here) < FEW // 2:
            return None
        law = _fitted(own)
        if law.scatter > SHARP:
            return None
        columns, pressures = _table(here)
        excess = pressures - columns @ law.values
        middle, most = np.median(excess), HUBER * law.scatter
        mean = np.mean(columns, axis=0)
        variance = COMMON**2 + law.scatter**2 / len(here) + float(mean @ law.covariance @ mean)
        where = tuple((block.recording, block.rows) for block in here)
        return _Level(where, np.clip(excess, middle - most, middle + most), float(np.sqrt(variance)))

    def _steady(self, k: int, recorded: Recorded, rows: GapRows) -> tuple[NDArray[np.intp], Array, Array]:
        """Rows (n,) in which the chamber lets oil out, evenly and driven; speeds and pressures (n,) there."""
        signal = self.machine.signals[k]
        v, force = rows.speed[:, signal.index], rows.force[:, signal.index]
        chosen = np.flatnonzero((OUT[signal.kind] * v > MOVING) & (force * v > 0.0) & _even(v))
        t = recorded.begins + np.arange(len(recorded.values)) / self.rate_hz
        return chosen, v[chosen], np.interp(rows.t[chosen], t, recorded.values[:, k])


def _even(v: Array) -> NDArray[np.bool_]:
    """Where (T,) a speed (T,) [m/s] stays what it is for a while."""
    found, n = np.zeros(len(v), dtype=np.bool_), len(v)
    if n > 2 * SPAN:
        here = v[SPAN : n - SPAN]
        changes = [np.abs(v[SPAN + d : n - SPAN + d] - here) for d in (-SPAN, -SPAN // 2, SPAN // 2, SPAN)]
        found[SPAN : n - SPAN] = np.max(changes, axis=0) < EVEN * np.abs(here) + JITTER
    return found


class _Block(NamedTuple):
    """A block in which a chamber lets oil out evenly: the number of its recording, the rows (n,), the medians of speed
    [m/s] and pressure [Pa] there."""

    recording: int
    rows: NDArray[np.intp]
    speed: float
    pressure: float


class _Law(NamedTuple):
    """The pressure as a + b |v| + c v^2: `values` (3,) with their covariance, and how blocks scatter about it [Pa]."""

    values: Array
    covariance: Array
    scatter: float


def _fitted(blocks: Sequence[_Block]) -> _Law:
    """The law of clean blocks, robustly (Huber's weights); the faster the oil, the more pressure it takes. Where no
    block was as fast, the law is the less sure."""
    columns, pressures = _table(blocks)
    free = max(len(blocks) - columns.shape[1], 1)
    root, low = np.ones(len(blocks)), np.array([-np.inf, 0.0, 0.0])
    values, away, usual = np.zeros(len(low)), pressures, EXACT
    for _ in range(ROUNDS):
        values = np.asarray(lsq_linear(columns * root[:, None], pressures * root, bounds=(low, np.inf)).x)
        away = np.abs(pressures - columns @ values)
        usual = max(1.48 * float(np.median(away)) * np.sqrt(len(blocks) / free), EXACT)
        root = np.minimum(1.0, np.sqrt(HUBER * usual / np.maximum(away, 1e-9)))
    weight = root**2
    squares = float(np.sum(weight * np.minimum(away, WILD * usual) ** 2))
    scatter = max(float(np.sqrt(squares / max(float(np.sum(weight)) - columns.shape[1], 1.0))), usual)
    information = (columns * weight[:, None]).T @ columns + np.diag([0.0, 1.0, 1.0]) * (scatter / STEEP) ** 2
    return _Law(values, np.asarray(np.linalg.inv(information) * scatter**2), scatter)


def _table(blocks: Sequence[_Block]) -> tuple[Array, Array]:
    """The law's columns (B, 3) and the pressures (B,) of blocks."""
    speed = np.array([block.speed for block in blocks]) / USUAL
    return np.stack([np.ones_like(speed), np.abs(speed), speed**2], axis=-1), np.array([b.pressure for b in blocks])


def _blocks(recordings: Iterable[tuple[NDArray[np.intp], Array, Array]]) -> list[_Block]:
    """Every block of some recordings - rows (n,), speeds and pressures (n,) - with rows enough."""
    found = []
    for recording, (rows, speed, pressure) in enumerate(recordings):
        each = [rows // BLOCK == k for k in np.unique(rows // BLOCK)]
        found += [
            _Block(recording, rows[here], float(np.median(speed[here])), float(np.median(pressure[here])))
            for here in each
            if np.sum(here) >= FEW
        ]
    return found


def _loss(x: float) -> float:
    return min(0.5 * x * x, 0.5 * FARTHEST**2)
