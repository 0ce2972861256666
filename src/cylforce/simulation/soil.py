"""What the tool meets: soil that resists the teeth while digging, material that fills the bucket and leaves
it again."""

from typing import NamedTuple

import numpy as np

from cylforce.effects.loads.carried import RAMP, CarriedLoad, smooth
from cylforce.signals.estimate import Array

GYRATION = 0.35  # radius of gyration of the heap over the reach of its centre
SLIP_SPEED = 0.05  # m/s of the teeth below which the soil's resistance fades


class Dig(NamedTuple):
    """One digging: the teeth are in the soil from `start` to `stop` [s]; `mass` [kg] gathers meanwhile around
    `centre` (x, z) [m] of the last link's frame and leaves from `dump_start` to `dump_stop`. The soil resists
    with `force` = (at first, at most) [N], times 1 + the `waves` (K, 3): amplitude, angular frequency
    [rad/s], phase."""

    start: float
    stop: float
    dump_start: float
    dump_stop: float
    mass: float
    centre: tuple[float, float]
    force: tuple[float, float]
    waves: Array


def carried(mass: float, centre: tuple[float, float]) -> Dig:
    """A load [kg] that lay in the bucket before and stays there."""
    return Dig(-2.0, -1.0, 1e9, 2e9, mass, centre, (0.0, 0.0), np.zeros((0, 3)))


def load(dig: Dig | None, t: Array) -> CarriedLoad:
    """What lies in the bucket at times (T,) [s]."""
    if dig is None:
        return CarriedLoad(np.zeros_like(t), np.zeros((*t.shape, 2)), np.zeros_like(t))
    filled, gone = smooth(t, dig.start, dig.stop), smooth(t, dig.dump_start, dig.dump_stop)
    mass = dig.mass * filled * (1.0 - gone)
    # the first material lies near the teeth, the last leaves over them
    shift = 1.0 + 0.15 * (1.0 - filled) + 0.1 * gone
    centre = shift[:, None] * np.array(dig.centre)
    return CarriedLoad(mass, centre, mass * np.sum(centre**2, axis=-1) * (1.0 + GYRATION**2))


def resistance(dig: Dig | None, t: Array) -> Array:
    """Size of the soil's force at the teeth (T,) [N]."""
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
    """Force of the soil on the teeth (T, 2) [N], x forward and z up: against the tip's velocity (T, 2)
    [m/s]."""
    speed = np.sqrt(np.sum(tip_velocity**2, axis=-1) + SLIP_SPEED**2)
    return np.asarray(-tip_velocity * (size / speed)[:, None])


def draw_dig(
    rng: np.random.Generator, times: tuple[float, float, float, float], rated_payload: float, reach: float
) -> Dig:
    """A digging of 0.2..1 of the rated payload [kg]; the force grows from 0.7 to 1.6..4 rated payloads'
    weight.

    `times` = start, stop, dump_start, dump_stop [s]; `reach` [m]: how far from the last pin a load's centre
    can lie."""
    weight = 10.0 * rated_payload
    frequency = 2 * np.pi * np.array([0.4, 0.9, 1.7]) * rng.uniform(0.8, 1.25, 3)
    waves = np.stack([rng.uniform(0.03, 0.08, 3), frequency, rng.uniform(0, 2 * np.pi, 3)], axis=-1)
    centre = (float(reach * rng.uniform(0.55, 0.75)), float(reach * rng.uniform(0.0, 0.2)))
    peak = weight * float(rng.uniform(1.6, 4.0))
    return Dig(*times, rated_payload * float(rng.uniform(0.2, 1.0)), centre, (0.7 * weight, peak), waves)
