"""Readings that jump for moments, as with a loose contact: counted in the raw readings, because no filter passes them,
and replaced by what lies beside them before anything is fitted.

Both counts are Poisson. Either field and references have one rate of jumps, or each its own; rates are log-uniform."""

from collections.abc import Mapping, Sequence

import numpy as np

from cylforce.diagnosis.numbers import GLITCHES_PER_S, IN_ORDER, ODD
from cylforce.diagnosis.rows import Recorded
from cylforce.effects.fault import places
from cylforce.effects.library import LIBRARY
from cylforce.effects.sensors.intermittent_glitch import IntermittentGlitch, glitches
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

RATES = np.geomspace(*GLITCHES_PER_S, 200)


def glitching(
    machine: Machine, faulty: Sequence[Recorded], clean: Sequence[Recorded], rate_hz: float
) -> dict[tuple[str, int], float]:
    """Name and number of the sensors that more probably have this fault than not, with the evidence [nats] for it.
    Nothing without references: a pressure may jump on a machine in order."""
    if not clean:
        return {}
    found = {}
    sensors = places(machine, IntermittentGlitch().about.place)
    names = len({group[0].about.name for group in LIBRARY}) + 1
    least = float(np.log(IN_ORDER / ((1.0 - IN_ORDER - ODD) / names / len(sensors))))
    for name, k in sensors:
        (n, t), (m, s) = (_counted(group, k, rate_hz) for group in (faulty, clean))
        evidence = _told(n, t) + _told(m, s) - _told_alike((n, t), (m, s))
        if n / t > m / s and evidence > least:
            found[name, k] = evidence
    return found


def repaired(
    recordings: Sequence[Recorded], sensors: Mapping[tuple[str, int], float], rate_hz: float
) -> list[Recorded]:
    """The recordings with the jumps of some sensors replaced by straight lines."""
    found = []
    for recorded in recordings:
        values = recorded.values.copy() if sensors else recorded.values
        for _, k in sensors:
            bad = glitches(values[:, k], 1.0 / rate_hz)
            if np.any(bad) and not np.all(bad):
                number = np.arange(len(bad))
                values[bad, k] = np.interp(number[bad], number[~bad], values[~bad, k])
        found.append(recorded._replace(values=values))
    return found


def _counted(group: Sequence[Recorded], k: int, rate_hz: float) -> tuple[int, float]:
    """Number of jumps of a sensor, and time [s]."""
    each = [glitches(recorded.values[:, k], 1.0 / rate_hz) for recorded in group]
    count = sum(int(np.sum(np.diff(bad.astype(np.int8), prepend=0) == 1)) for bad in each)
    return count, sum(len(bad) for bad in each) / rate_hz


def _logs(count: int, seconds: float) -> Array:
    """Log likelihood at every rate, but for what all have in common."""
    return np.asarray(count * np.log(RATES * seconds) - RATES * seconds)


def _told(count: int, seconds: float) -> float:
    return float(np.logaddexp.reduce(_logs(count, seconds)) - np.log(len(RATES)))


def _told_alike(one: tuple[int, float], other: tuple[int, float]) -> float:
    return float(np.logaddexp.reduce(_logs(*one) + _logs(*other)) - np.log(len(RATES)))
