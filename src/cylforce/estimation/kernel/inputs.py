"""Judgement of received values, as in `service.assembler` and `service.senders.supervision`: each value of a frame when
it is received, and at a tick which of them are usable. Also the integers of published values (`service.publication`).

The state is one array:
signals (S, 11): value, time of the last accepted and of the last value [us], reason, good, equal and implausible values
                 in a row, step, last implausible value, accepted steps, time after which the last value was measured
                 [us] (see `Channel`)
PDOs (P, 3):     time [us], excess, time of a second producer [us] (see `PdoRate`)
nodes (M, 3):    time of the heartbeat [us], state, whether a boot-up was received
counters (5):    frames with an unknown identifier, too short, too long; time of the last one that was too long, and of
                 the last frame of another node with our identifiers [us]

`layout.InputLayout` and `service.senders.channels` name these places."""

from math import floor
from typing import Any

from cylforce.estimation.kernel.plan import in_range, short_way
from cylforce.estimation.kernel.restricted import (
    Count,
    Counts,
    Number,
    Numbers,
    as_counts,
    as_numbers,
    inner,
    record,
    whole,
)

SIGNAL: Count = 11  # numbers of a signal
SENDER: Count = 3  # numbers of a PDO, or of a node
NEVER: Number = -4611686018427387904.0  # us, a time before all others
LARGEST: Number = 1.7976931348623157e308
JUMPS_BELIEVED: Number = 100.0  # implausible values in a row after which the new level is accepted as real; chosen
# A frame may be early by up to a period, and CAN itself may deliver one frame twice (error in the last bit of its end):
# any excess above these two was sent by another node
EXCESS: Number = 2.0
FORGOTTEN: Number = 0.9  # factor on a producer's allowance with each regular frame: gone in 0.2 s; chosen
OPERATIONAL: Number = 5.0
GOOD: Number = 0.0  # reasons by their numbers, see `signals.estimate.Reason`
STALE: Number = 3.0
OUT_OF_RANGE: Number = 4.0
NOT_A_NUMBER: Number = 5.0
FROZEN: Number = 6.0
JUMPED: Number = 7.0
SHORT: Number = 8.0
NOT_OPERATIONAL: Number = 22.0
TWO_PRODUCERS: Number = 30.0


@record
class KernelInputs:
    """Constants of S signals in P PDOs. PDO i has `items`[i] items, and the slots `first`[i] up to `first`[i + 1].

    first:         (P + 1,) first slot of each PDO
    signal, item:  signal of each slot, and its place among the PDO's items
    noisy:         (S,) whether equal values mean that the signal is frozen
    node:          (P,) node of each PDO
    items:         (P,) number of items
    scale, offset: of each slot, value = raw scale + offset [SI]
    low, high:     range of each slot [SI]
    missing:       raw value of each slot that means "no value"; NaN: none
    period:        (P,) shortest period of each PDO [us]
    patience:      (P,) time without a heartbeat after which the PDO's node is lost [us]; 0: not monitored
    fastest:       (S,) fastest change of each signal [SI/s]
    seconds:       (S,) period of each signal [s]
    noise:         (S,) noise of each signal [SI]
    late:          (S,) age above which each signal is late [us]
    turn:          (S,) change after which its values repeat [SI]; 0: never
    around:        of each slot as `turn`, but 0 except for joints
    hold:          time for which a last value is used [us]
    quiet:         time since the last sign of a second producer after which it is gone [us]
    frozen:        equal values in a row at which a signal is frozen
    needed:        good values in a row at which a signal is used again
    """

    s: Count
    p: Count
    first: Counts
    signal: Counts
    item: Counts
    noisy: Counts
    node: Counts
    items: Counts
    scale: Numbers
    offset: Numbers
    low: Numbers
    high: Numbers
    missing: Numbers
    period: Numbers
    patience: Numbers
    fastest: Numbers
    seconds: Numbers
    noise: Numbers
    late: Numbers
    turn: Numbers
    around: Numbers
    hold: Number
    quiet: Number
    frozen: Number
    needed: Number
    arrays: object

    def __init__(self, counts: list[Any], numbers: list[Any]) -> None:
        """Everything in the order of the fields; the last numbers are the four limits."""
        self.arrays = (counts, numbers)
        self.s, self.p = len(counts[3]), len(counts[4])
        self.first, self.signal, self.item = as_counts(counts[0]), as_counts(counts[1]), as_counts(counts[2])
        self.noisy, self.node, self.items = as_counts(counts[3]), as_counts(counts[4]), as_counts(counts[5])
        self.scale, self.offset = as_numbers(numbers[0]), as_numbers(numbers[1])
        self.low, self.high, self.missing = as_numbers(numbers[2]), as_numbers(numbers[3]), as_numbers(numbers[4])
        self.period, self.patience = as_numbers(numbers[5]), as_numbers(numbers[6])
        self.fastest, self.seconds, self.noise = as_numbers(numbers[7]), as_numbers(numbers[8]), as_numbers(numbers[9])
        self.late, self.turn, self.around = as_numbers(numbers[10]), as_numbers(numbers[11]), as_numbers(numbers[12])
        self.hold, self.quiet, self.frozen, self.needed = (numbers[13][i] for i in range(4))


def receive(
    p: KernelInputs, state: Numbers, sorts: Counts, number: Count, times: Numbers, raw: Numbers, moving: Numbers
) -> None:
    """Update the `state` with a `number` of frames.

    sorts:  (number, 2) PDO of each frame, then -1 too short, 0 as mapped, 1 too long
    times:  (number,) [us]
    raw:    values of all items of each frame; none of a frame that is too short
    moving: (S,) not 0 where an equal value means that the sensor is frozen
    """
    at = 0
    for k in range(number):
        pdo, sort = sorts[2 * k], sorts[2 * k + 1]
        take_frame(p, state, times[k], pdo, sort, raw, at, moving)
        at += 0 if sort < 0 else p.items[pdo]


@inner
def take_frame(
    p: KernelInputs, state: Numbers, t_us: Number, pdo: Count, sort: Count, raw: Numbers, at: Count, moving: Numbers
) -> None:
    """Update the state with one frame, whose items begin at `at`."""
    paced(p, state, t_us, pdo)
    for i in range(p.first[pdo], p.first[pdo + 1]):
        o = SIGNAL * p.signal[i]
        if sort < 0:
            state[o + 3], state[o + 4] = SHORT, 0.0
        else:
            judge(p, state, t_us, i, raw[at + p.item[i]], moving[p.signal[i]])
    if sort != 0:
        frames = SIGNAL * p.s + SENDER * p.p + SENDER * nodes(p)
        state[frames + (1 if sort < 0 else 2)] += 1.0
        if sort > 0:
            state[frames + 3] = t_us


@inner
def nodes(p: KernelInputs) -> Count:
    """Return the number of nodes."""
    found = 0
    for i in range(p.p):
        found = max(found, p.node[i] + 1)
    return found


@inner
def paced(p: KernelInputs, state: Numbers, t_us: Number, pdo: Count) -> None:
    """Update the rate of a PDO with one more frame.

    `excess` sums 1 - dt/period over the frames. For one producer it stays within the jitter, whatever the number of
    frames; it grows by one with each frame of another. After a pause a producer may send at once the frames that waited
    while the bus or the reader was busy. Regular frames reduce this allowance again. With the first PDO after a boot, a
    pause or a step of the clock, the heartbeat of its node is given its whole time once more."""
    o = SIGNAL * p.s + SENDER * pdo
    before = state[o]
    dt = (t_us - before) / p.period[pdo]
    state[o] = t_us
    if before == NEVER or dt < 0.0:
        state[o + 1] = 0.0
    else:
        excess = state[o + 1] + 1.0 - dt
        if 0.5 <= dt <= 1.5:  # a regular frame: the nearest multiple of the period is one
            excess = max(excess, FORGOTTEN * excess)
        if excess > EXCESS:
            state[o + 1], state[o + 2] = 1.0, t_us  # the next two frames of the other one are the next sign
        else:
            state[o + 1] = excess
    node = SIGNAL * p.s + SENDER * p.p + SENDER * p.node[pdo]
    received = state[node] != NEVER or state[node + 2] != 0.0
    if received and (before == NEVER or not 0.0 <= t_us - before <= p.patience[pdo]):
        state[node] = t_us


@inner
def judge(p: KernelInputs, state: Numbers, t_us: Number, slot: Count, raw: Number, moving: Number) -> None:
    """Update a signal with one more value."""
    k = p.signal[slot]
    o, read = SIGNAL * k, raw * p.scale[slot] + p.offset[slot]
    value, largest = read, -p.missing[slot] - 1.0  # 7FFFh of a signed number is the error code of many sensors
    if raw != largest:
        value = in_range(read, p.low[slot], p.high[slot], p.around[slot])
    seen, by = state[o + 2], implausible_step(p, state, t_us, k, value)
    state[o + 10] = measured_after(p, state, t_us, k)
    if raw == p.missing[slot] or not abs(value) <= LARGEST:
        state[o + 2], state[o + 3], state[o + 4] = t_us, NOT_A_NUMBER, 0.0
        return
    if not p.low[slot] <= value <= p.high[slot]:
        state[o + 2], state[o + 3], state[o + 4] = t_us, OUT_OF_RANGE, 0.0
        return
    if by != 0.0 and state[o + 6] < JUMPS_BELIEVED:
        state[o + 2], state[o + 3], state[o + 4] = t_us, JUMPED, 0.0
        state[o + 6] += 1.0
        state[o + 7], state[o + 8] = by, value
        return
    equal = 0.0 if value != state[o] else state[o + 5] + moving
    state[o + 2], state[o + 5] = t_us, equal
    if equal >= p.frozen and p.noisy[k]:
        state[o + 3], state[o + 4] = FROZEN, 0.0
        return
    good = state[o + 4] + 1.0 if t_us - seen <= p.hold else 1.0
    state[o], state[o + 4], state[o + 6], state[o + 9] = value, good, 0.0, state[o + 9] + by
    if t_us - state[o + 1] <= p.hold or good >= p.needed:
        state[o + 1], state[o + 3], state[o + 7], state[o + 8] = t_us, GOOD, 0.0, 0.0


@inner
def measured_after(p: KernelInputs, state: Numbers, t_us: Number, k: Count) -> Number:
    """Return the time [us] after which a value was measured that is received now, however long it then waited for the
    bus.

    It is the time at which the value before was received. Values that follow each other in less than half a period have
    waited, and were measured a period apart."""
    o, period = SIGNAL * k, 1e6 * p.seconds[k]
    if t_us - state[o + 2] > 0.5 * period:
        return state[o + 2]
    return min(state[o + 2], state[o + 10] + period)


@inner
def implausible_step(p: KernelInputs, state: Numbers, t_us: Number, k: Count, value: Number) -> Number:
    """Return the error of a value whose signal stepped by more than is plausible; 0: it did not.

    Plausible is the fastest change times the time between two values, plus the noise. Time during which values were not
    yet accepted does not count, because the joint need not have moved then. Time that the value before may have waited
    for the bus counts. After a step the signal continues from there, until it steps back."""
    if p.fastest[k] > LARGEST:
        return 0.0
    o = SIGNAL * k
    if state[o + 6] != 0.0:
        by = short_way(value - state[o + 8], p.turn[k])
        jump = state[o + 7] + (by if abs(by) > room_since(p, state, t_us, k, state[o + 2]) else 0.0)
        return jump if abs(jump) > room_for(p, k, 0.0) else 0.0
    proving = t_us - state[o + 1] > p.hold and state[o + 4] > 0.0
    by = short_way(value - state[o], p.turn[k])
    since = state[o + 2] if proving else state[o + 1]
    return by if abs(by) > room_since(p, state, t_us, k, since) else 0.0


@inner
def room_since(p: KernelInputs, state: Numbers, t_us: Number, k: Count, since: Number) -> Number:
    """Return the largest plausible change of a signal since a value that was received at `since` [us]."""
    waited = max(0.0, since - state[SIGNAL * k + 10] - 1e6 * p.seconds[k])
    return room_for(p, k, 1e-6 * (t_us - since + waited))


@inner
def room_for(p: KernelInputs, k: Count, seconds: Number) -> Number:
    """Return the largest plausible change of a signal in a time [s], but at least in one of its periods."""
    return p.fastest[k] * max(seconds, p.seconds[k]) + p.noise[k]


def usable(p: KernelInputs, state: Numbers, t_us: Number, found: Numbers) -> Count:
    """Judge the signals at a tick, and return the number of signals that are not usable.

    The last value of a signal that is late or was refused is used for `hold`; after that the signal is invalid.

    found: (2 S + 2,) value of each signal, reason why each is not usable, reason why one of them is late, number of
           stepped signals
    """
    for k in range(p.s):
        o = SIGNAL * k
        age, reason = t_us - state[o + 1], state[o + 3]
        found[k], found[p.s + k] = state[o], GOOD
        if not -p.hold <= age <= p.hold:  # a negative age: the clock was set back meanwhile
            found[p.s + k] = STALE if reason == GOOD else reason
        elif reason != GOOD or age > p.late[k]:
            found[2 * p.s] = STALE if reason == GOOD else reason
    distrust(p, state, t_us, found)
    bad, found[2 * p.s + 1] = 0, 0.0
    for k in range(p.s):
        bad += found[p.s + k] != GOOD
        if has_stepped(p, state, k):
            found[2 * p.s + 1] += 1.0
    return bad


@inner
def distrust(p: KernelInputs, state: Numbers, t_us: Number, found: Numbers) -> None:
    """Set the reasons of signals whose node was not operational and alive when its PDO came, or whose PDO another node
    sends as well.

    A node whose heartbeat was never received is not judged by it."""
    for i in range(p.p):
        o = SIGNAL * p.s + SENDER * i
        node, why = SIGNAL * p.s + SENDER * p.p + SENDER * p.node[i], GOOD
        if state[node] != NEVER and p.patience[i] > 0.0:
            runs = state[node + 1] == OPERATIONAL and state[o] - state[node] <= p.patience[i]
            why = GOOD if runs else NOT_OPERATIONAL
        if abs(t_us - state[o + 2]) < p.quiet:
            why = TWO_PRODUCERS
        for j in range(p.first[i], p.first[i + 1]):
            k = p.s + p.signal[j]
            found[k] = max(found[k], why)


@inner
def has_stepped(p: KernelInputs, state: Numbers, k: Count) -> Count:
    """Return whether a signal stepped and stayed there."""
    by = state[SIGNAL * k + 9]
    return 1 if by != 0.0 and abs(by) > room_for(p, k, 0.0) else 0


def stepped(p: KernelInputs, state: Numbers, found: Numbers) -> None:
    """Set `found` (S,) to 1 where a signal stepped and stayed there."""
    for k in range(p.s):
        found[k] = has_stepped(p, state, k)


def quantise(size: Count, limits: Numbers, values: Numbers, found: Counts) -> None:
    """Set `found` (N,) to the integers that are sent of `values` (N,): the nearest one, of two the even one.

    limits: (N, 4) smallest and largest value, step, and the integer that means "no value" for values outside
    """
    for i in range(size):
        found[i] = whole(limits[4 * i + 3])
        if limits[4 * i] <= values[i] <= limits[4 * i + 1]:
            steps = values[i] / limits[4 * i + 2]
            below = floor(steps)
            odd, rest = below - 2.0 * floor(0.5 * below), steps - below
            found[i] = whole(below + 1.0 if rest > 0.5 or (rest == 0.5 and odd != 0.0) else below)
