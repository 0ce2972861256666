"""Tests of pressures by themselves: `service.plausibility.pressure_groups` and the first test of `pressure_step`, in
plain numbers.

Sizes: P pressures, G = GROUPS groups of GROUP readings each, T readings, B smooth curves."""

from math import log

from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, inner

GROUP: Count = 25  # steps of which the mean is taken, 0.25 s at 100 Hz: shorter than a stroke, longer than noise
GROUPS: Count = 16  # groups, in motion of the cylinder, that are compared
EACH_WAY: Count = 4  # smallest number of these groups in either direction of the cylinder
TINY: Number = 1.0  # least variance of the noise [Pa^2]: one pascal, squared
NOISES: Count = 64  # groups whose noise is stored, 16 s of motion
LATEST: Count = 8  # last ones of them, 2 s, in which the noise may be gone already
KNOWN: Count = 24  # number of groups before the LATEST whose noise must be known; chosen
SECOND: Number = 6.0  # variance of second differences over that of white noise: 1 + 4 + 1
MEAN: Count = 0  # tables of the groups, (G, P) each: mean [Pa]
VARIANCE: Count = 1  # variance about it [Pa^2]
WAY: Count = 2  # 1 or -1: direction of the cylinder
WHITE: Count = 3  # variance of the white part of the noise [Pa^2]
CODES: Count = 2  # readings with no more different values than this show the sensor's resolution, not its noise


def may_step(p: Count, readings: Numbers, before: Count, gates: Numbers) -> Count:
    """Return 1 if one of the P pressures steps at a reading by more than its gate, else 0.

    Two quantities must exceed the gate: its change from the last reading before the step to the first one after it, and
    that change less the mean of the changes just before and just after it.

    p:        P, number of pressures
    before:   number of readings before the step

    Read:
    readings: (T, P) [Pa], at least two before the step and two after
    gates:    (P,) [Pa]
    """
    after = before * p  # place of the first reading after the step
    for i in range(p):
        by = readings[after + i] - readings[after - p + i]
        around = readings[after + p + i] - readings[after - 2 * p + i]
        if abs(by) > gates[i] and gates[i] < abs(1.5 * by - 0.5 * around):
            return 1
    return 0


def possible_steps(
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
    products: Numbers,
    misfit: Numbers,
) -> Count:
    """Return whether a step can exceed the `least` log likelihood ratio: 1 of one pressure, 2 by a swap of plugs,
    3 either, 0 none.

    It is a fast test before the exact one, which also measures the noise of earlier readings: more noise makes the
    ratio of one pressure smaller only.

    The readings of a pressure around the step are fitted by smooth curves, with and without a step. In the ratio the
    noise before the step counts as known, or not; the larger ratio counts. In a swap, the readings of one pressure
    before the step continue those of another one. The ratio of a swap is the sum, over its pairs, of twice the smaller
    of both pressures' log likelihood ratios; there the noise never counts as known.

    p:         P, number of pressures
    size:      T, number of readings
    before:    number of readings before the step
    bends:     B, number of smooth curves
    free:      degrees of freedom of the residual of a curve with a step
    known:     degrees of freedom from which the noise before the step is known, if it is
    least:     log likelihood ratio [nats]
    swaps:     E, number of swaps
    most:      M, largest number of pairs in one of them

    Read:
    readings:  (T, P) [Pa]
    curves:    (T, B + 1) orthonormal curves, of which the last is a step
    noise:     (P,) variance of the sensors' noise [Pa^2]
    pairs:     (E, M, 2) pressures that are swapped, before and after the step; -1: no more

    Written:
    products:  (P, 2, B + 2) room: of the readings before and after the step with each curve, and sum of squares
    misfit:    (2, P) minus the log likelihood [nats] of the residual without and with the step, with a variance of its
               own, but at least the noise
    """
    found, step = 0, bends  # `step`: number of the last curve
    for i in range(p):
        for half in range(2):
            project(p, readings, half * before, before if half == 0 else size, i, curves, bends + 1, products)
        squares = crossed(products, bends, i, i)
        along = products[2 * i * (bends + 2) + step] + products[(2 * i + 1) * (bends + 2) + step]
        stepped = squares - along * along
        misfit[i], misfit[p + i] = unlikely(squares, noise[i], free, 0.0), unlikely(stepped, noise[i], free, 0.0)
        by = unlikely(squares, noise[i], free, known) - unlikely(stepped, noise[i], free, known)
        if max(by, misfit[i] - misfit[p + i]) > least:
            found = 1
    for x in range(swaps):
        total = 0.0
        for m in range(most):
            a, b = pairs[2 * (x * most + m)], pairs[2 * (x * most + m) + 1]
            if a >= 0:
                largest = max(noise[a], noise[b])
                first = misfit[a] - unlikely(crossed(products, bends, a, b), largest, free, 0.0)
                second = misfit[b] - unlikely(crossed(products, bends, b, a), largest, free, 0.0)
                total += 2.0 * min(first, second)
        if total > least:
            return found + 2
    return found


@inner
def project(
    p: Count, x: Numbers, begin: Count, end: Count, i: Count, curves: Numbers, number: Count, products: Numbers
) -> None:
    """Compute the products of a part of a pressure's readings with each curve, and their sum of squares.

    p:        P, number of pressures
    begin:    first reading that is used; 0: the results are those before the step, otherwise those after it
    end:      last reading that is used, excluded
    i:        number of the pressure
    number:   of curves

    Read:
    x:        (T, P) readings [Pa]
    curves:   (T, number)

    Written:
    products: (P, 2, number + 1), of which one row of the pressure is set: products, then sum of squares [Pa^2]
    """
    row = (2 * i + (1 if begin > 0 else 0)) * (number + 1)
    for k in range(number + 1):
        total = 0.0
        for t in range(begin, end):
            total += x[t * p + i] * (curves[t * number + k] if k < number else x[t * p + i])
        products[row + k] = total


@inner
def crossed(products: Numbers, bends: Count, a: Count, b: Count) -> Number:
    """Return the sum of squares [Pa^2] of the residual of smooth curves through the readings of pressure a before a
    step and of pressure b after it.

    With two pressures it is the residual if their plugs were swapped at the step. With one pressure (a = b) it is that
    of a pressure without swap and without step. The curves are orthonormal, so that it is the sum of squares less the
    squared product with each curve.

    bends:    B, number of smooth curves
    a, b:     numbers of the pressures before and after the step

    Read:
    products: (P, 2, B + 2) before and after the step: products with each curve and with a step, sum of squares
    """
    first, last = 2 * a * (bends + 2), (2 * b + 1) * (bends + 2)
    squares = products[first + bends + 1] + products[last + bends + 1]
    for k in range(bends):
        along = products[first + k] + products[last + k]
        squares -= along * along
    return squares


@inner
def unlikely(squares: Number, noise: Number, free: Number, known: Number) -> Number:
    """Return minus the log likelihood [nats] of the residual of a curve through readings.

    The distribution is Student's: (free + known) / 2 log((known + squares / noise) / (known + free)). It is relative to
    the likelihood at the expected sum of squares, `free` times the noise, and 0 for any smaller residual. Without
    degrees of freedom of the noise, the variance is that of the residual itself, at least the noise.

    squares: sum of squares of the residual [Pa^2]
    noise:   variance of the noise [Pa^2]
    free:    degrees of freedom of the residual
    known:   degrees of freedom from which the noise is known; 0: only its least value is
    """
    return 0.5 * (free + known) * log(max((known + squares / noise) / (known + free), 1.0))


def add_group(p: Count, readings: Numbers, begin: Count, way: Numbers, moves: Number, groups: Numbers) -> None:
    """Add a group of readings to the tables of groups, for each pressure with |way| > moves; the oldest is dropped.

    p:        P, number of pressures
    begin:    first of the GROUP readings that are used
    moves:    speed of a cylinder above which its group is added [m/s]

    Read:
    readings: (T, P) [Pa]
    way:      (P,) speed of the cylinder of each pressure [m/s], extending positive; for groups at rest 1 where a group
              is to be added, else 0

    Read and written:
    groups:   (4, G, P) of the last G groups, newest last: mean [Pa], variance [Pa^2], sign 1 or -1 of `way`, variance
              of the white noise [Pa^2]
    """
    size = GROUPS * p  # of a table
    for i in range(p):
        if abs(way[i]) > moves:
            for k in range(4):
                for g in range(GROUPS - 1):
                    groups[k * size + g * p + i] = groups[k * size + (g + 1) * p + i]
            last = size - p + i
            middle = mean_of(readings, begin * p + i, p, GROUP)
            groups[MEAN * size + last], groups[WAY * size + last] = middle, 1.0 if way[i] > 0.0 else -1.0
            groups[VARIANCE * size + last] = squares_of(readings, begin * p + i, p, GROUP, middle) / (GROUP - 1)
            groups[WHITE * size + last] = second_differences(p, readings, begin, GROUP, i)


@inner
def mean_of(x: Numbers, begin: Count, step: Count, size: Count) -> Number:
    """Return the mean of `size` numbers, every `step`th number of x from `begin` on."""
    total = 0.0
    for k in range(size):
        total += x[begin + k * step]
    return total / size


@inner
def squares_of(x: Numbers, begin: Count, step: Count, size: Count, middle: Number) -> Number:
    """Return the sum of squared deviations from `middle` of `size` numbers, every `step`th of x from `begin` on."""
    total = 0.0
    for k in range(size):
        total += (x[begin + k * step] - middle) * (x[begin + k * step] - middle)
    return total


@inner
def ranked(x: Numbers, begin: Count, step: Count, size: Count, above: Number, place: Count, work: Numbers) -> Number:
    """Return the number at a `place`, from 0 on, in ascending order of those that are larger than `above`.

    The numbers are `size` of them, every `step`th of x from `begin` on; more than `place` of them must be larger than
    `above`.

    Read: x

    Written:
    work: room of (place + 2,), of which the first place + 1 get the smallest of these numbers in order
    """
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


def compare_groups(p: Count, groups: Numbers, work: Numbers, ratios: Numbers) -> Count:
    """Compare the variance between groups with the noise within them; return the number of pressures compared.

    A pressure is compared if there are G groups, at least EACH_WAY of them in either direction of its cylinder. A
    pressure that follows the load differs from group to group by more than its noise.

    p:      P, number of pressures

    Read:
    groups: (4, G, P) mean [Pa], variance [Pa^2], direction 1 or -1 of the cylinder (0: no group yet), variance of the
            white noise [Pa^2]

    Written:
    work:   (GROUPS,) room for intermediate results
    ratios: (2, P) variance of the groups' means over that expected from the median noise within them, -1: not compared;
            that noise over the median of its white part
    """
    size, number = GROUPS * p, 0
    for i in range(p):
        forwards, backwards = 0, 0
        for g in range(GROUPS):
            forwards += groups[WAY * size + g * p + i] > 0.0
            backwards += groups[WAY * size + g * p + i] < 0.0
        ratios[i], ratios[p + i] = -1.0, 0.0
        if min(forwards, backwards) >= EACH_WAY and forwards + backwards == GROUPS:
            noise = ranked(groups, VARIANCE * size + i, p, GROUPS, -1.0, GROUPS // 2, work)
            middle = mean_of(groups, i, p, GROUPS)
            varied = squares_of(groups, i, p, GROUPS, middle) / (GROUPS - 1)
            ratios[i] = varied * GROUP / max(noise, TINY)
            white = ranked(groups, WHITE * size + i, p, GROUPS, -1.0, GROUPS // 2, work)
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
    """Update the noise of the pressures whose cylinder moved, with one group of readings.

    A sensor whose noise is gone may be frozen (`less_than_known`). Noise measured while it is gone is not stored, and
    here it does not come back: the caller sets this pressure's `state` to 0 to begin anew. Groups of CODES different
    readings or fewer do not show that noise is gone.

    p:        P, number of pressures
    size:     T, number of readings of the group
    number:   G, number of groups
    tenth:    first decile of the noise of groups, as a share of the white noise
    limits:   number of limits in `quiet`

    Read:
    readings: (T, P) [Pa]
    groups:   (2, G, P) means [Pa] and variances [Pa^2] of the last groups, including this one
    moved:    (P,) not 0 where the cylinder of the pressure moved
    stated:   (P,) variances by the sensors' data sheet, the largest that counts as their noise [Pa^2]
    quiet:    (limits,) limits of the variance of the last 1, 2, ... groups, as shares of the noise
              (`pressure_groups.QUIET`)

    Written:
    work:     room for intermediate results

    Read and written:
    state:    (NOISES, P) noise of earlier groups [Pa^2], 0: not yet, newest last; (P,) number of groups for which the
              noise has been gone
    """
    for i in range(p):
        if moved[i] != 0.0:
            noise, since = second_differences(p, readings, 0, size, i), NOISES * p + i  # `since`: place of the number
            gone = 1 if state[since] > 0.0 else 0
            if gone == 0 and distinct(p, readings, size, i) > CODES:
                gone = less_than_known(p, groups, number, size, i, stated[i], tenth, quiet, limits, work, state)
            if gone:
                state[since] += 1.0
            elif noise > 0.0:
                for k in range(NOISES - 1):
                    state[k * p + i] = state[(k + 1) * p + i]
                state[since - p] = noise


@inner
def second_differences(p: Count, x: Numbers, begin: Count, size: Count, i: Count) -> Number:
    """Return the variance [Pa^2] of the white noise of a pressure: the mean squared second difference, over 6.

    Second differences remove a course that is straight over three readings. White noise of variance v gives them the
    variance (1 + 4 + 1) v.

    p:     P, number of pressures
    begin: first reading that is used
    size:  number of readings that are used
    i:     number of the pressure

    Read:
    x:     (T, P) readings [Pa]
    """
    total = 0.0
    for k in range(begin, begin + size - 2):
        a, b, c = x[k * p + i], x[(k + 1) * p + i], x[(k + 2) * p + i]
        total += ((c - b) - (b - a)) * ((c - b) - (b - a))
    return total / (SECOND * (size - 2))


@inner
def distinct(p: Count, x: Numbers, size: Count, i: Count) -> Count:
    """Return the number of different values among the readings of a pressure.

    p:    P, number of pressures
    size: T, number of readings
    i:    number of the pressure

    Read:
    x:    (T, P) readings [Pa]
    """
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
    """Return 1 if the last 1, 2, ... groups of a pressure vary less than its noise of the time before them, else 0.

    Its noise is the first decile of the known noise over `tenth`, at most that of the data sheet.

    p:      P, number of pressures
    number: G, number of groups, including the last one
    size:   number of readings of a group
    i:      number of the pressure
    stated: variance by the sensor's data sheet [Pa^2]; infinite where none is stated
    tenth:  first decile of the noise of groups, as a share of the white noise
    limits: number of limits in `quiet`

    Read:
    groups: (2, G, P) means [Pa] and variances [Pa^2]
    quiet:  (limits,) limits of the variance of the last 1, 2, ... groups, as shares of the noise
    state:  (NOISES, P) noise of earlier groups [Pa^2], 0: not yet, newest last

    Written:
    work:   room for intermediate results
    """
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
