"""Evidence of a block of motion, in plain numbers: whether this is the machine (`service.recognition`), and the errors
of each signal (`service.plausibility.blocks` and `undetected`). Also the motion of a rocking base
(`service.contact.rocking`)."""

from math import cos, sin, sqrt

from cylforce.estimation.kernel.plan import KernelPlan
from cylforce.estimation.kernel.pushed import own_columns
from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, inner
from cylforce.estimation.kernel.rows import slips
from cylforce.estimation.kernel.solver import KernelSolver, invert
from cylforce.estimation.kernel.weighed import add, explain, loaded, quadratic, together, without_load

OF_LOAD: Count = 4  # parameters of a load


def gather(
    s: KernelSolver,
    rows: Numbers,
    residual: Numbers,
    usable: Numbers,
    change: Numbers,
    errors: Numbers,
    number: Count,
    memory: Number,
    gram: Numbers,
) -> Count:
    """Update the gram (K, K) with the rows of one instant that are usable and in motion, and return their number.

    A row is [load | changes in units of `change` | `errors` | residual], in units of its standard error, over `memory`.

    rows, residual: as of `weighed.explain`
    usable:         (R,) rows that can be used
    change:         (D,) units of the drift
    errors:         (R, H) torque by a unit of each error
    number:         H
    memory:         samples that count as one
    """
    informative = 0
    for r in range(s.r):
        informative += usable[r] != 0.0 and residual[2 * s.r + r] < residual[s.r + r]
    if informative == 0:
        return 0
    size = 5 + s.d + number
    own_columns(s, rows, 0)
    loaded(s, s.own, s.p, s.spread)
    for r in range(s.r):
        variance, rest = residual[s.r + r], residual[2 * s.r + r]
        if usable[r] != 0.0 and rest < variance:
            x = s.other
            by_tares = quadratic(s, s.covariance, 0, s.p, s.own, r * s.p)
            weight = 1.0 / sqrt((variance + rest + by_tares) * memory)
            for i in range(4):
                x[i] = s.spread[4 * r + i] * weight
            for i in range(s.d):
                x[4 + i] = rows[r * s.k + s.changing[i]] * change[i] * weight
            for h in range(number):
                x[4 + s.d + h] = errors[r * number + h] * weight
            x[size - 1] = residual[r] * weight
            for i in range(size):
                if x[i] != 0.0:
                    add(gram, i * size, x[i], x, 0, size)
    return informative


def daily_change(
    s: KernelSolver, drift_covariance: Numbers, before: Numbers, frictions: Count, unknown: Number, change: Numbers
) -> None:
    """Compute the standard error `change` (D,) of a change of friction and zeros from one day to another.

    It is `before` (D,). Each of the `frictions` is (1 + `unknown`) times as large while its drift, of covariance
    `drift_covariance` (D, D), is as uncertain as that."""
    for i in range(s.d):
        change[i] = before[i]
        if i < frictions:
            change[i] *= 1.0 + unknown * sqrt(min(drift_covariance[i * s.d + i] / (before[i] * before[i]), 1.0))


def gather_block(
    s: KernelSolver,
    rows: Numbers,
    usable: Numbers,
    drift: Numbers,
    drift_covariance: Numbers,
    before: Numbers,
    frictions: Count,
    unknown: Number,
    errors: Numbers,
    number: Count,
    memory: Number,
    residual: Numbers,
    change: Numbers,
    expected: Numbers,
    gram: Numbers,
) -> Count:
    """Gather an instant of a block of the plausibility, with `change` from `daily_change`, see `gather`.

    drift:                      (D,) of which so many `frictions` are used, no zeros
    drift_covariance:           (D, D) covariance of the drift
    residual, change, expected: (3 + D, R), (D,), (D,) room for results
    """
    daily_change(s, drift_covariance, before, frictions, unknown, change)
    for i in range(s.d):
        expected[i] = drift[i] if i < frictions else 0.0
    explain(s, rows, expected, residual)
    return gather(s, rows, residual, usable, change, errors, number, memory, gram)


def error_torques(
    p: KernelPlan,
    s: KernelSolver,
    rows: Numbers,
    channels: Numbers,
    load: Numbers,
    pressed: Counts,
    presses: Count,
    per_bar: Numbers,
    turned: Counts,
    turns: Count,
    by: Number,
    values: Numbers,
    angles: Numbers,
    out: Numbers,
) -> None:
    """Compute `out` (R, presses + turns), the torque by a unit of each error.

    rows:           of a step (`rows.rows_size`)
    channels:       (D,) at which the errors of angles are computed
    load:           (4,) in the bucket
    pressed:        columns of the forces' errors
    per_bar:        force of each [N]
    turned:         joints of the angles' errors (`rows.slips`)
    by:             error of an angle by which they are computed [rad]
    values, angles: (P,) and (R, turns) room for results
    """
    together(s, load, 0, values)
    slips(p, channels, values, turned, turns, by, angles)
    size = presses + turns
    for r in range(s.r):
        for i in range(presses):
            out[r * size + i] = s.scale * (rows[r * s.k + pressed[i]] * per_bar[i])
        for i in range(turns):
            out[r * size + presses + i] = s.scale * angles[r * turns + i]


def turn_force(
    p: KernelPlan, channels: Numbers, x: Number, z: Number, turned: Counts, angles: Count, begin: Count, out: Numbers
) -> None:
    """Compute the torque by which an angle error of one radian changes the effect of a force x, z [N] at the tool.

    The force is turned about the farther one of the row's joint and the joint of the error.

    channels: (D,) at which it is computed
    turned:   (angles,) joints whose angle is read too large
    begin:    first column of the results in `out` (R, begin + angles)
    """
    angle = channels[p.d - 3]
    for j in range(p.n):
        angle += channels[j]
        t, u = cos(angle), sin(angle)
        p.level[2 * j] = p.arm[2 * j] * t - p.arm[2 * j + 1] * u
        p.level[2 * j + 1] = p.arm[2 * j] * u + p.arm[2 * j + 1] * t
    for j in range(p.n - 2, -1, -1):
        p.level[2 * j] += p.level[2 * j + 2]
        p.level[2 * j + 1] += p.level[2 * j + 3]
    for j in range(p.n):
        if p.row[j] >= 0:
            for a in range(angles):
                far = max(j, turned[a])
                out[p.row[j] * (begin + angles) + begin + a] = -(p.level[2 * far] * x + p.level[2 * far + 1] * z)


def mass_slopes(
    lift: Numbers,
    running: Numbers,
    size: Count,
    prior: Numbers,
    memory: Number,
    errors: Count,
    work: Numbers,
    slopes: Numbers,
) -> None:
    """Compute `slopes` (errors,), the change of the load's mass per unit of each error.

    lift, running: (size, size) rows of a lift and of the running block; the errors precede their last column
    prior:         (4,) information on the load
    memory:        samples that count as one
    work:          32 numbers, room for results
    """
    inverse = OF_LOAD * OF_LOAD
    for i in range(OF_LOAD):
        for j in range(i + 1):
            work[OF_LOAD * i + j] = (lift[i * size + j] + running[i * size + j]) / memory
        work[OF_LOAD * i + i] += prior[i]
    invert(work, OF_LOAD, work, inverse)
    first = size - 1 - errors
    for h in range(errors):
        total = 0.0
        for i in range(OF_LOAD):
            at = i * size + first + h
            total += work[inverse + i] * ((lift[at] + running[at]) / memory)
        slopes[h] = total


def rock(
    p: KernelPlan,
    s: KernelSolver,
    rows: Numbers,
    residual: Numbers,
    lift: Numbers,
    channels: Numbers,
    learns: Count,
    swings: Number,
    share: Number,
    fits: Number,
    prior: Number,
    over: Numbers,
    values: Numbers,
    levers: Numbers,
    state: Numbers,
    wider: Numbers,
) -> None:
    """Update the variances of the first pin's acceleration, and compute the variance that they add to each row.

    If `learns`, the `state` moves by a `share` towards the square of an acceleration, less its own variance. It is the
    acceleration that best explains the torque which the load of a lift does not explain. Contact or a dump exceeds
    `fits` mean squares by the variance without this one. Such an instant is not used: it would otherwise excuse more
    and more.

    rows, residual, lift: of `weighed.gate`
    channels:             (D,)
    swings:               variance of either acceleration that the tilt shows [m^2/s^4]
    prior:                information on an acceleration [s^4/m^2]
    state:                (2,) variances forwards and upwards [m^2/s^4]
    wider:                (R,) added to the variance of each row
    over, values, levers: (R,), (P,), (R, 2) room for results
    """
    without_load(s, rows, residual, lift, over, values)
    pin_levers(p, channels, values, levers)
    if learns:
        accelerate(s, residual, swings, share, fits, prior, over, levers, state)
    forward, upward = max(state[0], swings), max(state[1], swings)
    for r in range(s.r):
        a, b = levers[2 * r], levers[2 * r + 1]
        wider[r] = a * a * forward + b * b * upward


@inner
def pin_levers(p: KernelPlan, channels: Numbers, values: Numbers, levers: Numbers) -> None:
    """Compute the torque (R, 2) [N m] per unit of the first pin's acceleration forwards and upwards [m/s^2].

    It is -Im and Re of the first moment about each joint, of the parameters `values` (P,): the sum over the links
    beyond of (X + i Z) exp(i q)."""
    angle = channels[p.d - 3]
    for j in range(p.n):
        angle += channels[j]
        x, z, t, u = values[3 * j + 1], values[3 * j + 2], cos(angle), sin(angle)
        p.level[2 * j], p.level[2 * j + 1] = x * t - z * u, x * u + z * t
    across, along = 0.0, 0.0
    for j in range(p.n - 1, -1, -1):
        along, across = along + p.level[2 * j], across + p.level[2 * j + 1]
        if p.row[j] >= 0:
            levers[2 * p.row[j]], levers[2 * p.row[j] + 1] = -across, along


@inner
def accelerate(
    s: KernelSolver,
    residual: Numbers,
    swings: Number,
    share: Number,
    fits: Number,
    prior: Number,
    over: Numbers,
    levers: Numbers,
    state: Numbers,
) -> None:
    """Update the `state` with the acceleration that best explains the torque `over` (R,) that the load does not."""
    misfit, aa, ab, bb, a_over, b_over = 0.0, prior, 0.0, prior, 0.0, 0.0
    for r in range(s.r):
        x, a, b = over[r], levers[2 * r], levers[2 * r + 1]
        v = residual[s.r + r] + residual[2 * s.r + r] + swings * (a * a + b * b)
        misfit += x * x / v
        aa, ab, bb = aa + a * a / v, ab + a * b / v, bb + b * b / v
        a_over, b_over = a_over + a * x / v, b_over + b * x / v
    if misfit > fits * s.r:
        return
    size = aa * bb - ab * ab
    forward, upward = (bb * a_over - ab * b_over) / size, (aa * b_over - ab * a_over) / size
    forward, upward = forward * forward - bb / size, upward * upward - aa / size
    state[0] = max(state[0] + share * (forward - state[0]), 0.0)
    state[1] = max(state[1] + share * (upward - state[1]), 0.0)
