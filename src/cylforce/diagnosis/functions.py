"""Functions of one quantity each, fitted to a residual on some spans of time and judged on the others, so that none is
believed for having many freedoms."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.track import MOVING, Track
from cylforce.signals.estimate import Array

SPAN_S = 15.0  # that are fitted, or judged, together
FOLDS = 5
HATS = 12  # corners of a piecewise linear curve
RIDGE = 1e-3  # of the columns' energy
TURNS = (6.0, 60.0)  # periods in a turn of a joint, searched
PERIODS = 1.2  # of them that the motion has to contain
STEP = 1.08  # from one number of periods to the next


class Family(NamedTuple):
    """Functions of one quantity: `candidates`, each makes columns (T, K), one of which is chosen where it is fitted,
    `numbers`: what tells them apart; `whose`: which cylinder's force it is, else -1."""

    of: str
    candidates: tuple[Callable[[Track], Array], ...]
    numbers: tuple[float, ...] = (float("nan"),)
    whose: int = -1


def families(track: Track) -> Iterator[Family]:
    """The simplest first."""
    yield Family("constant", (lambda t: np.ones((len(t.left), 1)),))
    yield Family("speed", (lambda t: _hats(np.arcsinh(t.speed / MOVING)),))
    times = _periods(track)
    yield Family("periodic", tuple(_Wave(n) for n in times), tuple(times))
    yield Family("position", (lambda t: _both_ways(t, _hats(t.position)),))
    for c in (track.own, *(c for c in range(track.loads.shape[1]) if c != track.own)):
        yield Family("load", (_Load(c),), whose=c)
    yield Family("turning", (lambda t: _hats(t.turning),))
    yield Family("time", (lambda t: _both_ways(t, _hats(t.time, HATS // 2)),))
    yield Family("reversal", (lambda t: _both_ways(t, _hats(np.log(t.reversal + 0.1))),))


@dataclass(frozen=True)
class _Load:
    """A curve over the force of one cylinder."""

    whose: int

    def __call__(self, track: Track) -> Array:
        return _both_ways(track, _hats(track.loads[:, self.whose]))


@dataclass(frozen=True)
class _Wave:
    """A wave over the joint's angle; an error of the angle acts by the cylinder's force and by speed, too."""

    times: float

    def __call__(self, track: Track) -> Array:
        one = np.ones_like(track.left)
        force, speed = (x / (np.sqrt(np.mean(x**2)) + 1e-9) for x in (track.loads[:, track.own], track.speed))
        waves = np.stack([f(self.times * track.position) for f in (np.cos, np.sin)], axis=1)
        return np.hstack([one[:, None], _times(waves, np.stack([one, force, speed, speed**2], axis=1))])


def _periods(track: Track) -> list[float]:
    """Periods a turn that the motion allows to tell."""
    width = float(np.ptp(np.percentile(track.position, [1.0, 99.0])))
    times = np.exp(np.arange(np.log(TURNS[0]), np.log(TURNS[1]), np.log(STEP)))
    return list(times[times * width >= 2.0 * np.pi * PERIODS].tolist()) or [TURNS[1]]


def _both_ways(track: Track, columns: Array) -> Array:
    """What depends on the direction of motion, and what does not."""
    return _times(columns, np.stack([np.ones_like(track.speed), np.tanh(track.speed / MOVING)], axis=1))


def _times(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ti,tj->tij", a, b)).reshape(len(a), -1)


def _hats(x: Array, count: int = HATS) -> Array:
    """Columns (T, K) of a piecewise linear function, its corners evenly spread over nearly all x (T,)."""
    low, high = np.percentile(x, [1.0, 99.0])
    place = np.clip((x - low) / max(high - low, 1e-9), 0.0, 1.0) * (count - 1)
    return np.asarray(np.maximum(1.0 - np.abs(place[:, None] - np.arange(count)), 0.0))


def foreseen(track: Track, family: Family) -> tuple[float, int]:
    """Mean square [N^2 m^2] that a family takes away from spans it was not fitted to, and which of its candidates fits
    all of them best."""
    fold = track.parts(SPAN_S) % FOLDS
    order = np.argsort(fold, kind="stable")
    ends = np.searchsorted(fold[order], np.arange(FOLDS + 1))
    left = track.left[order]
    columns = [candidate(track)[order] for candidate in family.candidates]
    grams = np.array([[_gram(x[a:b], left[a:b]) for a, b in pairwise(ends)] for x in columns])
    whole = grams.sum(axis=1)
    rest = 0.0
    for k, (a, b) in enumerate(pairwise(ends)):
        sizes, gone = _fits(whole - grams[:, k])
        best = int(np.argmax(gone))
        rest += float(np.sum((left[a:b] - columns[best][a:b] @ sizes[best]) ** 2))
    return float(np.mean(left**2)) - rest / len(left), int(np.argmax(_fits(whole)[1]))


def _gram(columns: Array, left: Array) -> Array:
    both = np.hstack([columns, left[:, None]])
    return np.asarray(both.T @ both)


def _fits(grams: Array) -> tuple[Array, Array]:
    """Sizes (N, K) of N Gram matrices (N, K+1, K+1) of [columns | left], and the energy (N,) that they take away."""
    normal, right = grams[:, :-1, :-1], grams[:, :-1, -1]
    size = normal.shape[1]
    ridge = RIDGE * np.trace(normal, axis1=1, axis2=2) / size + 1e-12
    sizes = np.linalg.solve(normal + ridge[:, None, None] * np.eye(size), right[..., None])[..., 0]
    return np.asarray(sizes), np.einsum("nk,nk->n", sizes, right)
