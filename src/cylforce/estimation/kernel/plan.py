"""What the kernel knows of a machine, of the columns of its effects and of the filters; `making.py` makes it."""

from collections.abc import Sequence
from typing import Any

from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, as_counts, as_numbers, record


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
