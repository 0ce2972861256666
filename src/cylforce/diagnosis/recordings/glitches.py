"""Readings that jump for moments, as with a loose contact: found in the raw readings, because no filter passes them.

Numbers of jumps are Poisson. Either field and references have one rate of jumps, or each its own; rates are
log-uniform. A sensor that more probably jumps than not is asked as an effect with the jumps that were found."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.numbers import GLITCHES_PER_S, IN_ORDER, ODD
from cylforce.effects.fault import places
from cylforce.effects.library import LIBRARY, Proposal, proposals
from cylforce.effects.sensors.intermittent_glitch import IntermittentGlitch, glitches
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

NAME = IntermittentGlitch().about.name
NEAR_S = 0.1  # around a jump, in which more of it is looked for; convention: a third of the longest one
RATES = np.geomspace(*GLITCHES_PER_S, 200)
Flags = NDArray[np.bool_]


class Jumping(NamedTuple):
    """A sensor that jumps: the effect at its place, and the evidence [nats] of the number of jumps."""

    proposal: Proposal
    nats: float


def jumping(
    machine: Machine, faulty: Sequence[Recorded], clean: Sequence[Recorded], rate_hz: float
) -> tuple[Jumping, ...]:
    """The sensors that more probably have this fault than not. None without references: a pressure may jump on a
    machine in order."""
    if not clean:
        return ()
    found, sensors = [], places(machine, IntermittentGlitch().about.place)
    numbers = [k for _, k in sensors]
    seen = [[_bad(recorded.values[:, numbers], rate_hz) for recorded in group] for group in (faulty, clean)]
    names = len({group[0].about.name for group in LIBRARY})
    least = float(np.log(IN_ORDER / ((1.0 - IN_ORDER - ODD) / names / len(sensors))))
    for own, k in enumerate(numbers):
        pairs = zip((faulty, clean), seen, strict=True)
        jumps, before = (_jumps(group, bad, (k, own), rate_hz) for group, bad in pairs)
        n, m = len(jumps) // 3, len(before) // 3
        t, s = (sum(len(recorded.values) for recorded in group) / rate_hz for group in (faulty, clean))
        nats = _told(n, t) + _told(m, s) - _told_alike((n, t), (m, s))
        if n / t > m / s and nats > least:
            each = proposals(machine, ((IntermittentGlitch(jumps=jumps),),))
            found.append(Jumping(next(p for p in each if p.where == k), nats))
    return tuple(found)


def _bad(readings: Array, rate_hz: float) -> Flags:
    """Which samples (T, S) of some sensors belong to jumps."""
    return np.stack([glitches(reading, 1.0 / rate_hz) for reading in readings.T], axis=1)


def _jumps(
    group: Sequence[Recorded], bad: Sequence[Flags], which: tuple[int, int], rate_hz: float
) -> tuple[float, ...]:
    """Begin [s], duration [s] and direction of every jump of a sensor, one after the other; `which`: its number among
    all signals and in `bad`. What jumps together is no loose contact, but a knock."""
    found: list[float] = []
    for recorded, flags in zip(group, bad, strict=True):
        together = np.any(np.delete(flags, which[1], axis=1), axis=1)
        near = binary_dilation(together, iterations=round(NEAR_S * rate_hz)) if np.any(together) else together
        way = _directions(recorded.values[:, which[0]], flags[:, which[1]] & ~near, rate_hz)
        ends = np.flatnonzero(np.diff(way, prepend=0.0, append=0.0)).tolist()
        for begin, end in pairwise(ends):
            if way[begin]:
                found += [recorded.begins + begin / rate_hz, (end - begin) / rate_hz, float(way[begin])]
    return tuple(found)


def _directions(reading: Array, bad: Flags, rate_hz: float) -> Array:
    """Of every sample (T,) 1 or -1 where it is off by a jump of the usual height or so, up or down, else 0: within a
    jump a loose contact may change sides from sample to sample; `bad` (T,): samples that surely belong to jumps."""
    if not np.any(bad):
        return np.zeros(len(reading))
    near = binary_dilation(bad, iterations=round(NEAR_S * rate_hz))
    number = np.arange(len(bad))
    beside = np.interp(number, number[~near], reading[~near]) if not np.all(near) else reading
    off = np.where(near, reading - beside, 0.0)
    return np.asarray(np.where(np.abs(off) > np.median(np.abs(off[bad])) / 2.0, np.sign(off), 0.0))


def _logs(count: int, seconds: float) -> Array:
    """Log likelihood at every rate, but for what all have in common."""
    return np.asarray(count * np.log(RATES * seconds) - RATES * seconds)


def _told(count: int, seconds: float) -> float:
    return float(np.logaddexp.reduce(_logs(count, seconds)) - np.log(len(RATES)))


def _told_alike(one: tuple[int, float], other: tuple[int, float]) -> float:
    return float(np.logaddexp.reduce(_logs(*one) + _logs(*other)) - np.log(len(RATES)))
