"""Evidence of a block of motion, in plain numbers: whether this is the machine (`service.recognition`), and the errors
of each signal (`service.plausibility.blocks` and `undetected`). Also the motion of a rocking base
(`service.contact.rocking`).

Sizes: R rows (measured torques), K columns of all effects, P tares, D drifting frictions and pressure zeros, H signals
whose errors are examined. A load is (m, m x, m z, J): mass [kg], first moments [kg m] and inertia [kg m^2] about the
last pin. A residual is the result of `weighed.residual_torque`."""

from math import cos, sin, sqrt

from cylforce.estimation.kernel.plan import KernelPlan
from cylforce.estimation.kernel.pushed import copy_tare_columns
from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, inner
from cylforce.estimation.kernel.rows import angle_error_torques
from cylforce.estimation.kernel.solver import KernelSolver, invert
from cylforce.estimation.kernel.weighed import (
    add,
    add_load,
    columns_of_load,
    quadratic,
    residual_torque,
    unexplained_torque,
)

OF_LOAD: Count = 4  # parameters of a load


def gather(
    s: KernelSolver,
    rows: Numbers,
    residual: Numbers,
    usable: Numbers,
    change: Numbers,
    error_torques: Numbers,
    signals: Count,
    memory: Number,
    gram: Numbers,
) -> Count:
    """Add the normal equations of one instant to those of a block, and return the number of rows added.

    A row (measured torque) is added if it is usable and in motion: friction at rest would dominate its error. Its
    equation has G = 4 + D + H + 1 numbers: coefficients of the load (4,), of the changes of frictions and pressure
    zeros (D,), of the errors of signals (H,), and the residual torque. All are over the row's standard error, of which
    the errors of the tares (identified parameters) are a part.

    signals:       H, number of signals
    memory:        consecutive samples that count as one independent sample

    Read:
    rows:          (R, K) columns; then (R,) measured torques [N m]
    residual:      of the instant: (R,) torque [N m], (R,) variance, (R,) variance of friction at rest [N^2 m^2],
                   (R, D) columns of the drift
    usable:        (R,) 1 where a row can be used, else 0
    change:        (D,) unit of the changes of frictions [N, N s/m] and zeros [N]: their standard errors
    error_torques: (R, H) residual torque per unit of each signal's error [N m]

    Read and written:
    gram:          (G, G) sum of the products of the equations' numbers
    """
    variances, rest_variances = s.r, 2 * s.r
    moving = 0
    for r in range(s.r):
        moving += usable[r] != 0.0 and residual[rest_variances + r] < residual[variances + r]
    if moving == 0:
        return 0
    changes, errors, size = OF_LOAD, OF_LOAD + s.d, OF_LOAD + s.d + signals + 1
    load_columns, equation = s.short_work, s.work
    copy_tare_columns(s, rows, 0)
    columns_of_load(s, s.tare_columns, s.p, load_columns)
    for r in range(s.r):
        variance, rest_variance = residual[variances + r], residual[rest_variances + r]
        if usable[r] != 0.0 and rest_variance < variance:
            of_tares = quadratic(s, s.covariance, 0, s.p, s.tare_columns, r * s.p)
            weight = 1.0 / sqrt((variance + rest_variance + of_tares) * memory)
            for i in range(OF_LOAD):
                equation[i] = load_columns[4 * r + i] * weight
            for i in range(s.d):
                equation[changes + i] = rows[r * s.k + s.changing[i]] * change[i] * weight
            for h in range(signals):
                equation[errors + h] = error_torques[r * signals + h] * weight
            equation[size - 1] = residual[r] * weight
            for i in range(size):
                if equation[i] != 0.0:
                    add(gram, i * size, equation[i], equation, 0, size)
    return moving


def daily_change(
    s: KernelSolver,
    drift_covariance: Numbers,
    stroke_errors: Numbers,
    frictions: Count,
    unknown: Number,
    change: Numbers,
) -> None:
    """Compute the daily change of frictions and zeros: how much a healthy machine differs from its present drift.

    For a zero it is its standard error between strokes. For a friction it is (1 + unknown u) times that, with u, from 0
    to 1, the standard error of its drift in units of that between strokes: 0 once the drift is known, 1 before.

    frictions:        F, number of the drifts that are frictions; the zeros follow
    unknown:          additional change of a friction whose drift is not known, in standard errors between strokes

    Read:
    drift_covariance: (D, D) of the drift of frictions [N, N s/m] and zeros [N]
    stroke_errors:    (D,) standard errors of the drift between strokes

    Written:
    change:           (D,) daily change, in the units of the drift
    """
    for i in range(s.d):
        change[i] = stroke_errors[i]
        if i < frictions:
            variance = stroke_errors[i] * stroke_errors[i]
            change[i] *= 1.0 + unknown * sqrt(min(drift_covariance[i * s.d + i] / variance, 1.0))


def gather_block(
    s: KernelSolver,
    rows: Numbers,
    usable: Numbers,
    drift: Numbers,
    drift_covariance: Numbers,
    stroke_errors: Numbers,
    frictions: Count,
    unknown: Number,
    error_torques: Numbers,
    signals: Count,
    memory: Number,
    residual: Numbers,
    change: Numbers,
    friction_drift: Numbers,
    gram: Numbers,
) -> Count:
    """Add the normal equations of one instant to those of a block of the plausibility tests (`gather`).

    Return the number of rows (measured torques) added, those that are usable and in motion. Of the drift only the
    frictions are subtracted from the residual torque: a pressure zero that drifts may be a fault of its sensor.

    frictions:        F, number of the drifts that are frictions; the zeros follow
    unknown:          additional change of a friction whose drift is not known (`daily_change`)
    signals:          H, number of signals whose errors are examined
    memory:           consecutive samples that count as one independent sample

    Read:
    rows:             (R, K) columns; then (R,) measured torques [N m]
    usable:           (R,) 1 where a row can be used, else 0
    drift:            (D,) changes of frictions [N, N s/m] and pressure zeros [N] since the identification
    drift_covariance: (D, D) of the drift
    stroke_errors:    (D,) standard errors of the drift between strokes
    error_torques:    (R, H) residual torque per unit of each signal's error [N m]

    Written, room for intermediate results:
    residual:         (3 + D, R) result of `weighed.residual_torque`
    change:           (D,) daily change of frictions and zeros, the unit of their coefficients (`daily_change`)
    friction_drift:   (D,) the drift with 0 for the zeros

    Read and written:
    gram:             (G, G), G = 4 + D + H + 1: sum of the products of [load | changes | errors | residual] of the rows
    """
    daily_change(s, drift_covariance, stroke_errors, frictions, unknown, change)
    for i in range(s.d):
        friction_drift[i] = drift[i] if i < frictions else 0.0
    residual_torque(s, rows, friction_drift, residual)
    return gather(s, rows, residual, usable, change, error_torques, signals, memory, gram)


def torque_per_error(
    p: KernelPlan,
    s: KernelSolver,
    rows: Numbers,
    channels: Numbers,
    load: Numbers,
    force_columns: Counts,
    forces: Count,
    per_bar: Numbers,
    joints: Counts,
    angles: Count,
    step: Number,
    values: Numbers,
    angle_torques: Numbers,
    torques: Numbers,
) -> None:
    """Compute the residual torque (R, H) that one unit of error of each of H signals causes.

    The H = `forces` + `angles` signals are cylinder forces, with a unit of one bar on the head side, then joint angles,
    with a unit of one radian. The sensitivity to an angle is the finite difference of lever and gravity.

    forces:        number of cylinders with a measured force
    angles:        number of joints with an angle sensor
    step:          error of an angle in the finite difference [rad]

    Read:
    rows:          (R, K) columns of the instant
    channels:      joint angles [rad], forces [N], pitch, roll [rad] and slew rate, at which the angles are varied
    load:          (4,) m, m x, m z, J in the bucket [kg, kg m, kg m, kg m^2]
    force_columns: (forces,) column of the torque by an error of each force [m]
    per_bar:       (forces,) force per bar on the head side [N/bar]
    joints:        (angles,) numbers of the joints

    Written, room for intermediate results:
    values:        (P,) identified parameters (tares) with the load added
    angle_torques: (R, angles) torque per error of an angle, without the scale [N m/rad]

    Written:
    torques:       (R, H) scale times the torque per error [N m/bar, N m/rad]
    """
    add_load(s, load, 0, values)
    angle_error_torques(p, channels, values, joints, angles, step, angle_torques)
    size = forces + angles
    for r in range(s.r):
        for i in range(forces):
            torques[r * size + i] = s.scale * (rows[r * s.k + force_columns[i]] * per_bar[i])
        for i in range(angles):
            torques[r * size + forces + i] = s.scale * angle_torques[r * angles + i]


def turn_force(
    p: KernelPlan,
    channels: Numbers,
    x: Number,
    z: Number,
    joints: Counts,
    angles: Count,
    first: Count,
    torques: Numbers,
) -> None:
    """Compute the change of the residual torque [N m] per radian by which an angle reads too large.

    A known force acts on the tool; its torque by the model is subtracted. The error turns all links beyond its
    joint, and with them the tool, about that joint. With (a, b) the place of the tool, forwards and upwards [m], from
    the farther one of joint j and the joint of the error, the torque of joint j changes by -(a x + b z) per radian.

    x, z:     force at the tool, forwards and upwards [N]
    angles:   number of angle errors
    first:    column of the first result

    Read:
    channels: joint angles [rad], then others; the last three are pitch, roll [rad] and slew rate
    joints:   (angles,) number of the joint whose angle is read too large

    Written:
    torques:  (R, first + angles), whose columns from `first` on get the torque per error [N m/rad]
    """
    angle = channels[p.d - 3]
    for j in range(p.n):
        angle += channels[j]
        cosine, sine = cos(angle), sin(angle)
        p.level[2 * j] = p.arm[2 * j] * cosine - p.arm[2 * j + 1] * sine
        p.level[2 * j + 1] = p.arm[2 * j] * sine + p.arm[2 * j + 1] * cosine
    for j in range(p.n - 2, -1, -1):  # `level` (N, 2): from each pin to the tool
        p.level[2 * j] += p.level[2 * j + 2]
        p.level[2 * j + 1] += p.level[2 * j + 3]
    for j in range(p.n):
        if p.row[j] >= 0:
            for a in range(angles):
                far = max(j, joints[a])
                torque = -(p.level[2 * far] * x + p.level[2 * far + 1] * z)
                torques[p.row[j] * (first + angles) + first + a] = torque


def mass_slopes(
    lift_gram: Numbers,
    block_gram: Numbers,
    size: Count,
    prior: Numbers,
    memory: Number,
    errors: Count,
    work: Numbers,
    slopes: Numbers,
) -> None:
    """Compute the change of the estimated mass of the load per unit of each signal's error: the first row of A^-1 B.

    A (4, 4) is the information on the load m, m x, m z, J, of the rows and of its prior. B (4, H) are the sums of the
    load's columns times the torques that the errors cause. Changes of friction and zeros are not estimated.

    size:       G, numbers of an equation (`gather`): load (4), changes of friction and zeros (D), errors of signals
                (H), residual (1)
    memory:     consecutive samples that count as one independent sample
    errors:     H, number of errors; they precede the last number of an equation

    Read:
    lift_gram:  (G, G) sum of the equations' products over the ended blocks of a lift
    block_gram: (G, G) sum over the running block
    prior:      (4,) diagonal of the prior information (inverse variances) on the load (m, m x, m z, J)

    Written:
    work:       (32,) room for A, of which the lower triangle is computed, and A^-1
    slopes:     (H,) change of the mass [kg] per unit of each error [bar over the head area, rad]; positive where a
                positive error makes the mass read too large
    """
    inverse = OF_LOAD * OF_LOAD
    for i in range(OF_LOAD):
        for j in range(i + 1):
            work[OF_LOAD * i + j] = (lift_gram[i * size + j] + block_gram[i * size + j]) / memory
        work[OF_LOAD * i + i] += prior[i]
    invert(work, OF_LOAD, work, inverse)
    first = size - 1 - errors
    for h in range(errors):
        total = 0.0
        for i in range(OF_LOAD):
            at = i * size + first + h
            total += work[inverse + i] * ((lift_gram[at] + block_gram[at]) / memory)
        slopes[h] = total


def rocking_variance(
    p: KernelPlan,
    s: KernelSolver,
    rows: Numbers,
    residual: Numbers,
    lift: Numbers,
    channels: Numbers,
    learning: Count,
    tilt_variance: Number,
    share: Number,
    largest_misfit: Number,
    prior: Number,
    unexplained: Numbers,
    values: Numbers,
    levers: Numbers,
    variances: Numbers,
    base_variance: Numbers,
) -> None:
    """Compute the variance that a rocking or braking base adds to each row (measured torque), and estimate its motion.

    The first pin's accelerations forwards and upwards are unknown; each has a variance. If `learning`, an estimate of
    an acceleration is made from the torque that the load of a lift does not explain, and its variance moves by a
    `share` towards the square of the estimate, less the estimate's own variance.

    learning:       1 where the variances are updated, else 0
    tilt_variance:  least variance of either acceleration, which the tilt shows [m^2/s^4]
    share:          by which a variance moves towards its new value
    largest_misfit: mean squared normalised torque above which the instant is contact or a dump and is not learned from
    prior:          information on an acceleration [s^4/m^2]

    Read:
    rows:           (R, K) columns; then (R,) measured torques [N m]
    residual:       of the instant: (R,) torque [N m], (R,) variance, (R,) variance of friction at rest [N^2 m^2]
    lift:           state of the lift (`LiftLayout`), of which the load is used
    channels:       joint angles [rad], then others; the last three are pitch, roll [rad] and slew rate

    Written, room for intermediate results:
    unexplained:    (R,) residual torque less that of the load [N m]
    values:         (P,) identified parameters (tares) with the load added
    levers:         (R, 2) torque per acceleration forwards and upwards [kg m]

    Read and written:
    variances:      (2,) of the accelerations forwards and upwards [m^2/s^4]

    Written:
    base_variance:  (R,) variance added to each row [N^2 m^2]
    """
    unexplained_torque(s, rows, residual, lift, unexplained, values)
    pin_levers(p, channels, values, levers)
    if learning:
        accelerate(s, residual, tilt_variance, share, largest_misfit, prior, unexplained, levers, variances)
    forward, upward = max(variances[0], tilt_variance), max(variances[1], tilt_variance)
    for r in range(s.r):
        a, b = levers[2 * r], levers[2 * r + 1]
        base_variance[r] = a * a * forward + b * b * upward


@inner
def pin_levers(p: KernelPlan, channels: Numbers, values: Numbers, levers: Numbers) -> None:
    """Compute the torque of each row per unit of the first pin's acceleration.

    It is -Im (forwards) and Re (upwards) of the first moment about each joint, the sum over the links beyond of
    (X + i Z) exp(i q).

    Read:
    channels: joint angles [rad], then others; the last three are pitch, roll [rad] and slew rate
    values:   (P,) parameters, which begin with J, X, Z [kg m^2, kg m, kg m] of each link

    Written:
    levers:   (R, 2) torque per acceleration forwards and upwards [N m per m/s^2]
    """
    angle = channels[p.d - 3]
    for j in range(p.n):  # `level` (N, 2): first moment of each link, in true axes
        angle += channels[j]
        x, z, cosine, sine = values[3 * j + 1], values[3 * j + 2], cos(angle), sin(angle)
        p.level[2 * j], p.level[2 * j + 1] = x * cosine - z * sine, x * sine + z * cosine
    across, along = 0.0, 0.0
    for j in range(p.n - 1, -1, -1):
        along, across = along + p.level[2 * j], across + p.level[2 * j + 1]
        if p.row[j] >= 0:
            levers[2 * p.row[j]], levers[2 * p.row[j] + 1] = -across, along


@inner
def accelerate(
    s: KernelSolver,
    residual: Numbers,
    tilt_variance: Number,
    share: Number,
    largest_misfit: Number,
    prior: Number,
    unexplained: Numbers,
    levers: Numbers,
    variances: Numbers,
) -> None:
    """Update the variances of the base's accelerations, forwards and upwards at the first pin, with one instant.

    The accelerations (a, b) that best explain the torque are the weighted least squares of two unknowns, with a prior
    at zero. Each variance moves by a `share` towards the square of its acceleration, less the variance of this
    estimate, and is at least 0.

    tilt_variance:  least variance of either acceleration [m^2/s^4]
    share:          by which a variance moves towards its new value
    largest_misfit: mean squared normalised torque above which nothing changes
    prior:          information on an acceleration [s^4/m^2]

    Read:
    residual:       of the instant, of which (R,) variance and (R,) variance of friction at rest [N^2 m^2] are used
    unexplained:    (R,) residual torque less that of the load [N m]
    levers:         (R, 2) torque per acceleration forwards and upwards [kg m]

    Read and written:
    variances:      (2,) of the accelerations forwards and upwards [m^2/s^4]
    """
    misfit, aa, ab, bb, a_torque, b_torque = 0.0, prior, 0.0, prior, 0.0, 0.0  # normal equations
    for r in range(s.r):
        torque, a, b = unexplained[r], levers[2 * r], levers[2 * r + 1]
        v = residual[s.r + r] + residual[2 * s.r + r] + tilt_variance * (a * a + b * b)
        misfit += torque * torque / v
        aa, ab, bb = aa + a * a / v, ab + a * b / v, bb + b * b / v
        a_torque, b_torque = a_torque + a * torque / v, b_torque + b * torque / v
    if misfit > largest_misfit * s.r:
        return
    determinant = aa * bb - ab * ab
    forward, upward = (bb * a_torque - ab * b_torque) / determinant, (aa * b_torque - ab * a_torque) / determinant
    forward, upward = forward * forward - bb / determinant, upward * upward - aa / determinant
    variances[0] = max(variances[0] + share * (forward - variances[0]), 0.0)
    variances[1] = max(variances[1] + share * (upward - variances[1]), 0.0)
