"""What the chamber that lets oil out says: while the pump drives a cylinder evenly, the pressure on the other side is
what the valve and the return line make at that speed, whatever the load. A torque cannot tell the zero of the head side
from that of the rod side, nor both from friction that differs between the directions; this can."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cylforce.core.gap.rows import BLOCK, Recorded, Rows
from cylforce.machine.candidate import Distortion
from cylforce.machine.machine import Machine
from cylforce.words.estimate import Array
from cylforce.words.signals import Kind

MOVING = 0.03  # m/s
EVEN, JITTER = 0.15, 0.003  # of the speed, m/s: what it may change by within
SPAN = 8  # rows, on either side
FEW = 6  # rows of a block, blocks of a group
COMMON = 0.35e5  # Pa: by which a level differs from one recording to the next on a machine in order
SHARP = 1e5  # Pa: a level that scatters more is none
FARTHEST = 5.0  # standard errors, beyond which a level says no more
HUBER, ROUNDS = 1.5, 15
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
    clean: Sequence[tuple[Recorded, Rows]]
    faulty: Sequence[tuple[Recorded, Rows]]
    rate_hz: float

    def support(self, effect: Distortion, where: int, size: float) -> float:
        """Evidence [nats] for an error of a pressure sensor, of that size, against none: 0 where nothing tells."""
        level = self._levels.get(where)
        wanted = size * self._wanted(effect, where, level.where) if level else np.zeros(1)
        usual = float(np.sqrt(np.mean(wanted**2)))
        if level is None or usual <= 0.0:
            return 0.0
        told = float(wanted @ level.excess) / float(wanted @ wanted) * usual
        return _loss(told / level.error) - _loss((told - usual) / level.error)

    def _wanted(self, effect: Distortion, where: int, places: tuple[tuple[int, NDArray[np.intp]], ...]) -> Array:
        """What the error adds in every block (B,) per unit of its size, once computed."""
        key = (repr(effect), where)
        if key not in self._known:
            step = effect.about.low
            each = [np.median(self._added(effect, where, step, n, rows)) for n, rows in places]
            self._known[key] = np.array(each) / step
        return self._known[key]

    @cached_property
    def _known(self) -> dict[tuple[str, int], Array]:
        return {}

    def _added(self, effect: Distortion, where: int, size: float, number: int, rows: NDArray[np.intp]) -> Array:
        """What the error adds to the sensor's pressure in some rows of a faulty recording [Pa]."""
        recorded = self.faulty[number][0]
        values = recorded.values
        t = recorded.begins + np.arange(len(values)) / self.rate_hz
        change = values[:, where] - effect.distorted(self.machine, values, t, where, -size)[:, where]
        return np.interp(self.faulty[number][1].t[rows], t, change)

    @cached_property
    def _levels(self) -> dict[int, _Level]:
        each = ((k, self._level(k)) for k, s in enumerate(self.machine.signals) if s.kind in OUT)
        return {k: level for k, level in each if level is not None}

    def _level(self, k: int) -> _Level | None:
        clean, faulty = ([self._steady(k, *one) for one in group] for group in (self.clean, self.faulty))
        speed, pressure = (np.concatenate([np.zeros(0), *(one[i] for one in clean)]) for i in (1, 2))
        if len(speed) < FEW * FEW:
            return None
        law, usual = _fitted(speed, pressure)
        if usual > SHARP:
            return None
        own = [x for rows, v, p in clean for x in _blocks(rows, p - law(v))[1]]
        where = tuple((n, rows) for n, (r, v, p) in enumerate(faulty) for rows in _blocks(r, p - law(v))[0])
        excess = np.array([x for r, v, p in faulty for x in _blocks(r, p - law(v))[1]])
        if len(own) < FEW or len(excess) < FEW // 2:
            return None
        scatter = max(float(np.std(np.clip(own, -FARTHEST * usual, FARTHEST * usual))), usual)
        middle = np.median(excess)
        excess = np.clip(excess, middle - HUBER * scatter, middle + HUBER * scatter)
        return _Level(where, excess, float(np.hypot(COMMON, scatter * np.sqrt(1.0 / len(excess) + 1.0 / len(own)))))

    def _steady(self, k: int, recorded: Recorded, rows: Rows) -> tuple[NDArray[np.intp], Array, Array]:
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


def _fitted(v: Array, p: Array) -> tuple[Callable[[Array], Array], float]:
    """The pressure as a function of speed, a + b |v| + c v^2, robustly (Huber's weights); the usual deviation [Pa]."""
    columns = _powers(v)
    weight, values, usual = np.ones(len(v)), np.zeros(columns.shape[1]), 1.0
    for _ in range(ROUNDS):
        values = np.asarray(np.linalg.lstsq(columns * weight[:, None], p * weight, rcond=None)[0])
        away = np.abs(p - columns @ values)
        usual = 1.48 * float(np.median(away)) + 1.0
        weight = 1.0 / np.sqrt(1.0 + (away / usual) ** 2)
    return lambda speed: _powers(speed) @ values, usual


def _powers(v: Array) -> Array:
    return np.stack([np.ones_like(v), np.abs(v), v**2], axis=-1)


def _blocks(rows: NDArray[np.intp], away: Array) -> tuple[list[NDArray[np.intp]], list[float]]:
    """Rows of every block that has some, and the median of `away` there."""
    number = rows // BLOCK
    each = [number == k for k in np.unique(number)]
    each = [here for here in each if np.sum(here) >= FEW]
    return [rows[here] for here in each], [float(np.median(away[here])) for here in each]


def _loss(x: float) -> float:
    return min(0.5 * x * x, 0.5 * FARTHEST**2)
