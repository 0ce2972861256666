"""Drift of friction and pressure zeros after one instant with an empty bucket: `service.adaptation`, with
`recursive.forget` and `recursive.update`, in plain numbers."""

from math import sqrt

from cylforce.estimation.kernel.drifting import DRIFT, USUAL, KernelDrift
from cylforce.estimation.kernel.restricted import Count, Number, Numbers, inner
from cylforce.estimation.kernel.solver import invert

FORGETTING: Number = 1e-6  # times the largest: directions below it are not forgotten; as in `recursive`


def certain(a: KernelDrift, columns: Numbers, usable: Numbers) -> Count:
    """Return the number of usable rows with a known direction of friction, and list them in `good`.

    columns: (R, K) of the rows
    usable:  (R,) rows that can be used
    """
    number = 0
    for r in range(a.r):
        o, unknown, lever = r * a.k, 0.0, 0.0
        for i in range(a.rests):
            unknown += columns[o + a.at_rest[i]]
        for i in range(a.coulombs):
            lever += abs(columns[o + a.coulomb[i]])
        if usable[r] != 0.0 and unknown / max(lever + unknown, 1e-12) < a.certain:
            a.good[number] = r
            number += 1
    return number


def follow(
    a: KernelDrift,
    number: Count,
    columns: Numbers,
    residual: Numbers,
    wider: Numbers,
    factor: Numbers,
    right: Numbers,
    values: Numbers,
    scale: Numbers,
    mass: Number,
    new: Numbers,
) -> None:
    """Compute the drift after the `number` rows that `certain` found.

    residual:      their residual with the drift so far (`weighed.explain`)
    wider:         (R,) added to the variance of each row
    factor, right: (N, N) and (N,) information so far
    values:        (D,) drift so far
    scale:         (2,) variance of frictions and of zeros, in units of the prior's
    mass:          that the empty bucket would show without the adaptation [kg]
    new:           factor, right, values, covariance (D, D), scale and mass after these rows
    """
    n, d = a.n, a.n - DRIFT
    for m in range(number):
        listed_row(a, columns, a.good[m], m)
    for i in range(n * n):
        a.square[i] = factor[i]
    for i in range(n):
        a.inverse[i] = right[i]
    lose(a, number)
    for i in range(n):
        for j in range(n):
            a.each[j] = a.square[i * n + j]
        rotate_row(a, new, a.inverse[i])
    for m in range(number):
        r, observed = a.good[m], residual[a.good[m]]
        for i in range(d):
            observed += a.rows[m * n + DRIFT + i] * values[i]
        weight = 1.0 / sqrt(a.memory * (residual[a.r + r] + wider[r]))
        for i in range(n):
            a.each[i] = a.rows[m * n + i] * weight
        rotate_row(a, new, observed * weight)
    estimate(a, scale, new)
    new[n * n + n + d + d * d + 2] = smoothed(a, columns, mass, new)


@inner
def listed_row(a: KernelDrift, columns: Numbers, r: Count, m: Count) -> None:
    """Write row r as row m of [deviation of the load | usual amount | drift]."""
    for i in range(4):
        a.rows[m * a.n + i] = 0.0
    for i in range(a.loads):
        a.rows[m * a.n + a.load_at[2 * i + 1]] += columns[r * a.k + a.load_at[2 * i]] * a.load[i]
    along = 0.0
    for i in range(4):
        along += a.rows[m * a.n + i] * a.usual[i]
    a.rows[m * a.n + USUAL] = along
    for i in range(a.n - DRIFT):
        a.rows[m * a.n + DRIFT + i] = columns[r * a.k + a.changing[i]]


@inner
def lose(a: KernelDrift, number: Count) -> None:
    """Forget information as `recursive.forget`: R in `square`, its right side in `inverse`.

    The basis is found by Gram and Schmidt, the longest vector first, each made orthogonal twice."""
    n, x, first = a.n, a.basis, 0.0
    for m in range(number):
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += a.square[i * n + j] * a.rows[m * n + j]
            x[m * n + i] = total
    for step in range(number):
        longest, size = longest_of(a, step, number), 0.0
        for i in range(n):
            swapped = x[longest * n + i]
            x[longest * n + i], x[step * n + i] = x[step * n + i], swapped
            size += swapped * swapped
        size = sqrt(size)
        first = max(first, size)
        if size <= FORGETTING * max(first, 1e-300):
            return
        for i in range(n):
            x[step * n + i] /= size
        for m in range(step + 1, 2 * number - step - 1):
            across(a, step, step + 1 + (m - step - 1) % (number - step - 1))
        less_along(a, step)


@inner
def longest_of(a: KernelDrift, begin: Count, end: Count) -> Count:
    """Return the number of the longest of these vectors."""
    found, most = begin, -1.0
    for m in range(begin, end):
        size = 0.0
        for i in range(a.n):
            size += a.basis[m * a.n + i] * a.basis[m * a.n + i]
        if size > most:
            found, most = m, size
    return found


@inner
def across(a: KernelDrift, one: Count, other: Count) -> None:
    """Make a vector of the basis orthogonal to one of length 1."""
    along = 0.0
    for i in range(a.n):
        along += a.basis[one * a.n + i] * a.basis[other * a.n + i]
    for i in range(a.n):
        a.basis[other * a.n + i] -= along * a.basis[one * a.n + i]


@inner
def less_along(a: KernelDrift, m: Count) -> None:
    """Compute R <- (I - (1 - sqrt(keep)) q q') R, q vector m of the basis; the same of the right side."""
    n, share = a.n, 1.0 - sqrt(a.keep)
    for j in range(n + 1):
        along = 0.0
        for i in range(n):
            along += a.basis[m * n + i] * (a.square[i * n + j] if j < n else a.inverse[i])
        for i in range(n):
            if j < n:
                a.square[i * n + j] -= share * along * a.basis[m * n + i]
            else:
                a.inverse[i] -= share * along * a.basis[m * n + i]


@inner
def rotate_row(a: KernelDrift, new: Numbers, observed: Number) -> None:
    """Update the triangle and right side that begin `new` with a row `each` (N,), `observed`, by Givens' rotations."""
    n, x = a.n, a.each
    for i in range(n):
        b = x[i]
        if b != 0.0:
            o = new[i * n + i]
            size = sqrt(o * o + b * b)
            along, over = o / size, b / size
            for j in range(i, n):
                o, b = new[i * n + j], x[j]
                new[i * n + j], x[j] = along * o + over * b, along * b - over * o
            o = new[n * n + i]
            new[n * n + i], observed = along * o + over * observed, along * observed - over * o


@inner
def estimate(a: KernelDrift, scale: Numbers, new: Numbers) -> None:
    """Compute drift within its limits, covariance and scale from information and prior, (R'R + prior)^-1 R'z."""
    n, d, place = a.n, a.n - DRIFT, a.n * a.n + a.n
    inform(a, scale, new)
    invert(a.square, n, a.inverse, 0)
    for i in range(n):
        total = 0.0
        for k in range(i + 1):
            total += new[k * n + i] * new[n * n + k]
        a.each[i] = total * a.unit[i]
    a.each[USUAL] += a.mean
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += a.inverse[i * n + j] * a.each[j]
        a.basis[i] = total * a.unit[i]
    for i in range(d):
        for j in range(d):
            both = a.unit[DRIFT + i] * a.unit[DRIFT + j]
            new[place + d + i * d + j] = both * a.inverse[(DRIFT + i) * n + DRIFT + j]
    rescale(a, new, place + d + d * d)
    limit(a, new)


@inner
def inform(a: KernelDrift, scale: Numbers, new: Numbers) -> None:
    """Compute the lower triangle of the information, in units of `unit`, in `square`.

    The priors of the usual amount and of the drift, which are not forgotten, are added."""
    n = a.n
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(j + 1):
                total += new[k * n + i] * new[k * n + j]
            a.square[i * n + j] = a.unit[i] * total * a.unit[j]
            if j >= DRIFT:
                a.square[i * n + j] += a.alike[(i - DRIFT) * (n - DRIFT) + j - DRIFT] / scale[a.kinds[i - DRIFT]]
    a.square[USUAL * n + USUAL] += 1.0


@inner
def rescale(a: KernelDrift, new: Numbers, to: Count) -> None:
    """Compute the spread of this machine's frictions and zeros, in units of the prior's."""
    n, d = a.n, a.n - DRIFT
    for kind in range(2):
        total, count = a.prior, a.prior
        for i in range(d):
            if a.kinds[i] == kind:
                x, variance = a.basis[DRIFT + i], new[n * n + n + d + i * d + i]
                total += (x * x + variance) / (a.unit[DRIFT + i] * a.unit[DRIFT + i])
                count += 1.0
        new[to + kind] = total / count


@inner
def limit(a: KernelDrift, new: Numbers) -> None:
    """Limit the drift. Where that changes it, the information is changed to give the limited drift."""
    n, place, outside = a.n, a.n * a.n + a.n, 0
    for i in range(n - DRIFT):
        x = min(max(a.basis[DRIFT + i], a.low[i]), a.high[i])
        if x != a.basis[DRIFT + i]:
            outside = 1
        new[place + i], a.basis[DRIFT + i] = x, x
    if outside:
        for i in range(n):
            total = 0.0
            for j in range(i, n):
                total += new[i * n + j] * a.basis[j]
            new[n * n + i] = total


@inner
def smoothed(a: KernelDrift, columns: Numbers, mass: Number, new: Numbers) -> Number:
    """Return the mass [kg] of the load that would explain the torque of the drift, smoothed over updates."""
    n, square, product = a.n, 0.0, 0.0
    for r in range(a.r):
        listed_row(a, columns, r, 0)
        load, torque = a.rows[0] / a.row_error[r], 0.0
        for i in range(n - DRIFT):
            torque += a.rows[DRIFT + i] * new[n * n + n + i]
        square += load * load
        product += load * (torque / a.row_error[r])
    return mass + a.shown * (product / (square + 1e-12) - mass)
