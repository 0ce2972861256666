"""Motion of the simulated machine's chassis while an effect of the kind `BaseMotion` acts."""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import numpy as np

from cylforce.effects.imposed import Imposed, base_motions
from cylforce.effects.loads.carried import smooth
from cylforce.signals.estimate import Array

WAVES = ((0.11, 9.0), (0.05, 5.2))  # amplitude [rad] and period [s] of the waves of the pitch; chosen
EASE = 3.0  # s, over which the swing starts and stops; chosen
STEP = 1e-3  # s, of the finite differences for rate and acceleration; chosen: rounding and truncation both negligible


class Swing(NamedTuple):
    """Swing of the chassis about its pitch axis.

    angle:        (T,) [rad]
    rate:         (T,) [rad/s]
    acceleration: (T,) [rad/s^2]
    """

    angle: Array
    rate: Array
    acceleration: Array


def swing(effects: Sequence[Imposed], t: Array) -> Swing:
    """Return the swing of the chassis at times t (T,) [s] of the run; zero unless an effect of nonzero size moves it.

    The swing is that of WAVES for each such effect, whatever its sizes.
    """
    found = np.zeros((3, len(t)))
    for _, each in base_motions(effects):
        if any(each.sizes):
            before, now, after = (_swung(each, t + s) for s in (-STEP, 0.0, STEP))
            found += now, (after - before) / (2.0 * STEP), (after - 2.0 * now + before) / STEP**2
    return Swing(*found)


def _swung(effect: Imposed, t: Array) -> Array:
    """Return the angle (T,) [rad] of the swing while an effect acts, at times t (T,) [s] of the run.

    It begins and ends smoothly within EASE [s], and does not depend on the sizes of the effect.
    """
    inside = smooth(t, effect.begin, effect.begin + EASE)
    if effect.end < inf:
        inside = inside * (1.0 - smooth(t, effect.end - EASE, effect.end))
    return inside * sum(size * np.sin(2.0 * np.pi * t / period) for size, period in WAVES)
