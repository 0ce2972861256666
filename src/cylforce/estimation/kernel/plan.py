"""What the kernel knows of a machine, of the columns of its effects and of the filters; `making.py` makes it."""

from typing import Any

from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, record


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

    def __init__(self, sizes: Counts, physics: Numbers, counts: list[Any], numbers: list[Any]) -> None:
        """Everything in the order of the fields."""
        self.n, self.c, self.r, self.k, self.d = sizes[0], sizes[1], sizes[2], sizes[3], sizes[4]
        self.law_size, self.waits, self.rate_slew, self.inertial, self.tip = (sizes[i] for i in range(5, 10))
        self.gravity, self.axis, self.base_x, self.base_z, self.dt = (physics[i] for i in range(5))
        self.row, self.acting, self.bodies, self.rigid, self.slewed = counts[:5]
        self.rocker, self.weight, self.laws, self.levers, self.used, self.moved, self.good = counts[5:]
        self.used_size, self.moved_size, self.lever_size = len(self.used), len(self.moved), len(self.levers) // 3
        self.lengths, self.arm, self.pins, self.bars, self.stops, self.shapes = numbers[:6]
        self.channel, self.mean, self.begun, self.slope, self.rest = numbers[6:11]
        self.quick, self.settled, self.slow, self.middle, self.rate = numbers[11:16]
        self.q, self.qd, self.turn, self.level, self.hinge, self.riders = numbers[16:22]
        self.lever, self.speed, self.pushes, self.momentum, self.static, self.torque = numbers[22:]
