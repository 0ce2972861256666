"""Drift of friction and pressure zeros, updated at each instant with an empty bucket.

The computation is that of `estimation.recursive` (`forget`, `update`), in plain numbers; `service.adaptation` calls
it. `KernelDrift` holds the constants of one machine.

Sizes: R rows (measured torques), K columns of all effects, D drifting frictions and pressure zeros, N = 5 + D unknowns:
deviation of this return's load from the usual one (4), the usual carry-back [kg] (1), the drift (D).

The information is U'U, with the upper triangle U (N, N) and its right-hand side z (N,): U unknowns = z.

The result of an update is one array (`layout.DriftLayout`): triangle (N, N), right-hand side (N,), drift (D,), its
covariance (D, D), scale (2,) and mass. The functions `update_...` give the places of these parts."""

from collections.abc import Sequence
from math import sqrt
from typing import Any

from cylforce.estimation.kernel.restricted import (
    Count,
    Counts,
    Number,
    Numbers,
    as_counts,
    as_numbers,
    inner,
    record,
)
from cylforce.estimation.kernel.solver import invert

USUAL: Count = 4  # place of the usual carry-back, after the load's four deviations from it
DRIFT: Count = 5  # place of the first drift, after the usual carry-back
FORGETTING: Number = 1e-6  # times the longest vector: in directions below it nothing is forgotten; as in `recursive`


@record
class KernelDrift:
    """Constants of one machine for the adaptation of friction and pressure zeros while the empty bucket returns.

    There are R rows (measured torques) of K columns. The N = 5 + D unknowns are the deviation of this return's
    carry-back from the usual one, as a load (m, m x, m z, J) (4); the mass of the usual carry-back (1); and the D
    drifts, frictions first, then pressure zeros.

    r, k, n:   sizes R, K, N
    rests:     number of columns in `at_rest`
    coulombs:  number of columns in `coulomb`
    loads:     M, length of `load`

    Limits of the adaptation (`service.adaptation`):
    certain:   largest share of the lever with friction of unknown direction, at which a row is used
    keep:      share of the old information that an update keeps, in the directions of its rows
    memory:    number of updates that count as one independent measurement
    prior:     number of drifts that count as much as the prior variance does in `scale` (`estimate_scale`)
    shown:     share of the difference by which an update changes the drift in kilograms (`smoothed_mass`)
    mean:      prior mean of the usual carry-back, in its standard errors

    Model:
    changing:  (D,) columns of the drift
    kinds:     (D,) 0 friction, 1 zero
    load_at:   (M, 2) parameter, and component 0 to 3 of a load, of each number of `load`
    at_rest:   columns of friction of unknown direction, at rest
    coulomb:   columns of Coulomb friction
    load:      (M,) share of that parameter in that component
    unit:      (N,) prior standard errors of the unknowns
    low, high: (D,) limits of the drift
    row_error: (R,) standard error of each row [N m]
    alike:     (D, D) inverse of the prior correlation of the drifts, none between kinds
    usual:     (4,) load (m, m x, m z, J) of one kilogram of the usual carry-back [kg, kg m, kg m, kg m^2]

    Room for intermediate results:
    good:      (R,) rows to use
    rows:      (R, N) their coefficients
    basis:     (R, N) directions in which information is forgotten; then its first row is the estimate
    row:       (N,) one row
    matrix:    (N, N) first the triangle U of the information U'U, then the information matrix
    inverse:   (N, N) first the right-hand side z (N,) of the triangle, then the inverse information matrix

    arrays:    the lists of arrays, kept so that the memory of the fields above remains
    """

    r: Count
    k: Count
    n: Count
    rests: Count
    coulombs: Count
    loads: Count
    certain: Number
    keep: Number
    memory: Number
    prior: Number
    shown: Number
    mean: Number
    changing: Counts
    kinds: Counts
    load_at: Counts
    good: Counts
    at_rest: Counts
    coulomb: Counts
    load: Numbers
    unit: Numbers
    low: Numbers
    high: Numbers
    row_error: Numbers
    alike: Numbers
    usual: Numbers
    rows: Numbers
    basis: Numbers
    row: Numbers
    matrix: Numbers
    inverse: Numbers
    arrays: object

    def __init__(self, sizes: Sequence[int], limits: Sequence[float], counts: list[Any], numbers: list[Any]) -> None:
        """Set the constants of a machine, and the room for intermediate results, from lists.

        sizes:   numbers of measured torques (r), of columns (k) and of unknowns (n): 5 of the carry-back, D drifts
        limits:  certain, largest share of a lever with friction of unknown direction; keep, share of the information
                 that an update keeps; memory, updates that count as one measurement; prior, drifts for which the prior
                 variance counts; shown, share of an update of the mass; mean, prior mean of the usual carry-back in its
                 standard errors
        counts:  arrays of integers: columns of the drifts and their kinds, places of a load among the parameters, room
                 for the rows to use, columns of friction at rest and of Coulomb friction
        numbers: arrays of numbers: shares of a load in the parameters, prior standard errors of the unknowns, limits of
                 the drift (lowest, highest), errors of the rows [N m], inverse correlation of the drifts, load of one
                 kilogram of carry-back, and five arrays of room
        """
        self.arrays = (counts, numbers)
        self.r, self.k, self.n = sizes[0], sizes[1], sizes[2]
        self.certain, self.keep, self.memory, self.prior, self.shown, self.mean = (limits[i] for i in range(6))
        self.changing, self.kinds = as_counts(counts[0]), as_counts(counts[1])
        self.load_at, self.good = as_counts(counts[2]), as_counts(counts[3])
        self.at_rest, self.coulomb = as_counts(counts[4]), as_counts(counts[5])
        self.rests, self.coulombs, self.loads = len(counts[4]), len(counts[5]), len(numbers[0])
        self.load, self.unit = as_numbers(numbers[0]), as_numbers(numbers[1])
        self.low, self.high, self.row_error = as_numbers(numbers[2]), as_numbers(numbers[3]), as_numbers(numbers[4])
        self.alike, self.usual, self.rows = as_numbers(numbers[5]), as_numbers(numbers[6]), as_numbers(numbers[7])
        self.basis, self.row, self.matrix = as_numbers(numbers[8]), as_numbers(numbers[9]), as_numbers(numbers[10])
        self.inverse = as_numbers(numbers[11])


@inner
def update_right(a: KernelDrift) -> Count:
    """Return the place in an update of the right-hand side (N,); the triangle (N, N) comes first."""
    return a.n * a.n


@inner
def update_values(a: KernelDrift) -> Count:
    """Return the place in an update of the drift (D,)."""
    return a.n * a.n + a.n


@inner
def update_covariance(a: KernelDrift) -> Count:
    """Return the place in an update of the covariance (D, D) of the drift."""
    return update_values(a) + a.n - DRIFT


@inner
def update_scale(a: KernelDrift) -> Count:
    """Return the place in an update of the variance (2,) of frictions and of zeros, in units of the prior's."""
    return update_covariance(a) + (a.n - DRIFT) * (a.n - DRIFT)


@inner
def update_mass(a: KernelDrift) -> Count:
    """Return the place in an update of the mass [kg] that the empty bucket would show without the adaptation."""
    return update_scale(a) + 2


def rows_for_drift(a: KernelDrift, columns: Numbers, usable: Numbers) -> Count:
    """Return the number of rows (measured torques) with which the drift can be updated, and list them.

    A row is used if it is usable and in motion: less than the share `a.certain` of its lever has friction of unknown
    direction.

    Read:
    columns: (R, K) of the rows (measured torques)
    usable:  (R,) 1 where a row can be used, else 0

    Written: the numbers of the rows, in `a.good`
    """
    number = 0
    for r in range(a.r):
        row, unknown, lever = r * a.k, 0.0, 0.0
        for i in range(a.rests):
            unknown += columns[row + a.at_rest[i]]
        for i in range(a.coulombs):
            lever += abs(columns[row + a.coulomb[i]])
        if usable[r] != 0.0 and unknown / max(lever + unknown, 1e-12) < a.certain:
            a.good[number] = r
            number += 1
    return number


def update_drift(
    a: KernelDrift,
    number: Count,
    columns: Numbers,
    residual: Numbers,
    base_variance: Numbers,
    factor: Numbers,
    right: Numbers,
    values: Numbers,
    scale: Numbers,
    mass: Number,
    update: Numbers,
) -> None:
    """Update the drift of frictions and pressure zeros with one instant of an empty bucket.

    Recursive least squares: information is forgotten in the directions of the rows, then the rows are added.

    number:        of rows that `rows_for_drift` has listed
    mass:          that the empty bucket would show without the adaptation, before [kg]

    Read:
    columns:       (R, K) of the instant
    residual:      of the instant with the drift so far (`weighed.residual_torque`): (R,) torque [N m], (R,) variance
                   [N^2 m^2]
    base_variance: (R,) variance by a rocking base, added to that of each row [N^2 m^2]
    factor, right: triangle (N, N) and right-hand side (N,) of the information so far
    values:        (D,) drift so far: frictions [N, N s/m], zeros [N]
    scale:         (2,) variance of frictions and of zeros, in units of the prior's

    Written:
    update:        (`layout.DriftLayout`) triangle (N, N), right-hand side (N,), drift (D,), its covariance (D, D),
                   scale (2,) and mass [kg] after these rows; triangle and right-hand side must be zero before
    """
    n, d = a.n, a.n - DRIFT
    for m in range(number):
        write_equation(a, columns, a.good[m], m)
    for i in range(n * n):
        a.matrix[i] = factor[i]
    for i in range(n):
        a.inverse[i] = right[i]
    forget_along_rows(a, number)
    for i in range(n):  # a triangle again
        for j in range(n):
            a.row[j] = a.matrix[i * n + j]
        rotate_row(a, update, a.inverse[i])
    for m in range(number):
        r, observed = a.good[m], residual[a.good[m]]
        for i in range(d):  # the residual excludes the drift so far
            observed += a.rows[m * n + DRIFT + i] * values[i]
        weight = 1.0 / sqrt(a.memory * (residual[a.r + r] + base_variance[r]))
        for i in range(n):
            a.row[i] = a.rows[m * n + i] * weight
        rotate_row(a, update, observed * weight)
    estimate_drift(a, scale, update)
    update[update_mass(a)] = smoothed_mass(a, columns, mass, update)


@inner
def write_equation(a: KernelDrift, columns: Numbers, r: Count, m: Count) -> None:
    """Write the equation of one measured torque: its torque per unit of each of the N unknowns of the adaptation.

    The unknowns are the deviation of this return's carry-back from the usual one, as a load m, m x, m z, J (4); the
    usual carry-back [kg] (1); the drift of frictions [N, N s/m] and pressure zeros [N] (D).

    r:       number of the measured torque
    m:       row of the result in `a.rows`

    Read:
    columns: (R, K) of the instant

    Written: row m of `a.rows` (R, N)
    """
    for i in range(4):
        a.rows[m * a.n + i] = 0.0
    for i in range(a.loads):
        tare, component = a.load_at[2 * i], a.load_at[2 * i + 1]
        a.rows[m * a.n + component] += columns[r * a.k + tare] * a.load[i]
    of_usual = 0.0
    for i in range(4):
        of_usual += a.rows[m * a.n + i] * a.usual[i]
    a.rows[m * a.n + USUAL] = of_usual
    for i in range(a.n - DRIFT):
        a.rows[m * a.n + DRIFT + i] = columns[r * a.k + a.changing[i]]


@inner
def forget_along_rows(a: KernelDrift, number: Count) -> None:
    """Forget a share 1 - `a.keep` of the information in the directions of the rows (`recursive.forget`).

    The directions are an orthonormal basis of the vectors U row, with U the triangle. It is found by Gram and Schmidt,
    the longest vector first, each made orthogonal twice. Vectors below FORGETTING times the longest are omitted.

    number: of rows in `a.rows` (R, N)

    Read and written: `a.matrix`, the triangle U (N, N); the first N numbers of `a.inverse`, its right-hand side z

    Written: `a.basis` (R, N)
    """
    n, x, first = a.n, a.basis, 0.0
    for m in range(number):
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += a.matrix[i * n + j] * a.rows[m * n + j]
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
            make_orthogonal(a, step, step + 1 + (m - step - 1) % (number - step - 1))
        forget_along(a, step)


@inner
def longest_of(a: KernelDrift, begin: Count, end: Count) -> Count:
    """Return the number of the longest of the vectors `begin` up to `end` (excluded) of `a.basis` (R, N)."""
    found, most = begin, -1.0
    for m in range(begin, end):
        size = 0.0
        for i in range(a.n):
            size += a.basis[m * a.n + i] * a.basis[m * a.n + i]
        if size > most:
            found, most = m, size
    return found


@inner
def make_orthogonal(a: KernelDrift, one: Count, other: Count) -> None:
    """Make the vector `other` of `a.basis` (R, N) orthogonal to the vector `one`, which has the length 1."""
    along = 0.0
    for i in range(a.n):
        along += a.basis[one * a.n + i] * a.basis[other * a.n + i]
    for i in range(a.n):
        a.basis[other * a.n + i] -= along * a.basis[one * a.n + i]


@inner
def forget_along(a: KernelDrift, m: Count) -> None:
    """Forget information in one direction: U <- (I - (1 - sqrt(keep)) q q') U, z <- (I - (1 - sqrt(keep)) q q') z.

    The information U'U thereby loses (1 - keep) (U'q) (U'q)'. U is no triangle then.

    m: number of the vector q, of length 1, among the R vectors of `a.basis` (R, N)

    Read and written: `a.matrix`, the triangle U (N, N); the first N numbers of `a.inverse`, its right-hand side z
    """
    n, lost, right = a.n, 1.0 - sqrt(a.keep), a.inverse  # `inverse` is not computed yet and holds z
    for j in range(n + 1):  # the columns of U, then z
        along = 0.0
        for i in range(n):
            along += a.basis[m * n + i] * (a.matrix[i * n + j] if j < n else right[i])
        for i in range(n):
            if j < n:
                a.matrix[i * n + j] -= lost * along * a.basis[m * n + i]
            else:
                right[i] -= lost * along * a.basis[m * n + i]


@inner
def rotate_row(a: KernelDrift, update: Numbers, observed: Number) -> None:
    """Add one more equation, row @ unknowns = observed, to the information of least squares, by Givens' rotations.

    The information is the triangle U of U'U and its right-hand side z (N,).

    observed: right-hand side of the row, over its standard error

    Read and destroyed: `a.row` (N,), coefficients of the row, over its standard error

    Read and written:
    update:   begins with the upper triangle (N, N) by rows and its right-hand side (N,)
    """
    n, row, right = a.n, a.row, update_right(a)
    for i in range(n):
        b = row[i]
        if b != 0.0:
            c = update[i * n + i]
            length = sqrt(c * c + b * b)
            cosine, sine = c / length, b / length
            for j in range(i, n):
                c, b = update[i * n + j], row[j]
                update[i * n + j], row[j] = cosine * c + sine * b, cosine * b - sine * c
            c = update[right + i]
            update[right + i], observed = cosine * c + sine * observed, cosine * observed - sine * c


@inner
def estimate_drift(a: KernelDrift, scale: Numbers, update: Numbers) -> None:
    """Compute the drift of friction and zeros from the information of all returns, with its covariance and its spread.

    It is (U'U + prior)^-1 (U'z + prior mean), limited to its physical range. The scale is the variance of this
    machine's frictions and zeros in units of the prior's.

    Read:
    scale:  (2,) variance of frictions and of zeros so far, in units of the prior's

    Read and written:
    update: (`layout.DriftLayout`) triangle U (N, N) and right-hand side z (N,) are read; drift (D,), covariance (D, D)
            and scale (2,) are written. z changes where the drift is limited

    Written: `a.basis`, whose first N numbers become the estimate of the unknowns; `a.matrix`, `a.inverse` and `a.row`
    """
    n, d, covariance, right = a.n, a.n - DRIFT, update_covariance(a), update_right(a)
    information_matrix(a, scale, update)
    invert(a.matrix, n, a.inverse, 0)
    for i in range(n):
        total = 0.0
        for k in range(i + 1):
            total += update[k * n + i] * update[right + k]
        a.row[i] = total * a.unit[i]
    a.row[USUAL] += a.mean
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += a.inverse[i * n + j] * a.row[j]
        a.basis[i] = total * a.unit[i]
    for i in range(d):
        for j in range(d):
            both = a.unit[DRIFT + i] * a.unit[DRIFT + j]
            update[covariance + i * d + j] = both * a.inverse[(DRIFT + i) * n + DRIFT + j]
    estimate_scale(a, update)
    limit_drift(a, update)


@inner
def information_matrix(a: KernelDrift, scale: Numbers, update: Numbers) -> None:
    """Compute the information matrix (inverse covariance) of the N unknowns: U'U of the measured rows plus the priors.

    The unit of each unknown is its prior standard error `a.unit`. The prior of the usual carry-back is one then. That
    of the drift is the inverse correlation over the variance of its kind, friction or zero. These priors are added anew
    at each update, so that they are not forgotten.

    Read:
    scale:  (2,) variance of frictions and of zeros, in units of the prior's
    update: begins with the triangle U (N, N)

    Written: the lower triangle of `a.matrix` (N, N)
    """
    n = a.n
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(j + 1):
                total += update[k * n + i] * update[k * n + j]
            a.matrix[i * n + j] = a.unit[i] * total * a.unit[j]
            if j >= DRIFT:
                a.matrix[i * n + j] += a.alike[(i - DRIFT) * (n - DRIFT) + j - DRIFT] / scale[a.kinds[i - DRIFT]]
    a.matrix[USUAL * n + USUAL] += 1.0


@inner
def estimate_scale(a: KernelDrift, update: Numbers) -> None:
    """Compute the variance of this machine's frictions and of its zeros, in units of the prior's.

    One step of expectation maximisation: (prior count + sum of (drift^2 + variance) / prior variance) / (prior count +
    number), over the drifts of each kind.

    Read: `a.basis`, whose first N numbers are the estimate

    Read and written:
    update: (`layout.DriftLayout`) covariance (D, D) is read, scale (2,) is written
    """
    d, covariance = a.n - DRIFT, update_covariance(a)
    for kind in range(2):
        total, count = a.prior, a.prior
        for i in range(d):
            if a.kinds[i] == kind:
                x, variance = a.basis[DRIFT + i], update[covariance + i * d + i]
                total += (x * x + variance) / (a.unit[DRIFT + i] * a.unit[DRIFT + i])
                count += 1.0
        update[update_scale(a) + kind] = total / count


@inner
def limit_drift(a: KernelDrift, update: Numbers) -> None:
    """Limit the drift to its physical range, between `a.low` and `a.high` (D,) [N, N s/m, N].

    Where that changes it, the right-hand side z becomes U x, so that the information gives the limited x.

    Read and written: `a.basis`, whose first N numbers are the estimate x

    Read and written:
    update: (`layout.DriftLayout`) triangle U (N, N) is read; drift (D,) is written, and z (N,) if x was limited
    """
    n, outside = a.n, 0
    for i in range(n - DRIFT):
        x = min(max(a.basis[DRIFT + i], a.low[i]), a.high[i])
        if x != a.basis[DRIFT + i]:
            outside = 1
        update[update_values(a) + i], a.basis[DRIFT + i] = x, x
    if outside:
        for i in range(n):
            total = 0.0
            for j in range(i, n):
                total += update[i * n + j] * a.basis[j]
            update[update_right(a) + i] = total


@inner
def smoothed_mass(a: KernelDrift, columns: Numbers, mass: Number, update: Numbers) -> Number:
    """Return the mass [kg] that the empty bucket would show without the adaptation, smoothed over updates.

    It is the mass at the last pin (a load m without first moments and inertia) that best explains the torque of the
    drift, by least squares over all R rows. The result moves towards it by the share `a.shown`.

    mass:    after the last update [kg]

    Read:
    columns: (R, K) of the instant
    update:  (`layout.DriftLayout`) of which the drift (D,) is used

    Written: the first row of `a.rows`
    """
    square, product = 0.0, 0.0
    for r in range(a.r):
        write_equation(a, columns, r, 0)
        load, torque = a.rows[0] / a.row_error[r], 0.0
        for i in range(a.n - DRIFT):
            torque += a.rows[DRIFT + i] * update[update_values(a) + i]
        square += load * load
        product += load * (torque / a.row_error[r])
    return mass + a.shown * (product / (square + 1e-12) - mass)
