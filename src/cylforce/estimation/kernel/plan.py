"""Constants of a machine, of its effects' columns and filters, and of its signals (`making.py` makes them); and the
channels of one sample (`estimation.channels.Channels.read`)."""

from collections.abc import Sequence
from math import floor
from typing import Any

from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, as_counts, as_numbers, inner, record


@record
class KernelPlan:
    """Constants of N joints, C cylinders, R rows (measured torques), K columns, D channels and L force laws, and room
    for intermediate results. Every step overwrites that room, so that one plan serves one thread.

    n, c, r, k, d:    sizes N, C, R, K, D
    law_size, used_size, moved_size, lever_size, slewed_size: numbers of laws, of places in `used`, in `moved`, of
                      `levers` and of places in `slewed`
    waits:            steps for which a bad lever spoils a row
    rate_slew:        1 where the slew rate is measured
    inertial:         1 where the base has an inertial sensor
    gravity:          [m/s^2]
    axis:             distance of the first pin from the slew axis [m]
    base_x, base_z:   place of the inertial sensor from the first pin [m]
    dt:               fixed step [s]
    row:              (N,) row of each joint, -1: none
    acting:           (R, C) 1 where a cylinder acts on a row's joint
    bodies:           (C, 3) of foot, eye or rocker pin, link pin (-1: no four-bar)
    rigid:            (N, 3) columns of J, X, Z
    slewed:           (N, 2) columns of D_excess, E, or empty
    tip:              first of three columns of the tool
    rocker, weight:   (C,) column of the bars, of the cylinder's weight, -1: none
    laws:             (L, 2) kind and first column
    levers:           (A, 3) of each lever that is not always zero its place among (C, N), row K + cylinder, and the
                      cylinder
    used:             places of a (R, K) table that can differ from zero
    moved:            those of them with momentum
    lengths:          (N,) of the links [m]
    arm:              (N, 2) x, z from each link's pin to the next one, or to the tool [m]
    pins:             (C, 6) x, z of the pins in `bodies` [m]
    bars:             (C, 6) lengths of rocker and link [m], side, eye x, z, half the shortest length [m]
    stops:            (C, 2) usable lengths [m]
    shapes:           (L, 2) constants of each law
    channel:          (5,) low-pass of the channels, b0, b1, b2, a1, a2
    mean:             (7,) filter of static columns and torques, b0 to b3, a1 to a3
    begun:            (3,) its state before a first input of 1 after zeros
    slope:            (2,) b0 and b3 of the filter of momentum; its b1 and b2 are 0, its a1 to a3 those of `mean`
    rest:             (3,) its state settled at the input 1, with output 0
    quick:            (5,) low-pass of the forces, b0, b1, b2, a1, a2
    settled:          (2,) its state settled at the input 1
    slow:             (3,) low-pass of the inertia, b0, b1, a1
    middle, rate:     (D,) smoothed channels and their rates [1/s]
    q, qd, turn, level, hinge: angles, rates, directions and pins of the links, see `bodies.set_links`
    riders:           points that move, see `bodies`
    lever:            (C, N) [m/rad]
    speed:            (C,) [m/s]
    pushes:           (C,) force of a law per unit of its parameter
    good:             (C,) 1 where a cylinder's force is used
    momentum, static: (R, K) columns
    torque:           (R + 1,) measured torques [N m], then the squared slew rate [rad^2/s^2]
    arrays:           the lists of arrays, kept so that the memory of the fields above remains
    """

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
        """Set the constants of a machine's geometry, columns and filters from lists in the order of `making.plan`.

        sizes:   numbers of joints (n), cylinders (c), measured torques (r), columns (k), channels (d) and force laws;
                 steps for which a bad lever spoils a row; whether the slew rate is measured, and whether the base has
                 an inertial sensor; first column of the tool
        physics: gravity [m/s^2]; distance of the first pin from the slew axis [m]; place x, z of the inertial sensor
                 from that pin [m]; fixed step [s]
        counts:  arrays of integers: row of each joint, cylinders that act on each row, bodies of the cylinders' pins;
                 columns of the links, of slewing, of the weights of four-bars and cylinders, and of the force laws;
                 places of the levers and of the columns that can differ from zero; room for the usable cylinders
        numbers: arrays of numbers: lengths of the links, pins, bars and stops of the cylinders [m], constants of the
                 force laws; coefficients and first states of the filters; room for the motion of one instant, its
                 columns and its torques
        """
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
    """Sources of D channels of N joints and C cylinders, as numbers of signals; -1: not measured.

    n, c, d:   sizes N, C, D
    tilt_size: number of `tilts`
    most:      largest tilt [rad]
    turned:    (N, 2) encoder of each joint, and inclinometer of its link
    pushed:    (C, 3) force pin, head and rod side of each cylinder
    base:      (D - N - C,) inertial sensor of the base, pitch, roll, slew
    tilts:     signals that may not exceed `most`
    areas:     (C, 3) head side, rod side [m^2], pressure of a rod side that is not measured [Pa]
    arrays:    the lists of arrays, kept so that the memory of the fields above remains
    """

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
        """Set which signals give the channels of a sample, from lists in the order of `making.sensors`.

        sizes:  numbers of joints (n), of cylinders (c), of channels (d) and of signals of tilt
        most:   largest tilt of the chassis that is used [rad]
        counts: arrays of numbers of signals, -1: not measured: encoder and inclinometer of each joint; force pin, head
                and rod pressure of each cylinder; motion of the base; tilts of the chassis
        areas:  a list of one array: areas of head and rod side [m^2] and fixed rod pressure [Pa] of each cylinder
        """
        self.arrays = (counts, areas)
        self.n, self.c, self.d, self.tilt_size = (sizes[i] for i in range(4))
        self.most = most
        self.turned, self.pushed = as_counts(counts[0]), as_counts(counts[1])
        self.base, self.tilts = as_counts(counts[2]), as_counts(counts[3])
        self.areas = as_numbers(areas[0])


def read_channels(p: KernelSensors, values: Numbers, into: Numbers) -> Count:
    """Compute the channels from the values of all signals, and return how many tilts of the chassis are too large.

    The D channels are N joint angles [rad], C cylinder forces [N], then motion of the base: with an inertial sensor its
    rate [rad/s] and two specific forces [m/s^2]; pitch and roll [rad], slew rate [rad/s] or angle [rad]. An
    inclinometer measures a link's angle from the true horizontal: the angles of the joints before it and the pitch are
    subtracted.

    Read:
    values: (S,) of all signals [SI]

    Read and written:
    into:   (D,) channels; a joint without encoder and inclinometer keeps the angle that it contains
    """
    tilted = 0
    for i in range(p.tilt_size):
        tilted += abs(values[p.tilts[i]]) > p.most
    base = p.n + p.c  # place of the motion of the base
    for i in range(p.d - base):
        into[base + i] = values[p.base[i]] if p.base[i] >= 0 else 0.0
    inner_tilt = into[p.d - 3]  # pitch, then the angle of the link before from the true horizontal
    for j in range(p.n):
        encoder, inclinometer = p.turned[2 * j], p.turned[2 * j + 1]
        if encoder >= 0:
            into[j] = values[encoder]
        elif inclinometer >= 0:
            into[j] = values[inclinometer] - inner_tilt
        inner_tilt = inner_tilt + into[j]
    for c in range(p.c):
        into[p.n + c] = force(p, values, c)
    return tilted


@inner
def force(p: KernelSensors, values: Numbers, c: Count) -> Number:
    """Return the force of cylinder c [N], positive when it pushes; 0 where it is not measured.

    It is that of a force pin, or p_head A_head - p_rod A_rod. A rod side that is not measured has a fixed pressure.

    Read:
    values: (S,) of all signals [SI]
    """
    pin, head, rod = p.pushed[3 * c], p.pushed[3 * c + 1], p.pushed[3 * c + 2]  # signals; -1: not measured
    if pin >= 0:
        return values[pin]
    if head < 0:
        return 0.0
    back = values[rod] if rod >= 0 else p.areas[3 * c + 2]
    return values[head] * p.areas[3 * c] - back * p.areas[3 * c + 1]


@inner
def in_range(value: Number, low: Number, high: Number, turn: Number) -> Number:
    """Return the value of a signal, moved by one turn if it is out of range and that leads into its range.

    Sensors of the same joint may begin their circle at different directions. No sensor is off by more than one turn.

    value:     [SI]
    low, high: range [SI]
    turn:      change after which the readings repeat [SI]; 0: never
    """
    if turn <= 0.0 or low <= value <= high:
        return value
    other = value - turn if value > high else value + turn
    return other if low <= other <= high else value


@inner
def short_way(by: Number, turn: Number) -> Number:
    """Return the change of a signal, the shorter way round its circle.

    A sensor that passes the end of its circle continues at the other end, one turn less. A change that is not finite is
    returned as it is.

    by:   change of the reading [SI]
    turn: change after which the readings repeat [SI]; 0: never
    """
    finite = by - by == 0.0
    if turn <= 0.0 or not finite or abs(by) <= 0.5 * turn:
        return by
    return by - turn * floor(by / turn + 0.5)
