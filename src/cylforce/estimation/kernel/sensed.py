"""From the values of all signals to channels: `estimation.channels.Channels.read`, of one sample, in plain numbers."""

from collections.abc import Sequence
from typing import Any

from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, as_counts, as_numbers, inner, record


@record
class KernelSensors:
    """N joints, C cylinders, D channels; numbers of signals, -1: not measured. `turned` (N, 2): each joint's encoder
    and its link's inclinometer; `pushed` (C, 3): each cylinder's force pin, head and rod side; `base` (D - N - C,):
    the base's inertial sensor, pitch, roll, slew; `tilts`: signals that may not exceed `most` [rad]; `areas` (C, 3):
    head side, rod side [m^2], pressure of a rod side that is not measured [Pa]."""

    n: Count
    c: Count
    d: Count
    tilt_size: Count
    most: Number
    turned: Counts
    pushed: Counts
    base: Counts
    tilts: Counts
    areas: Numbers
    arrays: object

    def __init__(self, sizes: Sequence[int], most: float, counts: list[Any], areas: list[Any]) -> None:
        """Everything in the order of the fields."""
        self.arrays = (counts, areas)
        self.n, self.c, self.d, self.tilt_size = (sizes[i] for i in range(4))
        self.most = most
        self.turned, self.pushed = as_counts(counts[0]), as_counts(counts[1])
        self.base, self.tilts = as_counts(counts[2]), as_counts(counts[3])
        self.areas = as_numbers(areas[0])


def sense(p: KernelSensors, values: Numbers, into: Numbers) -> Count:
    """The channels (D,) from the values of all signals; a joint without encoder and inclinometer keeps the angle that
    is there. Whether the chassis is tilted too far."""
    tilted = 0
    for i in range(p.tilt_size):
        tilted += abs(values[p.tilts[i]]) > p.most
    o = p.n + p.c
    for i in range(p.d - o):
        into[o + i] = values[p.base[i]] if p.base[i] >= 0 else 0.0
    inner_tilt = into[p.d - 3]
    for j in range(p.n):
        encoder, inclined = p.turned[2 * j], p.turned[2 * j + 1]
        if encoder >= 0:
            into[j] = values[encoder]
        elif inclined >= 0:
            into[j] = values[inclined] - inner_tilt
        inner_tilt = inner_tilt + into[j]
    for c in range(p.c):
        into[p.n + c] = force(p, values, c)
    return tilted


@inner
def force(p: KernelSensors, values: Numbers, c: Count) -> Number:
    """The force of a cylinder, p_head A_head - p_rod A_rod [N]; 0: not measured."""
    pin, head, rod = p.pushed[3 * c], p.pushed[3 * c + 1], p.pushed[3 * c + 2]
    if pin >= 0:
        return values[pin]
    if head < 0:
        return 0.0
    back = values[rod] if rod >= 0 else p.areas[3 * c + 2]
    return values[head] * p.areas[3 * c] - back * p.areas[3 * c + 1]
