"""How the simulated machine's chassis moves when an effect of the library says that it does."""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import numpy as np

from cylforce.effects.imposed import Imposed, base_motions
from cylforce.effects.loads.carried import smooth
from cylforce.signals.estimate import Array

# How a chassis swings that ought to stand still: (amplitude [rad], period [s]) of several waves, within so many seconds
# of its begin and of its end; a step [s] of the differences that tell its rate.
WAVES = ((0.11, 9.0), (0.05, 5.2))
EASE, STEP = 3.0, 1e-3


class Swing(NamedTuple):
    """How the chassis swings: `angle` [rad], `rate` [rad/s], `acceleration` [rad/s^2], each (T,)."""

    angle: Array
    rate: Array
    acceleration: Array


def swing(effects: Sequence[Imposed], t: Array) -> Swing:
    """The chassis' motion at times (T,) [s] of the run; without an effect that has a size it stands still."""
    found = np.zeros((3, len(t)))
    for _, each in base_motions(effects):
        if any(each.sizes):
            before, now, after = (_swung(each, t + s) for s in (-STEP, 0.0, STEP))
            found += now, (after - before) / (2.0 * STEP), (after - 2.0 * now + before) / STEP**2
    return Swing(*found)


def _swung(each: Imposed, t: Array) -> Array:
    """Its angle (T,) [rad]."""
    inside = smooth(t, each.begin, each.begin + EASE)
    if each.end < inf:
        inside = inside * (1.0 - smooth(t, each.end - EASE, each.end))
    return inside * sum(size * np.sin(2.0 * np.pi * t / period) for size, period in WAVES)
