"""Tests of pressures by themselves: `service.plausibility.pressure_groups` and the first test of `pressure_step`, in
plain numbers. Tables of groups are (G, P), of P pressures."""

from math import log

from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, inner

GROUP: Count = 25  # steps of which the mean is taken, 0.25 s at 100 Hz: shorter than a stroke, longer than noise
GROUPS: Count = 16  # groups, in motion of the cylinder, that are compared
EACH_WAY: Count = 4  # smallest number of them in either direction
TINY: Number = 1.0  # Pa^2: noise is not less than a pascal
NOISES: Count = 64  # groups whose noise is stored, 16 s of motion
LATEST: Count = 8  # last ones of them, 2 s, in which the noise may be gone already
KNOWN: Count = 24  # groups before them whose noise must be known; chosen
SECOND: Number = 6.0  # variance of second differences over that of white noise: 1 + 4 + 1
CODES: Count = 2  # readings with no more different values than this show the sensor's resolution, not its noise


def suspicious(p: Count, readings: Numbers, before: Count, gates: Numbers) -> Count:
    """Return whether one of the pressures changes with the reading number `before` by more than its gate.

    Its change must also exceed by the gate the change of the readings around it.

    readings: (T, P)
    gates:    (P,)
    """
    o = before * p
    for i in range(p):
        by = readings[o + i] - readings[o - p + i]
        around = readings[o + p + i] - readings[o - 2 * p + i]
        if abs(by) > gates[i] and gates[i] < abs(1.5 * by - 0.5 * around):
            return 1
    return 0


def certain_steps(
    p: Count,
    readings: Numbers,
    size: Count,
    before: Count,
    curves: Numbers,
    bends: Count,
    noise: Numbers,
    free: Number,
    known: Number,
    least: Number,
    pairs: Counts,
    swaps: Count,
    most: Count,
    parts: Numbers,
    misfit: Numbers,
) -> Count:
    """Return whether a step can exceed the `least` log likelihood ratio: 1 of one pressure, 2 by a swap, 3 either,
    0 none.

    The step of a pressure is tested in the residual of `curves`, if the noise before was no more than the sensors'.

    readings:    (T, P), T = `size`, of which `before` are before the step
    curves:      (T, bends + 1), of which the last is a step
    noise:       (P,) of the sensors
    free, known: degrees of freedom of the variance, and of the noise before
    pairs:       (swaps, most, 2) pressures that are swapped; -1: no more
    parts:       (P, 2, bends + 2) room for results
    misfit:      (2, P) result: minus the log likelihood [nats] of the residual without and with the step, of a variance
                 of its own, but at least the noise
    """
    sure, o = 0, bends
    for i in range(p):
        for half in range(2):
            project(p, readings, half * before, before if half == 0 else size, i, curves, bends + 1, parts)
        squared = crossed(parts, bends, i, i)
        along = parts[2 * i * (bends + 2) + o] + parts[(2 * i + 1) * (bends + 2) + o]
        stepped = squared - along * along
        misfit[i], misfit[p + i] = unlikely(squared, noise[i], free, 0.0), unlikely(stepped, noise[i], free, 0.0)
        by = unlikely(squared, noise[i], free, known) - unlikely(stepped, noise[i], free, known)
        if max(by, misfit[i] - misfit[p + i]) > least:
            sure = 1
    for x in range(swaps):
        total = 0.0
        for m in range(most):
            a, b = pairs[2 * (x * most + m)], pairs[2 * (x * most + m) + 1]
            if a >= 0:
                largest = max(noise[a], noise[b])
                first = misfit[a] - unlikely(crossed(parts, bends, a, b), largest, free, 0.0)
                total += 2.0 * min(first, misfit[b] - unlikely(crossed(parts, bends, b, a), largest, free, 0.0))
        if total > least:
            return sure + 2
    return sure


@inner
def project(
    p: Count, x: Numbers, begin: Count, end: Count, i: Count, curves: Numbers, number: Count, parts: Numbers
) -> None:
    """Compute the products of a pressure's readings with each of a `number` of `curves` (T, number), and their sum of
    squares.

    x:     (T, P) readings, of which those from `begin` up to `end` are used
    i:     number of the pressure
    parts: (P, 2, number + 1) results, in its first or second half
    """
    o = (2 * i + (1 if begin > 0 else 0)) * (number + 1)
    for k in range(number + 1):
        total = 0.0
        for t in range(begin, end):
            total += x[t * p + i] * (curves[t * number + k] if k < number else x[t * p + i])
        parts[o + k] = total


@inner
def crossed(parts: Numbers, bends: Count, a: Count, b: Count) -> Number:
    """Return the sum of squares of the residual of the curves through the first readings of one pressure and the last
    ones of another."""
    first, last = 2 * a * (bends + 2), (2 * b + 1) * (bends + 2)
    squared = parts[first + bends + 1] + parts[last + bends + 1]
    for k in range(bends):
        along = parts[first + k] + parts[last + k]
        squared -= along * along
    return squared


@inner
def unlikely(squared: Number, noise: Number, free: Number, known: Number) -> Number:
    """Return minus the log likelihood [nats] of a residual of a variance of its own, but at least the `noise`
    (Student's t).

    squared:     sum of squares of the residual
    free, known: degrees of freedom of the variance, and of the noise before
    """
    return 0.5 * (free + known) * log(max((known + squared / noise) / (known + free), 1.0))


def group(p: Count, readings: Numbers, begin: Count, way: Numbers, moves: Number, groups: Numbers) -> None:
    """Add a group of readings to the `groups`, for each pressure whose cylinder moves.

    readings: (T, P), of which GROUP from `begin` on are used
    way:      (P,) movement of each cylinder
    moves:    movement above which it counts
    groups:   (4, G, P) mean, variance, way and white noise
    """
    size = GROUPS * p
    for i in range(p):
        if abs(way[i]) > moves:
            for k in range(4):
                for g in range(GROUPS - 1):
                    groups[k * size + g * p + i] = groups[k * size + (g + 1) * p + i]
            last = size - p + i
            middle = mean_of(readings, begin * p + i, p, GROUP)
            groups[last], groups[2 * size + last] = middle, 1.0 if way[i] > 0.0 else -1.0
            groups[size + last] = squares_of(readings, begin * p + i, p, GROUP, middle) / (GROUP - 1)
            groups[3 * size + last] = second_differences(p, readings, begin, GROUP, i)


@inner
def mean_of(x: Numbers, begin: Count, step: Count, size: Count) -> Number:
    """Return the mean of every `step`th number."""
    total = 0.0
    for k in range(size):
        total += x[begin + k * step]
    return total / size


@inner
def squares_of(x: Numbers, begin: Count, step: Count, size: Count, middle: Number) -> Number:
    """Return the sum of squares of every `step`th number about the middle."""
    total = 0.0
    for k in range(size):
        total += (x[begin + k * step] - middle) * (x[begin + k * step] - middle)
    return total


@inner
def ranked(x: Numbers, begin: Count, step: Count, size: Count, above: Number, place: Count, work: Numbers) -> Number:
    """Return the number at a `place`, from 0 on, in ascending order of those that are larger than `above`."""
    many = 0
    for k in range(size):
        each = x[begin + k * step]
        if each > above:
            at = min(many, place + 1)
            while at > 0 and work[at - 1] > each:
                work[at] = work[at - 1]
                at -= 1
            if at <= place:
                work[at] = each
            many = min(many + 1, place + 1)
    return work[place]


def compare(p: Count, groups: Numbers, work: Numbers, ratios: Numbers) -> Count:
    """Compare the variance between groups with the noise, and return the number of pressures with enough groups either
    way.

    groups: (4, G, P) see `group`
    work:   GROUPS numbers, room for results
    ratios: (2, P) variance of the groups' means over that expected from the noise within them, -1: too few groups; that
            noise over its white part
    """
    size, number = GROUPS * p, 0
    for i in range(p):
        forwards, backwards = 0, 0
        for g in range(GROUPS):
            forwards += groups[2 * size + g * p + i] > 0.0
            backwards += groups[2 * size + g * p + i] < 0.0
        ratios[i], ratios[p + i] = -1.0, 0.0
        if min(forwards, backwards) >= EACH_WAY and forwards + backwards == GROUPS:
            noise = ranked(groups, size + i, p, GROUPS, -1.0, GROUPS // 2, work)
            middle = mean_of(groups, i, p, GROUPS)
            varied = squares_of(groups, i, p, GROUPS, middle) / (GROUPS - 1)
            ratios[i] = varied * GROUP / max(noise, TINY)
            white = ranked(groups, 3 * size + i, p, GROUPS, -1.0, GROUPS // 2, work)
            ratios[p + i] = noise / max(white, TINY)
            number += 1
    return number


def update_noise(
    p: Count,
    readings: Numbers,
    size: Count,
    groups: Numbers,
    number: Count,
    moved: Numbers,
    stated: Numbers,
    tenth: Number,
    quiet: Numbers,
    limits: Count,
    work: Numbers,
    state: Numbers,
) -> None:
    """Update the noise of pressures that `moved` (P,) with a group of readings. Noise measured while it is gone is not
    stored.

    readings: (T, P), T = `size`
    groups:   (2, G, P) means and variances of a `number` of groups, including this one
    stated:   (P,) variances of the sensors, the largest that counts as their noise
    tenth:    first decile of the noise of groups, as a share of the white noise
    quiet:    the `limits` of `pressure_groups.QUIET`
    state:    (NOISES, P) known noise, 0: not yet; (P,) number of groups in which it has been gone
    """
    for i in range(p):
        if moved[i] != 0.0:
            noise, since = second_differences(p, readings, 0, size, i), NOISES * p + i
            gone = 1 if state[since] > 0.0 else 0
            if gone == 0 and digits(p, readings, size, i) > CODES:
                gone = less_than_known(p, groups, number, size, i, stated[i], tenth, quiet, limits, work, state)
            if gone:
                state[since] += 1.0
            elif noise > 0.0:
                for k in range(NOISES - 1):
                    state[k * p + i] = state[(k + 1) * p + i]
                state[since - p] = noise


@inner
def second_differences(p: Count, x: Numbers, begin: Count, size: Count, i: Count) -> Number:
    """Return the variance of white noise in readings from `begin` on, by second differences."""
    total = 0.0
    for k in range(begin, begin + size - 2):
        a, b, c = x[k * p + i], x[(k + 1) * p + i], x[(k + 2) * p + i]
        total += ((c - b) - (b - a)) * ((c - b) - (b - a))
    return total / (SECOND * (size - 2))


@inner
def digits(p: Count, x: Numbers, size: Count, i: Count) -> Count:
    """Return the number of different values among the readings."""
    found = 0
    for k in range(size):
        new = 1
        for j in range(k):
            if x[j * p + i] == x[k * p + i]:
                new = 0
        found += new
    return found


@inner
def less_than_known(
    p: Count,
    groups: Numbers,
    number: Count,
    size: Count,
    i: Count,
    stated: Number,
    tenth: Number,
    quiet: Numbers,
    limits: Count,
    work: Numbers,
    state: Numbers,
) -> Count:
    """Return whether the last 1, 2, ... groups vary less than by the noise that is known of the time before them."""
    many, count = 0, NOISES - LATEST
    for k in range(count):
        many += state[k * p + i] > 0.0
    if many < KNOWN:
        return 0
    own = min(ranked(state, i, p, count, 0.0, many // 10, work) / tenth, stated)
    squares, total, inside = 0.0, 0.0, 0.0
    last = (number - 1) * p + i
    for k in range(min(limits, number)):
        o = last - k * p
        middle = groups[o] - groups[last]
        squares, total, inside = squares + middle * middle, total + middle, inside + groups[number * p + o]
        apart = squares - total * total / (k + 1)
        if ((size - 1) * inside + size * apart) / (size * (k + 1) - 1) < quiet[k] * own:
            return 1
    return 0
