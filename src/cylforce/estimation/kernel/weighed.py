"""Residual torque of the tares, and one instant of a lift: `residual.residual`, `service.weighing` and
`recursive.update` in plain numbers.

Sizes: R rows (measured torques), K columns of all effects, P tares, D drifting frictions and pressure zeros. A load is
(m, m x, m z, J): mass [kg], first moments [kg m] and inertia [kg m^2] about the last pin. A lift is estimated by
recursive least squares, whose state is one array (`LiftLayout`), with U'U the information on the load: triangle U
(4, 4), right-hand side (4,), estimate (4,) for zero drift, its covariance (4, 4), and the gram (4, P + D), the sum of
load columns times tare and drift columns, each over the row's variance."""

from math import sqrt

from cylforce.estimation.kernel.restricted import Count, Number, Numbers, inner
from cylforce.estimation.kernel.solver import KernelSolver

# Places in the state of a lift: the triangle comes first.
RIGHT: Count = 16
VALUES: Count = 20
COVARIANCE: Count = 24
GRAM: Count = 40
# Places in the conclusion from a lift.
MASS: Count = 0
MASS_ERROR: Count = 1
CENTRE: Count = 2  # x, z
CENTRE_ERROR: Count = 4  # of x, z
DRIFT_MOMENT: Count = 6
SENSITIVITY: Count = 7


def residual_torque(s: KernelSolver, rows: Numbers, drift: Numbers, residual: Numbers) -> None:
    """Compute the residual torque of R measured torques at one instant: scale (torque - W tares - W_D drift).

    W tares is the torque of the empty machine with its identified parameters, W_D drift that of their changes since. Of
    a cylinder at rest the direction of the dry friction is unknown: its whole torque is an error.

    Read:
    rows:     (R, K) columns W, of which the first P are those of the tares; then (R,) measured torques [N m]
    drift:    (D,) changes of the frictions [N, N s/m] and pressure zeros [N] since the identification

    Written:
    residual: four parts: (R,) residual torque [N m]; (R,) its variance without friction at rest [N^2 m^2]; (R,)
              variance of friction at rest [N^2 m^2]; (R, D) columns W_D of the drift
    """
    values, changing = s.values, s.changing
    variances, rest_variances, drift_columns = s.r, 2 * s.r, 3 * s.r  # places of the last three parts
    for r in range(s.r):
        row, measured = r * s.k, rows[s.r * s.k + r]
        torque = measured
        for i in range(s.p):
            torque -= rows[row + i] * values[i]
        for i in range(s.d):
            column = rows[row + changing[i]]
            residual[drift_columns + r * s.d + i] = column
            torque -= column * drift[i]
        torque *= s.scale
        residual[r] = torque
        residual[variances + r] = s.row_error[r] * s.row_error[r] + (s.relative * torque) * (s.relative * torque)
        friction = 0.0  # largest torque of friction of unknown direction [N m]
        for c in range(s.dry_size):
            resting_lever = rows[row + s.at_rest + c]  # 0 in motion
            if resting_lever != 0.0:
                share = resting_lever / (abs(rows[row + s.coulomb + c]) + abs(resting_lever))
                friction += resting_lever * s.dry[c] + share * s.by_load[c] * abs(measured)
        residual[rest_variances + r] = friction * friction


@inner
def quadratic(s: KernelSolver, matrix: Numbers, matrix_at: Count, size: Count, x: Numbers, x_at: Count) -> Number:
    """Return x' C x of a symmetric matrix C and a vector x; the zeros of x are skipped.

    Read:
    matrix: contains C (size, size) from `matrix_at` on
    x:      contains x (size,) from `x_at` on

    Written: `s.sparse_at` and `s.sparse_x`, places and values of the numbers of x that are not zero
    """
    places, values, number, total = s.sparse_at, s.sparse_x, 0, 0.0
    for i in range(size):
        value = x[x_at + i]
        if value != 0.0:
            half, row = 0.0, matrix_at + i * size
            for k in range(number):
                half += matrix[row + places[k]] * values[k]
            total += value * (matrix[row + i] * value + 2.0 * half)
            places[number], values[number] = i, value
            number += 1
    return total


@inner
def columns_of_load(s: KernelSolver, columns: Numbers, size: Count, load_columns: Numbers) -> None:
    """Compute the torque (R, 4) of R measured joints per unit of a load (m, m x, m z, J about the last pin).

    A load adds to some of the P identified parameters (tares), so that its columns are sums of theirs.

    Read:
    columns:      (R, size) columns, of which the first P are those of the tares

    Written:
    load_columns: (R, 4) columns of the load [N m per kg, kg m, kg m, kg m^2]
    """
    for r in range(s.r):
        for i in range(4):
            load_columns[4 * r + i] = 0.0
        for i in range(s.loads):
            tare, component = s.load_at[2 * i], s.load_at[2 * i + 1]
            load_columns[4 * r + component] += columns[r * size + tare] * s.load[i]


@inner
def load_at_drift(s: KernelSolver, lift: Numbers, drift: Numbers, load: Numbers) -> None:
    """Compute the load of a lift, corrected by the present drift of friction and zeros: b = values - C G drift.

    The state of a lift holds the estimate for zero drift, its covariance C (4, 4), and in the last D columns of its
    gram the G (4, D) of the drift: the drift may change during a lift.

    Read:
    lift:  state of the lift
    drift: (D,) present changes of frictions [N, N s/m] and pressure zeros [N]

    Written:
    load:  (8,) the load (m, m x, m z, J about the last pin) [kg, kg m, kg m, kg m^2]; then G drift (4,), in the inverse
           of these units
    """
    size, by_drift = s.p + s.d, 4
    for i in range(4):
        by = 0.0
        for j in range(s.d):
            by += lift[GRAM + i * size + s.p + j] * drift[j]
        load[by_drift + i] = by
    for i in range(4):
        total = lift[VALUES + i]
        for j in range(4):
            total -= lift[COVARIANCE + 4 * i + j] * load[by_drift + j]
        load[i] = total


def gate(
    s: KernelSolver,
    rows: Numbers,
    residual: Numbers,
    base_variance: Numbers,
    usable: Numbers,
    rested: Numbers,
    drift: Numbers,
    drift_covariance: Numbers,
    work: Numbers,
    lift: Numbers,
) -> Count:
    """Return whether an instant fits the load of a lift: 0 no, 1 yes, 2 yes and a usable row moves.

    Without a usable row it does not fit. It fits if the mean over the usable rows of innovation^2 / variance is at most
    `s.gate`. The innovation is the residual torque less that of the load so far. Its variance is that of the row, of
    the load, of the drift (`s.cold` standard errors, but at most `s.drifted` times the row's variance) and of friction
    at rest (`s.break_away` standard errors). A row that has been at rest for more than `s.longest_rest` steps is not
    used for the load: its friction is one unknown for the whole rest.

    Read:
    rows:             (R, K) columns; then (R,) measured torques [N m]
    residual:         of the instant (`residual_torque`): (R,) torque [N m], (R,) variance, (R,) variance of friction at
                      rest [N^2 m^2], (R, D) columns of the drift
    base_variance:    (R,) variance by a rocking base, added to that of each row [N^2 m^2]
    usable:           (R,) 1 where a row can be used, else 0
    rested:           (R,) steps for which each row has been at rest, less those in motion since
    drift:            (D,) changes of frictions [N, N s/m] and pressure zeros [N] that the residual excludes
    drift_covariance: (D, D) of the drift
    lift:             state of the lift (`LiftLayout`)

    Written:
    work:             (8, R) (`GateLayout`): columns of the load (R, 4); residual torque before the drift is
                      subtracted (R,) [N m]; variance of its error with which the row is weighted, enlarged for
                      correlated samples (R,) [N^2 m^2]; 1 where a row is to be used for the load, else 0 (R,); `rested`
                      after this instant (R,)
    """
    load = s.short_work
    columns_of_load(s, rows, s.k, work)
    load_at_drift(s, lift, drift, load)
    total, number, moving = 0.0, 0, 0
    for r in range(s.r):
        torque, variance, rest_variance = residual[r], residual[s.r + r] + base_variance[r], residual[2 * s.r + r]
        drift_columns = 3 * s.r + r * s.d
        by_drift, expected = 0.0, 0.0
        for i in range(s.d):
            by_drift += residual[drift_columns + i] * drift[i]
        for i in range(4):
            expected += work[4 * r + i] * load[i]
        allowed = quadratic(s, lift, COVARIANCE, 4, work, 4 * r)
        unknown_drift = s.cold * s.cold * quadratic(s, drift_covariance, 0, s.d, residual, drift_columns)
        allowed += min(unknown_drift, s.drifted * variance)
        allowed += variance + s.break_away * s.break_away * rest_variance
        still = rest_variance > variance
        steps = min(rested[r], s.longest_rest) + 1.0 if still else max(rested[r] - 1.0, 0.0)
        work[4 * s.r + r] = torque + s.scale * by_drift
        # consecutive samples are correlated: `memory` of them count as one, and a whole rest as one
        work[5 * s.r + r] = s.memory * variance + s.longest_rest * rest_variance
        work[6 * s.r + r] = 1.0 if usable[r] != 0.0 and steps <= s.longest_rest else 0.0
        work[7 * s.r + r] = steps
        if usable[r] != 0.0:
            total += (torque - expected) * (torque - expected) / allowed
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
    """Update the state of a lift with an instant that fits, by recursive least squares.

    Read:
    rows:     (R, K) columns; then (R,) measured torques [N m]
    residual: of the instant (`residual_torque`), of which only the columns (R, D) of the drift are used
    work:     results of `gate` (`GateLayout`): columns of the load (R, 4), residual torque before the drift is
              subtracted (R,) [N m], its variance (R,) [N^2 m^2], 1 where a row is to be used (R,)

    Read and written:
    lift:     state of the lift (`LiftLayout`)
    """
    size, row = s.p + s.d, s.short_work
    for r in range(s.r):
        if work[6 * s.r + r] != 0.0:
            variance = work[5 * s.r + r]
            weight = 1.0 / sqrt(variance)
            for i in range(4):
                row[i] = work[4 * r + i] * weight
                share = work[4 * r + i] / variance
                if share != 0.0:
                    add(lift, GRAM + i * size, share, rows, r * s.k, s.p)
                    add(lift, GRAM + i * size + s.p, share, residual, 3 * s.r + r * s.d, s.d)
            rotate(row, work[4 * s.r + r] * weight, lift)
    solve_triangle(s, lift)


def weigh_load(
    s: KernelSolver,
    rows: Numbers,
    residual: Numbers,
    base_variance: Numbers,
    usable: Numbers,
    rested: Numbers,
    drift: Numbers,
    drift_covariance: Numbers,
    work: Numbers,
    lift: Numbers,
    conclusion: Numbers,
) -> Count:
    """Update the state of a lift with one instant if it fits, and compute the mass and centre of its load.

    Return 0 if the instant does not fit the load so far, 1 if it does, 2 if it does and a usable row moves (`gate`).

    Read:
    rows:             (R, K) columns; then (R,) measured torques [N m]
    residual:         of the instant (`residual_torque`): (R,) torque [N m], (R,) variance, (R,) variance of friction at
                      rest [N^2 m^2], (R, D) columns of the drift
    base_variance:    (R,) variance by a rocking base, added to that of each row [N^2 m^2]
    usable:           (R,) 1 where a row can be used, else 0
    rested:           (R,) steps for which each row has been at rest, less those in motion since
    drift:            (D,) changes of frictions [N, N s/m] and pressure zeros [N] that the residual excludes
    drift_covariance: (D, D) of the drift

    Read and written:
    lift:             state of the lift (`LiftLayout`); unchanged if the instant does not fit

    Written:
    work:             (8, R) results of `gate` (`GateLayout`)
    conclusion:       results of `conclude` (`ConclusionLayout`): mass [kg], centre [m], their errors, sensitivity
    """
    fits = gate(s, rows, residual, base_variance, usable, rested, drift, drift_covariance, work, lift)
    if fits != 0:
        take(s, rows, residual, work, lift)
    conclude(s, lift, drift, drift_covariance, conclusion)
    return fits


def unexplained_torque(
    s: KernelSolver, rows: Numbers, residual: Numbers, lift: Numbers, unexplained: Numbers, values: Numbers
) -> None:
    """Compute the torque of an instant that the load of a lift does not explain either, and the parameters of machine
    and load together.

    The load is the estimate (m, m x, m z, J) [kg, kg m, kg m, kg m^2] for zero drift. A load adds to some of the tares.

    Read:
    rows:        (R, K) columns, of which the first P are those of the tares; then (R,) measured torques [N m]
    residual:    of the instant (`residual_torque`), of which only the (R,) torque [N m] is used
    lift:        state of the lift (`LiftLayout`), of which the estimate (4,) of the load is used

    Written:
    unexplained: (R,) residual torque less that of the load [N m]
    values:      (P,) tares with the load added, in the units of the tares
    """
    load_columns = s.work
    columns_of_load(s, rows, s.k, load_columns)
    for r in range(s.r):
        total = 0.0
        for i in range(4):
            total += load_columns[4 * r + i] * lift[VALUES + i]
        unexplained[r] = residual[r] - total
    add_load(s, lift, VALUES, values)


@inner
def add_load(s: KernelSolver, load: Numbers, load_place: Count, values: Numbers) -> None:
    """Compute the parameters (P,) of machine and load together: the identified ones (tares) plus those of the load.

    Read:
    load:   contains the load (m, m x, m z, J) from `load_place` on [kg, kg m, kg m, kg m^2]

    Written:
    values: (P,) parameters
    """
    for i in range(s.p):
        values[i] = s.values[i]
    for i in range(s.loads):
        tare, component = s.load_at[2 * i], s.load_at[2 * i + 1]
        values[tare] += s.load[i] * load[load_place + component]


@inner
def add(total: Numbers, total_at: Count, factor: Number, x: Numbers, x_at: Count, size: Count) -> None:
    """Add `factor` x to a vector; the zeros of x are skipped.

    Read:
    x:     contains x (size,) from `x_at` on

    Read and written:
    total: contains the vector (size,) from `total_at` on
    """
    for j in range(size):
        if x[x_at + j] != 0.0:
            total[total_at + j] += factor * x[x_at + j]


@inner
def rotate(row: Numbers, observed: Number, triangle: Numbers) -> None:
    """Update a least-squares triangle of the load's four unknowns with one more row, by Givens' rotations.

    observed: right-hand side of the row, over its standard error

    Read and destroyed:
    row:      (4,) coefficients of the row, over its standard error

    Read and written:
    triangle: upper triangle U (4, 4) by rows, then its right-hand side z (4,)
    """
    for i in range(4):
        b = row[i]
        if b != 0.0:
            a = triangle[5 * i]
            length = sqrt(a * a + b * b)
            cosine, sine = a / length, b / length
            for j in range(i, 4):
                a, b = triangle[4 * i + j], row[j]
                triangle[4 * i + j], row[j] = cosine * a + sine * b, cosine * b - sine * a
            a = triangle[RIGHT + i]
            triangle[RIGHT + i], observed = cosine * a + sine * observed, cosine * observed - sine * a


@inner
def solve_triangle(s: KernelSolver, lift: Numbers) -> None:
    """Compute the estimate U^-1 z of a load and its covariance (U'U)^-1, from the triangle U and right-hand side z.

    Read and written:
    lift: state of the lift (`LiftLayout`); triangle (4, 4) and right-hand side (4,) are read, estimate (4,) and
          covariance (4, 4) are written
    """
    inverse = s.matrix  # U^-1 (4, 4)
    for j in range(4):
        for i in range(3, -1, -1):
            total = 1.0 if i == j else 0.0
            for k in range(i + 1, j + 1):
                total -= lift[4 * i + k] * inverse[4 * k + j]
            inverse[4 * i + j] = total / lift[5 * i] if i <= j else 0.0
    for i in range(4):
        total = 0.0
        for k in range(i, 4):
            total += inverse[4 * i + k] * lift[RIGHT + k]
        lift[VALUES + i] = total
        for j in range(4):
            total = 0.0
            for k in range(max(i, j), 4):
                total += inverse[4 * i + k] * inverse[4 * j + k]
            lift[COVARIANCE + 4 * i + j] = total


@inner
def sensitivity(lift: Numbers, component: Count, size: Count, first: Count, slopes: Numbers, slopes_at: Count) -> None:
    """Compute how the estimate of one component of the load depends on tares and drift: C gram.

    The tares are the identified parameters, the drift is their change since. The estimate changes by minus this number
    per unit of each of them.

    component: of the load, 0 to 3
    size:      P + D, number of columns of the gram
    first:     first of these columns that is computed

    Read:
    lift:      state of the lift (`LiftLayout`): covariance C (4, 4) and gram (4, size)

    Written:
    slopes:    gets the results (size - first,) from `slopes_at` on
    """
    row = COVARIANCE + 4 * component
    a, b, c, d = lift[row], lift[row + 1], lift[row + 2], lift[row + 3]
    for j in range(first, size):
        g = GRAM + j
        total = a * lift[g] + b * lift[g + size]
        slopes[slopes_at + j - first] = total + c * lift[g + 2 * size] + d * lift[g + 3 * size]


def conclude(s: KernelSolver, lift: Numbers, drift: Numbers, drift_covariance: Numbers, conclusion: Numbers) -> None:
    """Compute mass and centre of the load of a lift, with their standard errors.

    The centre is the first moment over the mass; over 1 kg where the mass is less than 1 kg either way.

    Read:
    lift:             state of the lift (`LiftLayout`)
    drift:            (D,) present changes of frictions [N, N s/m] and pressure zeros [N]
    drift_covariance: (D, D) of the drift

    Written:
    conclusion:       (`ConclusionLayout`) mass [kg]; its standard error by noise, tares, drift and scale [kg]; centre
                      x, z of the load [m]; their standard errors by noise [m]; standard error of the first moment by
                      the drift [kg m]; (P + D,) change of the mass per unit of each tare and drift, sign reversed
    """
    load, slopes = s.short_work, s.work
    size, d = s.p + s.d, s.d
    load_at_drift(s, lift, drift, load)
    sensitivity(lift, 0, size, 0, conclusion, SENSITIVITY)
    moment = 0.0  # variance of m x and of m z by the drift, together
    for component in range(1, 3):
        sensitivity(lift, component, size, s.p, slopes, 0)
        moment += quadratic(s, drift_covariance, 0, d, slopes, 0)
    mass = load[0]
    by_scale = mass * s.scale_error
    by_tares = quadratic(s, s.covariance, 0, s.p, conclusion, SENSITIVITY)
    by_drift = quadratic(s, drift_covariance, 0, d, conclusion, SENSITIVITY + s.p)
    variance = lift[COVARIANCE] + (by_tares + by_drift) + by_scale * by_scale
    conclusion[MASS], conclusion[MASS_ERROR] = mass, sqrt(max(variance, 0.0))
    scale = mass if abs(mass) > 1.0 else 1.0
    for i in range(2):
        centre, moment_at = load[1 + i] / scale, 1 + i
        # variance of (m x) / m: the row (-x, 1) / m on both sides of the covariance of (m, m x)
        error = centre * centre * lift[COVARIANCE] - 2.0 * centre * lift[COVARIANCE + moment_at]
        error += lift[COVARIANCE + 5 * moment_at]
        conclusion[CENTRE + i], conclusion[CENTRE_ERROR + i] = centre, sqrt(max(error, 0.0)) / abs(scale)
    conclusion[DRIFT_MOMENT] = sqrt(max(moment, 0.0))
