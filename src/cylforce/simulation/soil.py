"""Soil: its resistance at the teeth while digging, and the material that fills the bucket and is dumped again."""

from typing import NamedTuple

import numpy as np

from cylforce.effects.loads.carried import RAMP, CarriedLoad, smooth
from cylforce.signals.estimate import Array

GYRATION = 0.35  # times the distance of the heap's centre from the last pin: its radius of gyration; chosen
SLIP_SPEED = 0.05  # m/s of the teeth, below which the soil's force decreases to zero; chosen


class Dig(NamedTuple):
    """One digging operation: the teeth are in the soil from `start` to `stop` [s]; meanwhile `mass` [kg] fills the
    bucket around `centre` (x, z) [m] in the last link's frame; it is dumped from `dump_start` to `dump_stop` [s]. The
    soil resists with `force` = (at first, at most) [N], modulated by K `waves` (K, 3): amplitude (share of the force),
    angular frequency [rad/s], phase [rad]."""

    start: float
    stop: float
    dump_start: float
    dump_stop: float
    mass: float
    centre: tuple[float, float]
    force: tuple[float, float]
    waves: Array


def carried(mass: float, centre: tuple[float, float]) -> Dig:
    """A digging operation in the past: a load of `mass` [kg] at `centre` (x, z) [m] that is in the bucket
    throughout."""
    return Dig(-2.0, -1.0, 1e9, 2e9, mass, centre, (0.0, 0.0), np.zeros((0, 3)))


def load(dig: Dig | None, t: Array) -> CarriedLoad:
    """The load in the bucket at times t (T,) [s]."""
    if dig is None:
        return CarriedLoad(np.zeros_like(t), np.zeros((*t.shape, 2)), np.zeros_like(t))
    ends = ((dig.start, dig.stop), (dig.dump_start, dig.dump_stop))
    filled, gone = (np.clip(smooth(t, *each), 0.0, 1.0) for each in ends)  # rounding must not carry less than nothing
    mass = dig.mass * filled * (1.0 - gone)
    # the first material lies near the teeth, the last leaves over them
    shift = 1.0 + 0.15 * (1.0 - filled) + 0.1 * gone
    centre = shift[:, None] * np.array(dig.centre)
    return CarriedLoad(mass, centre, mass * np.sum(centre**2, axis=-1) * (1.0 + GYRATION**2))


def resistance(dig: Dig | None, t: Array) -> Array:
    """Magnitude of the soil's force at the teeth (T,) [N] at times t (T,) [s]."""
    if dig is None:
        return np.zeros_like(t)
    amplitude, frequency, phase = dig.waves.T
    rough = 1.0 + np.cos(frequency * t[:, None] + phase) @ amplitude
    first, most = dig.force
    length = dig.stop - dig.start
    level = first + (most - first) * smooth(t, dig.start, dig.start + 0.65 * length)
    # the chip thins out towards the end, when the bucket curls out of the ground
    level *= 1.0 - 0.6 * smooth(t, dig.stop - 0.4 * length, dig.stop)
    inside = smooth(t, dig.start, dig.start + RAMP) * (1.0 - smooth(t, dig.stop - RAMP, dig.stop))
    return np.asarray(level * rough * inside)


def soil_force(size: Array, tip_velocity: Array) -> Array:
    """Force of the soil on the teeth (T, 2) [N], x forward and z up, of magnitude `size` (T,) [N], opposite to the
    tip's velocity (T, 2) [m/s]."""
    speed = np.sqrt(np.sum(tip_velocity**2, axis=-1) + SLIP_SPEED**2)
    return np.asarray(-tip_velocity * (size / speed)[:, None])


def draw_dig(
    rng: np.random.Generator, times: tuple[float, float, float, float], rated_payload: float, reach: float
) -> Dig:
    """A random digging operation: a load of 0.2 to 1 of the rated payload [kg]; a force that grows from 0.7 to 1.6..4
    times the weight of the rated payload.

    `times` = start, stop, dump_start, dump_stop [s]; `reach` [m]: largest distance of a load's centre from the last
    pin."""
    weight = 10.0 * rated_payload
    frequency = 2 * np.pi * np.array([0.4, 0.9, 1.7]) * rng.uniform(0.8, 1.25, 3)
    waves = np.stack([rng.uniform(0.03, 0.08, 3), frequency, rng.uniform(0, 2 * np.pi, 3)], axis=-1)
    centre = (float(reach * rng.uniform(0.55, 0.75)), float(reach * rng.uniform(0.0, 0.2)))
    peak = weight * float(rng.uniform(1.6, 4.0))
    return Dig(*times, rated_payload * float(rng.uniform(0.2, 1.0)), centre, (0.7 * weight, peak), waves)
