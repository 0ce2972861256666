"""Residual torque of the tares, and one instant of a lift: `residual.residual`, `service.weighing` and
`recursive.update` in plain numbers."""

from math import sqrt

from cylforce.estimation.kernel.restricted import Count, Number, Numbers, inner
from cylforce.estimation.kernel.solver import KernelSolver

VALUES: Count = 20  # first place of the values in a lift, after factor (4, 4) and right side (4,) of its information
COVARIANCE: Count = 24
GRAM: Count = 40


def explain(s: KernelSolver, rows: Numbers, drift: Numbers, found: Numbers) -> None:
    """Compute the residual torque of an instant.

    rows:  columns (R, K), then torques (R,)
    drift: (D,) values of the drift
    found: (3 + D, R) residual torque, its variance, that of friction at rest, and the columns of the drift (R, D)
    """
    values, changing = s.values, s.changing
    for r in range(s.r):
        o = r * s.k
        residual = rows[s.r * s.k + r]
        for i in range(s.p):
            residual -= rows[o + i] * values[i]
        for i in range(s.d):
            x = rows[o + changing[i]]
            found[3 * s.r + r * s.d + i] = x
            residual -= x * drift[i]
        residual *= s.scale
        found[r] = residual
        found[s.r + r] = s.row_error[r] * s.row_error[r] + (s.relative * residual) * (s.relative * residual)
        rest, torque = 0.0, abs(rows[s.r * s.k + r])
        for c in range(s.dry_size):
            unknown = rows[o + s.at_rest + c]
            if unknown != 0.0:
                share = unknown / (abs(rows[o + s.coulomb + c]) + abs(unknown))
                rest += unknown * s.dry[c] + share * s.by_load[c] * torque
        found[2 * s.r + r] = rest * rest


@inner
def quadratic(s: KernelSolver, matrix: Numbers, begin: Count, size: Count, x: Numbers, o: Count) -> Number:
    """Return x' C x of a symmetric matrix (size, size), which begins at `begin`, and a vector, which begins at `o`; its
    zeros are skipped."""
    places, some, number, total = s.places, s.some, 0, 0.0
    for i in range(size):
        each = x[o + i]
        if each != 0.0:
            half, row = 0.0, begin + i * size
            for k in range(number):
                half += matrix[row + places[k]] * some[k]
            total += each * (matrix[row + i] * each + 2.0 * half)
            places[number], some[number] = i, each
            number += 1
    return total


@inner
def loaded(s: KernelSolver, columns: Numbers, size: Count, into: Numbers) -> None:
    """Compute the columns (R, 4) of a load, from rows of `size` columns that begin with those of the tares."""
    for r in range(s.r):
        for i in range(4):
            into[4 * r + i] = 0.0
        for i in range(s.loads):
            into[4 * r + s.load_at[2 * i + 1]] += columns[r * size + s.load_at[2 * i]] * s.load[i]


@inner
def shift(s: KernelSolver, lift: Numbers, drift: Numbers) -> None:
    """Compute the load (4,) with the present drift, into `spread`: values - covariance gram_D drift."""
    size = s.p + s.d
    for i in range(4):
        by = 0.0
        for j in range(s.d):
            by += lift[GRAM + i * size + s.p + j] * drift[j]
        s.spread[4 + i] = by
    for i in range(4):
        total = lift[VALUES + i]
        for j in range(4):  # b = values - C gram_D drift
            total -= lift[COVARIANCE + 4 * i + j] * s.spread[4 + j]
        s.spread[i] = total


def gate(
    s: KernelSolver,
    rows: Numbers,
    residual: Numbers,
    wider: Numbers,
    usable: Numbers,
    rested: Numbers,
    known: Numbers,
    drift_covariance: Numbers,
    work: Numbers,
    lift: Numbers,
) -> Count:
    """Return whether an instant fits the lift: 0 no, 1 yes, 2 yes and a usable row moves.

    rows:                    columns (R, K) of the instant
    residual:                its residual (`explain`)
    wider:                   (R,) added to the variance of each row
    usable:                  (R,) rows that can be used
    rested:                  (R,) steps at rest of the lift
    known, drift_covariance: (D,) drift and (D, D) its covariance
    work:                    (8, R) results: columns of the load (R, 4), torque with the drift, variance, rows to be
                             taken in, new steps at rest
    lift:                    numbers of the lift
    """
    loaded(s, rows, s.k, work)
    shift(s, lift, known)
    total, number, moving = 0.0, 0, 0
    for r in range(s.r):
        torque, variance = residual[r], residual[s.r + r] + wider[r]
        rest, drifting = residual[2 * s.r + r], 3 * s.r + r * s.d
        by, expected = 0.0, 0.0
        for i in range(s.d):
            by += residual[drifting + i] * known[i]
        for i in range(4):
            expected += work[4 * r + i] * s.spread[i]
        by_drift = s.cold * s.cold * quadratic(s, drift_covariance, 0, s.d, residual, drifting)
        uncertainty = quadratic(s, lift, COVARIANCE, 4, work, 4 * r)
        uncertainty += min(by_drift, s.drifted * variance)
        uncertainty += variance + s.break_away * s.break_away * rest
        still = rest > variance
        steps = min(rested[r], s.patience) + 1.0 if still else max(rested[r] - 1.0, 0.0)
        work[4 * s.r + r] = torque + s.scale * by
        work[5 * s.r + r] = s.memory * variance + s.patience * rest
        work[6 * s.r + r] = 1.0 if usable[r] != 0.0 and steps <= s.patience else 0.0
        work[7 * s.r + r] = steps
        if usable[r] != 0.0:
            total += (torque - expected) * (torque - expected) / uncertainty
            number += 1
            if not still:
                moving = 1
    return 0 if number == 0 or total / number > s.gate else 1 + moving


def take(
    s: KernelSolver,
    rows: Numbers,
    residual: Numbers,
    work: Numbers,
    lift: Numbers,
) -> None:
    """Update the numbers of a lift with an instant that fits.

    rows, residual, work: of `gate`
    """
    size = s.p + s.d
    for r in range(s.r):
        if work[6 * s.r + r] != 0.0:
            variance = work[5 * s.r + r]
            weight = 1.0 / sqrt(variance)
            for i in range(4):
                s.spread[i] = work[4 * r + i] * weight
                each = work[4 * r + i] / variance
                if each != 0.0:
                    add(lift, GRAM + i * size, each, rows, r * s.k, s.p)
                    add(lift, GRAM + i * size + s.p, each, residual, 3 * s.r + r * s.d, s.d)
            rotate(s, lift, work[4 * s.r + r] * weight)
    solve_triangle(s, lift)


def weigh_load(
    s: KernelSolver,
    rows: Numbers,
    residual: Numbers,
    wider: Numbers,
    usable: Numbers,
    rested: Numbers,
    known: Numbers,
    drift_covariance: Numbers,
    work: Numbers,
    lift: Numbers,
    found: Numbers,
) -> Count:
    """Take an instant into the lift if it fits, conclude, and return whether it fits: `gate`, `take` and `conclude`."""
    fits = gate(s, rows, residual, wider, usable, rested, known, drift_covariance, work, lift)
    if fits != 0:
        take(s, rows, residual, work, lift)
    conclude(s, lift, known, drift_covariance, found)
    return fits


def without_load(
    s: KernelSolver, rows: Numbers, residual: Numbers, lift: Numbers, over: Numbers, values: Numbers
) -> None:
    """Compute the torque `over` (R,) of an instant that the load of a lift does not explain either, and parameters
    `values` (P,) of machine and load together."""
    loaded(s, rows, s.k, s.other)
    for r in range(s.r):
        total = 0.0
        for i in range(4):
            total += s.other[4 * r + i] * lift[VALUES + i]
        over[r] = residual[r] - total
    together(s, lift, VALUES, values)


@inner
def together(s: KernelSolver, load: Numbers, begin: Count, values: Numbers) -> None:
    """Compute parameters `values` (P,) of the machine and of a load (4,), which begins at `begin`."""
    for i in range(s.p):
        values[i] = s.values[i]
    for i in range(s.loads):
        values[s.load_at[2 * i]] += s.load[i] * load[begin + s.load_at[2 * i + 1]]


@inner
def add(into: Numbers, at: Count, times: Number, x: Numbers, o: Count, size: Count) -> None:
    """Add `times` the vector that begins at `o` to the vector that begins at `at`."""
    for j in range(size):
        if x[o + j] != 0.0:
            into[at + j] += times * x[o + j]


@inner
def rotate(s: KernelSolver, new: Numbers, observed: Number) -> None:
    """Update the triangle with one more row, `spread` (4,) with `observed`, by Givens' rotations."""
    for i in range(4):
        b = s.spread[i]
        if b != 0.0:
            a = new[5 * i]
            size = sqrt(a * a + b * b)
            along, across = a / size, b / size
            for j in range(i, 4):
                a, b = new[4 * i + j], s.spread[j]
                new[4 * i + j], s.spread[j] = along * a + across * b, along * b - across * a
            a = new[16 + i]
            new[16 + i], observed = along * a + across * observed, along * observed - across * a


@inner
def solve_triangle(s: KernelSolver, new: Numbers) -> None:
    """Compute estimate and covariance (R'R)^-1 from the triangle, by its inverse."""
    inverse = s.square
    for j in range(4):
        for i in range(3, -1, -1):
            total = 1.0 if i == j else 0.0
            for k in range(i + 1, j + 1):
                total -= new[4 * i + k] * inverse[4 * k + j]
            inverse[4 * i + j] = total / new[5 * i] if i <= j else 0.0
    for i in range(4):
        total = 0.0
        for k in range(i, 4):
            total += inverse[4 * i + k] * new[16 + k]
        new[20 + i] = total
        for j in range(4):
            total = 0.0
            for k in range(max(i, j), 4):
                total += inverse[4 * i + k] * inverse[4 * j + k]
            new[24 + 4 * i + j] = total


@inner
def sensitivity(lift: Numbers, row: Count, size: Count, start: Count, into: Numbers, at: Count) -> None:
    """Compute a row of the covariance (4, 4) times the columns of the gram (4, size) from `start` on."""
    o = COVARIANCE + 4 * row
    a, b, c, d = lift[o], lift[o + 1], lift[o + 2], lift[o + 3]
    for j in range(start, size):
        g = GRAM + j
        total = a * lift[g] + b * lift[g + size]
        into[at + j - start] = total + c * lift[g + 2 * size] + d * lift[g + 3 * size]


def conclude(s: KernelSolver, lift: Numbers, drift: Numbers, drift_covariance: Numbers, found: Numbers) -> None:
    """Compute the result of a lift with the drift `drift` (D,) and its covariance `drift_covariance` (D, D).

    found: mass, its standard error by noise, tares, drift and scale; centre x, z of the load, their standard errors;
           standard error of the first moment by the drift; sensitivity (P + D,) of the mass to tares and drift
    """
    size, d, other = s.p + s.d, s.d, s.other
    shift(s, lift, drift)
    sensitivity(lift, 0, size, 0, found, 7)
    moment = 0.0
    for i in range(1, 3):
        sensitivity(lift, i, size, s.p, other, 0)
        moment += quadratic(s, drift_covariance, 0, d, other, 0)
    mass = s.spread[0]
    wrong = mass * s.scale_error
    common = quadratic(s, s.covariance, 0, s.p, found, 7) + quadratic(s, drift_covariance, 0, s.d, found, 7 + s.p)
    found[0], found[1] = mass, sqrt(max(lift[COVARIANCE] + common + wrong * wrong, 0.0))
    scale = mass if abs(mass) > 1.0 else 1.0
    for i in range(2):
        x = s.spread[1 + i] / scale
        a, o = 1 + i, COVARIANCE  # the row along (-x, .. 1 ..) / scale
        error = x * x * lift[o] - 2.0 * x * lift[o + a] + lift[o + 4 * a + a]
        found[2 + i], found[4 + i] = x, sqrt(max(error, 0.0)) / abs(scale)
    found[6] = sqrt(max(moment, 0.0))
