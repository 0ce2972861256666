"""Lifts and returns of a machine at work: stretches in which the teeth touch nothing and one load hangs in the bucket,
or what sticks in it. They are found by dynamic programming over what a machine in order leaves of the torques: in a
stretch that is free of contact it is noise beside one load, otherwise it has a variance of its own."""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.columns.rows import BLOCK
from cylforce.diagnosis.numbers import GAP, HAPPENS
from cylforce.diagnosis.recordings.shifted import running
from cylforce.signals.estimate import Array

STEP = 4  # rows of 0.05 s, to which the begin and the end of a stretch are found
LONGEST = 100  # steps of a stretch: twenty seconds; a longer one becomes two
FEWEST = 3  # steps of a stretch that counts, beyond those in which the filters settle
CHANGE = float(np.log(BLOCK / HAPPENS))  # nats: that contact or a load begins just now
KIND = float(np.log(2.0))  # nats: loaded or empty, each as probable
ROUNDS = 4  # in which the noise of both kinds of stretches is told
SAME = 0.02  # of the noise: a smaller change of it ends that
DUMPS = 0.5  # of the way from where the bucket is tilted as a load is lifted to where it is emptied (convention)
LEAST = 0.3  # of the floor's white noise: as little as the probability model knows


class FreeOfContact(NamedTuple):
    """Rows from `first` to before `last` that are free of contact; whether a load hangs there; what does, (I,); whether
    it is carried `on` from the stretch before: between them nothing touched the teeth for longer than the filters see,
    and the bucket was nearer to where it was as the load was lifted than to where it is emptied."""

    first: int
    last: int
    loaded: bool
    carried: Array
    on: bool = False


class Whitened(NamedTuple):
    """What a machine in order leaves (T, R) of a recording, whitened, columns (T, R, I) of a load, which rows (T, R)
    are usable, and the angle (T,) [rad] of the tool against the house."""

    left: Array
    loads: Array
    good: NDArray[np.bool_]
    tilt: Array


class Scales(NamedTuple):
    """Noise of stretches free of contact and of the others (R,), of the floor's white noise."""

    free: Array
    busy: Array


@dataclass(frozen=True)
class _Steps:
    """Sums over every step: of squares (N, R), products with a load's columns (N, R, I), (N, R, I, I), rows (N, R)."""

    squares: Array
    across: Array
    within: Array
    rows: Array

    def summed(self, scale: Array) -> tuple[Array, Array, Array, Array]:
        """Weighed by a noise (R,) and summed up from the first step on: energies (N+1,), products with a load's columns
        (N+1, I), (N+1, I, I), and the logarithm of the noise."""
        weight = scale**-2.0
        each = (
            self.squares @ weight,
            np.einsum("nri,r->ni", self.across, weight),
            np.einsum("nrij,r->nij", self.within, weight),
            self.rows @ np.log(scale),
        )
        energy, across, within, norm = (running(e) for e in each)
        return energy, across, within, norm

    def busy(self, scale: Array) -> Array:
        """Log likelihood of every step (N,) with a variance of its own."""
        return np.asarray(-self.rows @ np.log(scale) - 0.5 * self.squares @ scale**-2.0)

    def left(self, found: "_Stretch", scale: Array, precision: Array) -> tuple[Array, Array, Array]:
        """The load (I,) of a stretch, and what it leaves there: energies and rows (R,)."""
        own = slice(found.first, found.last)
        across, within = self.across[own].sum(axis=0), self.within[own].sum(axis=0)
        weight = scale**-2.0
        load = np.linalg.solve(np.einsum("rij,r->ij", within, weight) + np.diag(precision), weight @ across)
        energy = self.squares[own].sum(axis=0) - 2.0 * across @ load + np.einsum("rij,i,j->r", within, load, load)
        return load, energy, self.rows[own].sum(axis=0)


class _Stretch(NamedTuple):
    first: int
    last: int
    loaded: bool


def stretches(seen: Whitened, heavy: Array, light: Array, settle: int) -> list[FreeOfContact]:
    """The stretches free of contact, without the `settle` rows at both ends in which the filters still see what was
    before, or see already what comes. `heavy`, `light` (I,): usual sizes of what hangs in a bucket, and of what sticks
    in an empty one."""
    steps = _steps(seen)
    count = np.maximum(steps.rows.sum(axis=0), 1.0)
    scales = Scales(np.ones(len(count)), np.maximum(np.sqrt(steps.squares.sum(axis=0) / count), GAP))
    precision = {True: heavy**-2.0, False: light**-2.0}
    path = _path(steps, scales, precision)
    for _ in range(ROUNDS - 1):
        before, scales = scales, _scales(steps, path, scales, precision)
        path = _path(steps, scales, precision)
        if np.allclose(scales.free, before.free, rtol=SAME) and np.allclose(scales.busy, before.busy, rtol=SAME):
            break
    found = list[FreeOfContact]()
    for each in path:
        first, last = STEP * each.first + settle, min(STEP * each.last, len(seen.left)) - settle
        if last - first >= FEWEST * STEP:
            load = steps.left(each, scales.free, precision[each.loaded])[0]
            found.append(FreeOfContact(first, last, each.loaded, load))
    return _carried_on(found, seen, settle)


def _carried_on(found: list[FreeOfContact], seen: Whitened, settle: int) -> list[FreeOfContact]:
    """The same with which loads are carried on. At both ends of what is between two stretches the filters see what is
    beside it."""
    on, first = [False] * len(found), 0
    between = [_between(a, b, seen.good) for a, b in pairwise(found)]
    for k, rows in enumerate(between, 1):
        if found[k - 1].loaded and found[k].loaded and rows.stop - rows.start <= 4 * settle:
            continue
        begin = seen.tilt[found[first].first]  # as this load was lifted; it is gone in the next stretch
        way = seen.tilt[rows] - begin
        emptied = way[np.argmax(np.abs(way))]
        for n in range(first + 1, k):
            on[n] = bool(np.all((seen.tilt[between[n - 1]] - begin) * np.sign(emptied) < DUMPS * np.abs(emptied)))
        first = k
    return [stretch._replace(on=each) for stretch, each in zip(found, on, strict=True)]


def _between(one: FreeOfContact, other: FreeOfContact, good: NDArray[np.bool_]) -> slice:
    """From the last usable row of a stretch to the first of the next one."""
    usable = np.any(good, axis=1)
    before = np.flatnonzero(usable[: one.last])
    after = other.first + np.flatnonzero(usable[other.first :])
    return slice(int(before[-1]) if before.size else 0, int(after[0]) + 1 if after.size else len(usable))


def _steps(seen: Whitened) -> _Steps:
    count = -(-len(seen.left) // STEP)

    def split(x: Array) -> Array:
        padded = np.zeros((count * STEP, *x.shape[1:]))
        padded[: len(x)] = x
        return padded.reshape(count, STEP, *x.shape[1:])

    y = split(np.where(seen.good, seen.left, 0.0))
    x = split(np.where(seen.good[..., None], seen.loads, 0.0))
    across = np.einsum("nsri,nsr->nri", x, y)
    within = np.einsum("nsri,nsrj->nrij", x, x)
    return _Steps(np.sum(y**2, axis=1), across, within, split(seen.good.astype(np.float64)).sum(axis=1))


def _path(steps: _Steps, scales: Scales, precision: dict[bool, Array]) -> list[_Stretch]:
    """The most probable stretches, in their order."""
    summed, busy = steps.summed(scales.free), steps.busy(scales.busy)
    count = len(busy)
    apart, free = np.full(count + 1, -np.inf), np.full(count + 1, -np.inf)
    apart[0] = 0.0
    came_free = np.zeros(count + 1, dtype=np.bool_)
    begun: list[_Stretch | None] = [None] * (count + 1)
    for end in range(1, count + 1):
        came_free[end] = free[end - 1] - CHANGE > apart[end - 1]
        apart[end] = max(apart[end - 1], free[end - 1] - CHANGE) + busy[end - 1]
        begins = np.arange(max(0, end - LONGEST), end)
        before = np.maximum(apart[begins], free[begins]) - CHANGE
        for loaded, prior in precision.items():
            log = before + _free(summed, begins, end, prior)
            best = int(np.argmax(log))
            if log[best] > free[end]:
                free[end], begun[end] = log[best], _Stretch(int(begins[best]), end, loaded)
    return _traced(apart, free, came_free, begun)


def _free(summed: tuple[Array, Array, Array, Array], begins: NDArray[np.int_], end: int, prior: Array) -> Array:
    """Log likelihood of stretches that end together, one load integrated out."""
    energy, across, within, norm = (each[end] - each[begins] for each in summed)
    whole = within + np.diag(prior)
    load = np.linalg.solve(whole, across[..., None])[..., 0]
    gain = np.einsum("ni,ni->n", across, load) - np.linalg.slogdet(whole)[1] + np.sum(np.log(prior))
    return np.asarray(-0.5 * energy - norm + 0.5 * gain - KIND)


def _traced(apart: Array, free: Array, came_free: NDArray[np.bool_], begun: list[_Stretch | None]) -> list[_Stretch]:
    found, end = [], len(apart) - 1
    inside = free[end] > apart[end]
    while end > 0:
        stretch = begun[end] if inside else None
        if stretch is None:
            end, inside = end - 1, bool(came_free[end])
        else:
            found.append(stretch)
            end = stretch.first
            inside = free[end] > apart[end]
    return found[::-1]


def _scales(steps: _Steps, path: list[_Stretch], scales: Scales, precision: dict[bool, Array]) -> Scales:
    """The noise of both kinds of stretches, as a path leaves it."""
    energy, rows = np.zeros_like(scales.free), np.zeros_like(scales.free)
    out = np.ones(len(steps.rows), dtype=np.bool_)
    for each in path:
        _, more, count = steps.left(each, scales.free, precision[each.loaded])
        energy, rows = energy + more, rows + count
        out[each.first : each.last] = False
    free = np.where(rows > 0.0, np.sqrt(np.maximum(energy, 0.0) / np.maximum(rows, 1.0)), scales.free)
    free = np.maximum(free, LEAST)
    others = np.maximum(steps.rows[out].sum(axis=0), 1.0)
    busy = np.sqrt(steps.squares[out].sum(axis=0) / others) if np.any(out) else scales.busy
    return Scales(free, np.maximum(busy, GAP * free))
