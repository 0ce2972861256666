"""Soil: its resistance at the teeth while digging, and the material that fills the bucket and is dumped again."""

from typing import NamedTuple

import numpy as np

from cylforce.effects.loads.carried import RAMP, CarriedLoad, smooth
from cylforce.signals.estimate import Array

GYRATION = 0.35  # radius of gyration of the heap, times the distance of its centre from the last pin; chosen
SLIP_SPEED = 0.05  # m/s of the teeth below which the soil's force decreases to zero; chosen


class Dig(NamedTuple):
    """One digging operation.

    start, stop: the teeth are in the soil between these times [s]
    dump_start, dump_stop: the load is dumped between these times [s]
    mass: load that fills the bucket while digging [kg]
    centre: (x, z) of the load in the last link's frame [m]
    force: resistance of the soil at first, and at most [N], before `waves` modulate it
    waves: (K, 3) modulation of the resistance: amplitude (share of the force), angular frequency [rad/s], phase [rad]
    """

    start: float
    stop: float
    dump_start: float
    dump_stop: float
    mass: float
    centre: tuple[float, float]
    force: tuple[float, float]
    waves: Array


def carried(mass: float, centre: tuple[float, float]) -> Dig:
    """Return a digging operation that ended before the scene, without force: its load is in the bucket throughout.

    mass: [kg]
    centre: (x, z) of the load in the last link's frame [m]
    """
    return Dig(
        start=-2.0,
        stop=-1.0,
        dump_start=1e9,
        dump_stop=2e9,
        mass=mass,
        centre=centre,
        force=(0.0, 0.0),
        waves=np.zeros((0, 3)),
    )


def load(dig: Dig | None, t: Array) -> CarriedLoad:
    """Return the load in the bucket at times t (T,) [s]: mass [kg], centre (T, 2) [m], inertia [kg m^2].

    dig: the digging operation; None: an empty bucket
    """
    if dig is None:
        return CarriedLoad(np.zeros_like(t), np.zeros((*t.shape, 2)), np.zeros_like(t))
    # clipped, because rounding must not make the mass negative
    filled = np.clip(smooth(t, dig.start, dig.stop), 0.0, 1.0)
    gone = np.clip(smooth(t, dig.dump_start, dig.dump_stop), 0.0, 1.0)
    mass = dig.mass * filled * (1.0 - gone)
    # the first material lies near the teeth, the last leaves over them
    shift = 1.0 + 0.15 * (1.0 - filled) + 0.1 * gone
    centre = shift[:, None] * np.array(dig.centre)
    return CarriedLoad(mass, centre, mass * np.sum(centre**2, axis=-1) * (1.0 + GYRATION**2))


def resistance(dig: Dig | None, t: Array) -> Array:
    """Return the magnitude of the soil's force at the teeth (T,) [N] at times t (T,) [s]."""
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
    """Return the force of the soil on the teeth (T, 2) [N], x forward and z up, opposite to the tip's velocity.

    size: (T,) its magnitude [N]
    tip_velocity: (T, 2) [m/s]
    """
    speed = np.sqrt(np.sum(tip_velocity**2, axis=-1) + SLIP_SPEED**2)
    return np.asarray(-tip_velocity * (size / speed)[:, None])


def draw_dig(
    rng: np.random.Generator, times: tuple[float, float, float, float], rated_payload: float, reach: float
) -> Dig:
    """Return a random digging operation.

    The load is 0.2 to 1 of the rated payload. The force grows from 0.7 to 1.6..4 times the weight of the rated payload.
    Three waves of some 0.4, 0.9 and 1.7 Hz modulate it, each by 3 to 8 per cent. All ranges are chosen.

    times: start, stop, dump_start, dump_stop of `Dig` [s]
    rated_payload: [kg]
    reach: distance from the last pin that the load's centre may have [m]; it lies at 0.55 to 0.78 of it
    """
    weight = 10.0 * rated_payload  # [N], with g rounded to 10 m/s^2
    frequency = 2 * np.pi * np.array([0.4, 0.9, 1.7]) * rng.uniform(0.8, 1.25, 3)
    waves = np.stack([rng.uniform(0.03, 0.08, 3), frequency, rng.uniform(0, 2 * np.pi, 3)], axis=-1)
    centre = (float(reach * rng.uniform(0.55, 0.75)), float(reach * rng.uniform(0.0, 0.2)))
    peak = weight * float(rng.uniform(1.6, 4.0))
    start, stop, dump_start, dump_stop = times
    return Dig(
        start=start,
        stop=stop,
        dump_start=dump_start,
        dump_stop=dump_stop,
        mass=rated_payload * float(rng.uniform(0.2, 1.0)),
        centre=centre,
        force=(0.7 * weight, peak),
        waves=waves,
    )
