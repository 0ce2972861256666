"""Jumps of readings for moments, as with a loose contact: found in the raw readings, because the filters smear them.

Numbers of jumps are Poisson. Either field and references have one rate of jumps, or each its own; rates are
log-uniform. A sensor that more probably jumps than not becomes an effect with the jumps that were found."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from cylforce.effects.fault import places
from cylforce.effects.library import LIBRARY, Proposal, proposals
from cylforce.effects.sensors.intermittent_glitch import IntermittentGlitch, glitches
from cylforce.mechanics.machine import Machine
from cylforce.readings.constants import HEALTHY, JUMPS_HZ, UNKNOWN_EFFECT
from cylforce.readings.recording import Recording
from cylforce.signals.estimate import Array

NAME = IntermittentGlitch().about.name
NEAR_S = 0.1  # around a jump, in which more of it is looked for; convention: a third of the longest one
RATES = np.geomspace(*JUMPS_HZ, 200)
PER_JUMP = 3  # numbers that describe a jump: begin [s], duration [s], direction
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class JumpingSensor:
    """A sensor whose readings jump.

    proposal: the effect at its place, with its jumps
    nats:     evidence of their number
    """

    proposal: Proposal
    nats: float


def jumping_sensors(
    machine: Machine, field: Sequence[Recording], references: Sequence[Recording], rate_hz: float
) -> tuple[JumpingSensor, ...]:
    """Return the sensors that more probably jump than not.

    None without references: a pressure may jump on a healthy machine.
    """
    if not references:
        return ()
    found, sensors = [], places(machine, IntermittentGlitch().about.place)
    signals = [k for _, k in sensors]
    flags = [[_jumping(recording.values[:, signals], rate_hz) for recording in group] for group in (field, references)]
    names = len({group[0].about.name for group in LIBRARY})
    least = float(np.log(HEALTHY / ((1.0 - HEALTHY - UNKNOWN_EFFECT) / names / len(sensors))))
    field_s, reference_s = (sum(len(r.values) for r in group) / rate_hz for group in (field, references))
    for column, k in enumerate(signals):
        jumps = _jumps(field, flags[0], (k, column), rate_hz)
        before = _jumps(references, flags[1], (k, column), rate_hz)
        count, usual = len(jumps) // PER_JUMP, len(before) // PER_JUMP
        nats = _evidence(count, field_s) + _evidence(usual, reference_s)
        nats -= _common_evidence((count, field_s), (usual, reference_s))
        if count / field_s > usual / reference_s and nats > least:
            each = proposals(machine, ((IntermittentGlitch(jumps=jumps),),))
            found.append(JumpingSensor(next(p for p in each if p.where == k), nats))
    return tuple(found)


def _jumping(readings: Array, rate_hz: float) -> Flags:
    """Return which samples (T, S) of some sensors belong to jumps."""
    return np.stack([glitches(reading, 1.0 / rate_hz) for reading in readings.T], axis=1)


def _jumps(
    recordings: Sequence[Recording], flags: Sequence[Flags], which: tuple[int, int], rate_hz: float
) -> tuple[float, ...]:
    """Return begin [s], duration [s] and direction of every jump of a sensor, one after the other.

    Readings that jump together are no loose contact but a knock.
    which: number of the sensor among all signals, and in `flags`
    """
    signal, column = which
    found: list[float] = []
    for recording, jumping in zip(recordings, flags, strict=True):
        knock = np.any(np.delete(jumping, column, axis=1), axis=1)
        near = binary_dilation(knock, iterations=round(NEAR_S * rate_hz)) if np.any(knock) else knock
        direction = _directions(recording.values[:, signal], jumping[:, column] & ~near, rate_hz)
        ends = np.flatnonzero(np.diff(direction, prepend=0.0, append=0.0)).tolist()
        for begin, end in pairwise(ends):
            if direction[begin]:
                found += [recording.begins_s + begin / rate_hz, (end - begin) / rate_hz, float(direction[begin])]
    return tuple(found)


def _directions(reading: Array, jumping: Flags, rate_hz: float) -> Array:
    """Return of every sample (T,) 1 or -1 where it is off by about the usual height of a jump, up or down, else 0.

    Within a jump a loose contact may change sides from sample to sample.
    jumping: (T,) samples that surely belong to jumps
    """
    if not np.any(jumping):
        return np.zeros(len(reading))
    near = binary_dilation(jumping, iterations=round(NEAR_S * rate_hz))
    number = np.arange(len(jumping))
    beside = np.interp(number, number[~near], reading[~near]) if not np.all(near) else reading
    off = np.where(near, reading - beside, 0.0)
    return np.asarray(np.where(np.abs(off) > np.median(np.abs(off[jumping])) / 2.0, np.sign(off), 0.0))


def _logs(count: int, seconds: float) -> Array:
    """Return the Poisson log likelihood at every rate, without the factorial."""
    return np.asarray(count * np.log(RATES * seconds) - RATES * seconds)


def _evidence(count: int, seconds: float) -> float:
    return float(np.logaddexp.reduce(_logs(count, seconds)) - np.log(len(RATES)))


def _common_evidence(one: tuple[int, float], other: tuple[int, float]) -> float:
    return float(np.logaddexp.reduce(_logs(*one) + _logs(*other)) - np.log(len(RATES)))
