"""What the kernel knows of a machine, of the columns of its effects and of the filters, and of its signals, from which
come the channels (`estimation.channels.Channels.read`, of one sample); `making.py` makes it."""

from collections.abc import Sequence
from math import floor
from typing import Any

from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, as_counts, as_numbers, inner, record


@record
class KernelPlan:
    """N joints, C cylinders, R rows (measured torques), K columns, D channels, L force laws; after them the places of
    intermediate results, which every step overwrites, so that one plan serves one thread.

    `row` (N,): row of each joint, -1: none; `acting` (R, C): 1 where a cylinder acts on a row's joint; `bodies` (C, 3)
    of foot, eye or rocker pin, link pin (-1: no four-bar); `pins` (C, 6): their x, z [m]; `bars` (C, 6): lengths of
    rocker and link [m], side, eye x, z, half the shortest length [m]; `stops` (C, 2): usable lengths [m].

    Numbers of columns: `rigid` (N, 3), `slewed` (N, 2) or empty, `tip` of three, `rocker` and `weight` (C,), -1: none.
    `laws` (L, 2): kind and first column; `shapes` (L, 2): numbers of the law; `levers` (A, 3): of each that is not
    always zero its place among (C, N), row K + cylinder, and the cylinder. `used`: places of a (R, K) table that can
    differ from zero, `moved`: those with momentum; `waits`: steps for which a bad lever spoils a row."""

    n: Count
    c: Count
    r: Count
    k: Count
    d: Count
    law_size: Count
    used_size: Count
    moved_size: Count
    lever_size: Count
    slewed_size: Count
    waits: Count
    rate_slew: Count
    inertial: Count
    gravity: Number
    axis: Number
    base_x: Number
    base_z: Number
    dt: Number
    row: Counts
    acting: Counts
    bodies: Counts
    rigid: Counts
    slewed: Counts
    tip: Count
    rocker: Counts
    weight: Counts
    laws: Counts
    levers: Counts
    used: Counts
    moved: Counts
    lengths: Numbers
    arm: Numbers
    pins: Numbers
    bars: Numbers
    stops: Numbers
    shapes: Numbers
    channel: Numbers
    mean: Numbers
    begun: Numbers
    slope: Numbers
    rest: Numbers
    quick: Numbers
    settled: Numbers
    slow: Numbers
    middle: Numbers
    rate: Numbers
    q: Numbers
    qd: Numbers
    turn: Numbers
    level: Numbers
    hinge: Numbers
    riders: Numbers
    lever: Numbers
    speed: Numbers
    pushes: Numbers
    good: Counts
    momentum: Numbers
    static: Numbers
    torque: Numbers
    arrays: object

    def __init__(self, sizes: Sequence[int], physics: Sequence[float], counts: list[Any], numbers: list[Any]) -> None:
        """Everything in the order of the fields."""
        self.arrays = (counts, numbers)
        self.n, self.c, self.r, self.k, self.d = sizes[0], sizes[1], sizes[2], sizes[3], sizes[4]
        self.law_size, self.waits, self.rate_slew, self.inertial, self.tip = (sizes[i] for i in range(5, 10))
        self.gravity, self.axis, self.base_x, self.base_z, self.dt = (physics[i] for i in range(5))
        self.row, self.acting = as_counts(counts[0]), as_counts(counts[1])
        self.bodies, self.rigid = as_counts(counts[2]), as_counts(counts[3])
        self.slewed, self.rocker = as_counts(counts[4]), as_counts(counts[5])
        self.weight, self.laws = as_counts(counts[6]), as_counts(counts[7])
        self.levers, self.used = as_counts(counts[8]), as_counts(counts[9])
        self.moved, self.good = as_counts(counts[10]), as_counts(counts[11])
        self.used_size, self.moved_size, self.lever_size = len(counts[9]), len(counts[10]), len(counts[8]) // 3
        self.slewed_size = len(counts[4])
        self.lengths, self.arm = as_numbers(numbers[0]), as_numbers(numbers[1])
        self.pins, self.bars = as_numbers(numbers[2]), as_numbers(numbers[3])
        self.stops, self.shapes = as_numbers(numbers[4]), as_numbers(numbers[5])
        self.channel, self.mean = as_numbers(numbers[6]), as_numbers(numbers[7])
        self.begun, self.slope = as_numbers(numbers[8]), as_numbers(numbers[9])
        self.rest, self.quick = as_numbers(numbers[10]), as_numbers(numbers[11])
        self.settled, self.slow = as_numbers(numbers[12]), as_numbers(numbers[13])
        self.middle, self.rate = as_numbers(numbers[14]), as_numbers(numbers[15])
        self.q, self.qd = as_numbers(numbers[16]), as_numbers(numbers[17])
        self.turn, self.level = as_numbers(numbers[18]), as_numbers(numbers[19])
        self.hinge, self.riders = as_numbers(numbers[20]), as_numbers(numbers[21])
        self.lever, self.speed = as_numbers(numbers[22]), as_numbers(numbers[23])
        self.pushes, self.momentum = as_numbers(numbers[24]), as_numbers(numbers[25])
        self.static, self.torque = as_numbers(numbers[26]), as_numbers(numbers[27])


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


@inner
def in_range(value: Number, low: Number, high: Number, turn: Number) -> Number:
    """The value of a signal that repeats after a `turn` (0: never), with one turn more or less where that leads into
    its range: wherever the circle of its sensor ends, the direction is one that is possible. More than one turn no
    sensor of a circle is off."""
    if turn <= 0.0 or low <= value <= high:
        return value
    other = value - turn if value > high else value + turn
    return other if low <= other <= high else value


@inner
def short_way(by: Number, turn: Number) -> Number:
    """By how much a signal that repeats after a `turn` (0: never) changed where its reading changed `by` so much: a
    sensor that passes the end of its circle goes on at the other end, which is a turn less."""
    finite = by - by == 0.0
    if turn <= 0.0 or not finite or abs(by) <= 0.5 * turn:
        return by
    return by - turn * floor(by / turn + 0.5)
