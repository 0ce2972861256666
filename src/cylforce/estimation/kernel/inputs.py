"""Judgement of received values, as in `service.assembler` and `service.senders.supervision`: each value of a frame when
it is received, and at a tick which of them are usable. Also the integers of published values (`service.publication`).

The state is one array:
signals (S, 11): value, time of the last accepted and of the last value [us], reason, good, equal and implausible values
                 in a row, step, last implausible value, accepted steps, time after which the last value was measured
                 [us] (see `Channel`)
PDOs (P, 3):     time of the last frame [us], surplus of frames, time of the last sign of a second producer [us] (see
                 `PdoRate`)
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

SIGNAL: Count = 11  # numbers of a signal, in the order of `senders.channels.Channel`:
VALUE: Count = 0  # last accepted value [SI]; last received one while too few good values were received
ACCEPTED_US: Count = 1  # time of the last accepted value [us]
RECEIVED_US: Count = 2  # time of the last received value, good or not [us]
REASON: Count = 3  # of the last received value, as a number of `Reason`
GOOD_VALUES: Count = 4  # good values in a row
EQUAL_VALUES: Count = 5  # equal values in a row while the machine moved
JUMPS: Count = 6  # implausible values in a row
JUMP: Count = 7  # difference of the last of them from the value before the step [SI]
JUMPED_TO: Count = 8  # last implausible value [SI]
STEPPED: Count = 9  # sum of the steps that were accepted [SI]
SINCE_US: Count = 10  # earliest time at which the last received value was measured [us]
SENDER: Count = 3  # numbers of a PDO, in the order of `PdoRate`, or of a node, in the order of `LastHeartbeat`:
FRAME_US: Count = 0  # time of the PDO's last frame [us]
SURPLUS: Count = 1  # frames beyond those of one producer
DOUBLED_US: Count = 2  # time of the last sign of a second producer [us]
HEARTBEAT_US: Count = 0  # time of the node's last heartbeat [us]
NMT_STATE: Count = 1
BOOTED: Count = 2  # 1 after a boot-up message
UNKNOWN_FRAMES: Count = 0  # counters
SHORT_FRAMES: Count = 1
LONG_FRAMES: Count = 2
LONG_US: Count = 3  # time of the last frame that was too long [us]
NEVER: Number = -4611686018427387904.0  # us, a time before all others
LARGEST: Number = 1.7976931348623157e308  # the largest finite number
JUMPS_BELIEVED: Number = 100.0  # implausible values in a row after which the new level is accepted as real; chosen
# A frame may be early by up to a period, and CAN itself may deliver one frame twice (error in the last bit of its end):
# any excess above these two was sent by another node
EXCESS: Number = 2.0
FORGOTTEN: Number = 0.9  # factor on a producer's allowance with each regular frame: gone in 0.2 s; chosen
OPERATIONAL: Number = 5.0  # state of a node (CANopen NMT) in which it sends PDOs
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

    s, p:          sizes S, P
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
    period_s:      (S,) period of each signal [s]
    noise:         (S,) noise of each signal [SI]
    late:          (S,) age above which each signal is late [us]
    turn:          (S,) change after which its values repeat [SI]; 0: never
    around:        of each slot as `turn`, but 0 except for joints
    hold:          time for which a last value is used [us]
    quiet:         time since the last sign of a second producer after which it is gone [us]
    frozen:        equal values in a row at which a signal is frozen
    needed:        good values in a row at which a signal is used again
    arrays:        the lists of arrays, kept so that the memory of the fields above remains
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
    period_s: Numbers
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
        """Set the constants of all signals and PDOs from lists. A slot is a field of a PDO that carries a signal.

        counts:  arrays of integers: first slot of each PDO; signal of each slot, and its place among the PDO's items;
                 whether equal values of each signal mean that it is frozen; node of each PDO, and its number of items
        numbers: arrays of numbers: of each slot scale, offset and range [SI], and the raw value that means "no value";
                 of each PDO its shortest period and the longest wait for a heartbeat [us]; of each signal its fastest
                 change [SI/s], period [s], noise [SI], age above which it is late [us], and turn after which it repeats
                 [SI]; of each slot that turn for joints only; last four limits: hold and quiet [us], frozen and needed
                 values
        """
        self.arrays = (counts, numbers)
        self.s, self.p = len(counts[3]), len(counts[4])
        self.first, self.signal, self.item = as_counts(counts[0]), as_counts(counts[1]), as_counts(counts[2])
        self.noisy, self.node, self.items = as_counts(counts[3]), as_counts(counts[4]), as_counts(counts[5])
        self.scale, self.offset = as_numbers(numbers[0]), as_numbers(numbers[1])
        self.low, self.high, self.missing = as_numbers(numbers[2]), as_numbers(numbers[3]), as_numbers(numbers[4])
        self.period, self.patience = as_numbers(numbers[5]), as_numbers(numbers[6])
        self.fastest, self.period_s, self.noise = as_numbers(numbers[7]), as_numbers(numbers[8]), as_numbers(numbers[9])
        self.late, self.turn, self.around = as_numbers(numbers[10]), as_numbers(numbers[11]), as_numbers(numbers[12])
        self.hold, self.quiet, self.frozen, self.needed = (numbers[13][i] for i in range(4))


@inner
def pdo_at(p: KernelInputs, pdo: Count) -> Count:
    """Return the place of a PDO in the state, after the S signals."""
    return SIGNAL * p.s + SENDER * pdo


@inner
def node_at(p: KernelInputs, node: Count) -> Count:
    """Return the place of a node in the state, after the P PDOs."""
    return SIGNAL * p.s + SENDER * p.p + SENDER * node


def receive(
    p: KernelInputs, state: Numbers, frame_kinds: Counts, number: Count, times: Numbers, raw: Numbers, moving: Numbers
) -> None:
    """Update the state of signals and producers with the frames that have been received since the last call.

    number: of frames

    Read:
    frame_kinds: (number, 2) PDO of each frame; then -1 if it is shorter than its mapping, 0 as long, 1 longer
    times:       (number,) at which each was received [us]
    raw:         values of all items of one frame after the other, not scaled; a frame that is too short has none
    moving:      (S,) 1 where a repeated value means that the sensor is frozen, else 0

    Read and written:
    state:       of signals, PDOs, nodes and counters (`layout.InputLayout`)
    """
    at = 0
    for k in range(number):
        pdo, length_sign = frame_kinds[2 * k], frame_kinds[2 * k + 1]
        take_frame(p, state, times[k], pdo, length_sign, raw, at, moving)
        at += 0 if length_sign < 0 else p.items[pdo]


@inner
def take_frame(
    p: KernelInputs,
    state: Numbers,
    t_us: Number,
    pdo: Count,
    length_sign: Count,
    raw: Numbers,
    raw_at: Count,
    moving: Numbers,
) -> None:
    """Update the state with one frame: the rate of its PDO, its signals, and the counters of wrong lengths.

    The rate shows whether a second producer sends the same PDO (`update_rate`). A frame that is too short has no values
    in `raw`: all its signals are refused as SHORT. A frame that is too long is used, and its time is stored. An item is
    any field of a PDO, a slot one that carries a signal.

    t_us:        at which it was received [us]
    pdo:         number of its PDO
    length_sign: -1 if it is shorter than its mapping, 0 as long, 1 longer
    raw_at:      place in `raw` of its first item; not used if it is too short

    Read:
    raw:         values of the items of all frames that are not too short, not scaled
    moving:      (S,) 1 where a repeated value means that the sensor is frozen, else 0

    Read and written:
    state:       of signals, PDOs, nodes and counters (`layout.InputLayout`)
    """
    update_rate(p, state, t_us, pdo)
    for slot in range(p.first[pdo], p.first[pdo + 1]):
        signal = SIGNAL * p.signal[slot]
        if length_sign < 0:
            state[signal + REASON], state[signal + GOOD_VALUES] = SHORT, 0.0
        else:
            check_value(p, state, t_us, slot, raw[raw_at + p.item[slot]], moving[p.signal[slot]])
    if length_sign != 0:
        counters = node_at(p, nodes(p))  # they follow the last node
        state[counters + (SHORT_FRAMES if length_sign < 0 else LONG_FRAMES)] += 1.0
        if length_sign > 0:
            state[counters + LONG_US] = t_us


@inner
def nodes(p: KernelInputs) -> Count:
    """Return the number of nodes M: one more than the largest number of a PDO's node, `p.node` (P,)."""
    found = 0
    for i in range(p.p):
        found = max(found, p.node[i] + 1)
    return found


@inner
def update_rate(p: KernelInputs, state: Numbers, t_us: Number, pdo: Count) -> None:
    """Update the rate of a PDO with one more frame, and from it whether a second node sends the same PDO.

    The surplus sums 1 - dt/period over the frames. For one producer it stays within the jitter, whatever the number of
    frames; it grows by one with each frame of another. After a pause a producer may send at once the frames that waited
    while the bus or the reader was busy. Regular frames reduce this allowance again. With the first PDO after a boot, a
    pause or a step of the clock, the heartbeat of its node is given its whole time once more.

    t_us:  at which the frame was received [us]
    pdo:   number of the PDO

    Read and written:
    state: (`layout.InputLayout`) time, surplus and time of a second producer of the PDO; heartbeat time of its node
    """
    o = pdo_at(p, pdo)
    before = state[o + FRAME_US]
    dt = (t_us - before) / p.period[pdo]  # in periods
    state[o + FRAME_US] = t_us
    if before == NEVER or dt < 0.0:
        state[o + SURPLUS] = 0.0
    else:
        surplus = state[o + SURPLUS] + 1.0 - dt
        if 0.5 <= dt <= 1.5:  # a regular frame: the nearest multiple of the period is one
            surplus = max(surplus, FORGOTTEN * surplus)
        if surplus > EXCESS:
            # the next two frames of the other one are the next sign
            state[o + SURPLUS], state[o + DOUBLED_US] = 1.0, t_us
        else:
            state[o + SURPLUS] = surplus
    node = node_at(p, p.node[pdo])
    known = state[node + HEARTBEAT_US] != NEVER or state[node + BOOTED] != 0.0
    if known and (before == NEVER or not 0.0 <= t_us - before <= p.patience[pdo]):
        state[node + HEARTBEAT_US] = t_us


@inner
def check_value(p: KernelInputs, state: Numbers, t_us: Number, slot: Count, raw: Number, moving: Number) -> None:
    """Check one received value of a signal: store it as the signal's value [SI], or store the reason why it is refused.

    The value is raw scale + offset. It is refused, in this order, if it means "no value", is not finite, is out of
    range, steps by more than is plausible, or is the same as too many before it. A signal that was refused for longer
    than `p.hold` is accepted again after `p.needed` good values in a row. After JUMPS_BELIEVED implausible values the
    new level is accepted.

    t_us:   at which the value was received [us]
    slot:   number of the field of a PDO that carries the value, among all such fields (`KernelInputs`)
    raw:    value, not scaled
    moving: 1 where a repeated value means that the sensor is frozen, else 0

    Read and written:
    state:  (`layout.InputLayout`) the numbers of the signal, see the names above
    """
    k = p.signal[slot]
    o, read = SIGNAL * k, raw * p.scale[slot] + p.offset[slot]
    value, largest = read, -p.missing[slot] - 1.0  # 7FFFh of a signed number is the error code of many sensors
    if raw != largest:
        value = in_range(read, p.low[slot], p.high[slot], p.around[slot])
    received_before, by = state[o + RECEIVED_US], implausible_step(p, state, t_us, k, value)
    state[o + SINCE_US] = measured_after(p, state, t_us, k)
    if raw == p.missing[slot] or not abs(value) <= LARGEST:
        state[o + RECEIVED_US], state[o + REASON], state[o + GOOD_VALUES] = t_us, NOT_A_NUMBER, 0.0
        return
    if not p.low[slot] <= value <= p.high[slot]:
        state[o + RECEIVED_US], state[o + REASON], state[o + GOOD_VALUES] = t_us, OUT_OF_RANGE, 0.0
        return
    if by != 0.0 and state[o + JUMPS] < JUMPS_BELIEVED:
        state[o + RECEIVED_US], state[o + REASON], state[o + GOOD_VALUES] = t_us, JUMPED, 0.0
        state[o + JUMPS] += 1.0
        state[o + JUMP], state[o + JUMPED_TO] = by, value
        return
    equal = 0.0 if value != state[o + VALUE] else state[o + EQUAL_VALUES] + moving
    state[o + RECEIVED_US], state[o + EQUAL_VALUES] = t_us, equal
    if equal >= p.frozen and p.noisy[k]:
        state[o + REASON], state[o + GOOD_VALUES] = FROZEN, 0.0
        return
    good = state[o + GOOD_VALUES] + 1.0 if t_us - received_before <= p.hold else 1.0
    state[o + VALUE], state[o + GOOD_VALUES], state[o + JUMPS] = value, good, 0.0
    state[o + STEPPED] += by
    if t_us - state[o + ACCEPTED_US] <= p.hold or good >= p.needed:
        state[o + ACCEPTED_US], state[o + REASON], state[o + JUMP], state[o + JUMPED_TO] = t_us, GOOD, 0.0, 0.0


@inner
def measured_after(p: KernelInputs, state: Numbers, t_us: Number, k: Count) -> Number:
    """Return the time [us] after which a value was measured that is received now, however long it waited for the bus.

    It is the time at which the value before was received. Values that follow each other in less than half a period have
    waited, and were measured a period apart.

    t_us:  now [us]
    k:     number of the signal

    Read:
    state: (`layout.InputLayout`) of the signal's value before: when it was received and after when it was measured [us]
    """
    o, period_us = SIGNAL * k, 1e6 * p.period_s[k]
    if t_us - state[o + RECEIVED_US] > 0.5 * period_us:
        return state[o + RECEIVED_US]
    return min(state[o + RECEIVED_US], state[o + SINCE_US] + period_us)


@inner
def implausible_step(p: KernelInputs, state: Numbers, t_us: Number, k: Count, value: Number) -> Number:
    """Return by how much a value [SI] has stepped if that is more than is plausible; 0: it has not.

    Plausible is the fastest change times the time between two values, plus the noise. Time during which values were not
    yet accepted does not count, because the joint need not have moved then. Time that the value before may have waited
    for the bus counts. After a step the signal continues from there, until it steps back.

    t_us:  now [us]
    k:     number of the signal
    value: received now [SI]

    Read:
    state: (`layout.InputLayout`) of the signal: last accepted and last implausible value, and their times
    """
    if p.fastest[k] > LARGEST:
        return 0.0
    o = SIGNAL * k
    if state[o + JUMPS] != 0.0:
        by = short_way(value - state[o + JUMPED_TO], p.turn[k])
        again = abs(by) > room_since(p, state, t_us, k, state[o + RECEIVED_US])
        jump = state[o + JUMP] + (by if again else 0.0)
        return jump if abs(jump) > room_for(p, k, 0.0) else 0.0
    proving = t_us - state[o + ACCEPTED_US] > p.hold and state[o + GOOD_VALUES] > 0.0  # good, not yet accepted again
    by = short_way(value - state[o + VALUE], p.turn[k])
    since = state[o + RECEIVED_US] if proving else state[o + ACCEPTED_US]
    return by if abs(by) > room_since(p, state, t_us, k, since) else 0.0


@inner
def room_since(p: KernelInputs, state: Numbers, t_us: Number, k: Count, since: Number) -> Number:
    """Return the largest plausible change [SI] of signal k from a value that was received at `since` [us] to now.

    t_us:  now [us]

    Read:
    state: (`layout.InputLayout`) of the signal: time after which its last value was measured, before it waited
    """
    waited = max(0.0, since - state[SIGNAL * k + SINCE_US] - 1e6 * p.period_s[k])
    return room_for(p, k, 1e-6 * (t_us - since + waited))


@inner
def room_for(p: KernelInputs, k: Count, seconds: Number) -> Number:
    """Return the largest plausible change [SI] of signal k in a time [s], but at least in one of its periods."""
    return p.fastest[k] * max(seconds, p.period_s[k]) + p.noise[k]


def usable(p: KernelInputs, state: Numbers, t_us: Number, sample: Numbers) -> Count:
    """Compute the values of the S signals at a tick and why each is not usable, and return how many are not usable.

    The last value of a signal that is late or was refused is used for `p.hold`; after that the signal is not usable.

    t_us:   of the tick [us]

    Read:
    state:  of signals, PDOs and nodes (`layout.InputLayout`)

    Written:
    sample: (2 S + 2,) (`layout.SampleLayout`): value of each signal [SI]; reason why each is not usable, a number of
            `Reason`, GOOD if it is (S,); reason why the last value of a usable signal was refused or is late, unchanged
            if there is none, so that it must be GOOD before the call; number of stepped signals
    """
    reasons, late, stepped = p.s, 2 * p.s, 2 * p.s + 1  # places in `sample`, after the values
    for k in range(p.s):
        o = SIGNAL * k
        age, reason = t_us - state[o + ACCEPTED_US], state[o + REASON]
        sample[k], sample[reasons + k] = state[o + VALUE], GOOD
        if not -p.hold <= age <= p.hold:  # a negative age: the clock was set back meanwhile
            sample[reasons + k] = STALE if reason == GOOD else reason
        elif reason != GOOD or age > p.late[k]:
            sample[late] = STALE if reason == GOOD else reason
    check_producers(p, state, t_us, sample)
    bad, sample[stepped] = 0, 0.0
    for k in range(p.s):
        bad += sample[reasons + k] != GOOD
        if has_stepped(p, state, k):
            sample[stepped] += 1.0
    return bad


@inner
def check_producers(p: KernelInputs, state: Numbers, t_us: Number, sample: Numbers) -> None:
    """Refuse the signals of each PDO whose sender is not reliable: its node is lost or stopped, or two nodes send it.

    The reason is NOT_OPERATIONAL if its node was not operational, or its heartbeat was too old, when the PDO was
    received; TWO_PRODUCERS if another node has sent the PDO within `p.quiet` [us]. A node whose heartbeat was never
    received, or is not monitored, is not judged by it. Of two reasons the larger number remains: both of these exceed
    those of a value.

    t_us:   of the tick [us]

    Read:
    state:  of PDOs and nodes (`layout.InputLayout`)

    Read and written:
    sample: (2 S + 2,) values [SI] (S,), then their reasons (S,), numbers of `Reason`, which are set
    """
    for i in range(p.p):
        pdo, node, why = pdo_at(p, i), node_at(p, p.node[i]), GOOD
        if state[node + HEARTBEAT_US] != NEVER and p.patience[i] > 0.0:
            recent = state[pdo + FRAME_US] - state[node + HEARTBEAT_US] <= p.patience[i]
            why = GOOD if state[node + NMT_STATE] == OPERATIONAL and recent else NOT_OPERATIONAL
        if abs(t_us - state[pdo + DOUBLED_US]) < p.quiet:
            why = TWO_PRODUCERS
        for slot in range(p.first[i], p.first[i + 1]):
            reason = p.s + p.signal[slot]
            sample[reason] = max(sample[reason], why)


@inner
def has_stepped(p: KernelInputs, state: Numbers, k: Count) -> Count:
    """Return 1 if signal k has stepped and stayed there, else 0.

    Read:
    state: (`layout.InputLayout`) sum of the signal's steps that were accepted [SI]
    """
    by = state[SIGNAL * k + STEPPED]
    return 1 if by != 0.0 and abs(by) > room_for(p, k, 0.0) else 0


def stepped(p: KernelInputs, state: Numbers, has_step: Numbers) -> None:
    """Compute which of the S signals have stepped and stayed there.

    Read:
    state:    (`layout.InputLayout`), of which the sum of each signal's accepted steps [SI] is used

    Written:
    has_step: (S,) 1 where a signal stepped, else 0
    """
    for k in range(p.s):
        has_step[k] = has_stepped(p, state, k)


def quantise(size: Count, limits: Numbers, values: Numbers, sent: Counts) -> None:
    """Compute the integers that are sent of published values: the nearest multiple of the step, of two the even one.

    A value outside its range, or NaN, is sent as the integer for "no value".

    size:   N, number of values

    Read:
    limits: (N, 4) smallest and largest value, step of one integer, in the unit of the value; and the integer that means
            "no value"
    values: (N,) in the units of their limits

    Written:
    sent:   (N,) integers
    """
    for i in range(size):
        low, high, step, missing = limits[4 * i], limits[4 * i + 1], limits[4 * i + 2], limits[4 * i + 3]
        sent[i] = whole(missing)
        if low <= values[i] <= high:
            steps = values[i] / step
            below = floor(steps)
            odd, rest = below - 2.0 * floor(0.5 * below), steps - below
            sent[i] = whole(below + 1.0 if rest > 0.5 or (rest == 0.5 and odd != 0.0) else below)
