"""Force at the tool at one instant, and its errors: `service.contact.noise` and `service.force` in plain numbers.

Sizes: R rows (measured torques), K columns of all effects, P tares, D drifting frictions and pressure zeros, C
cylinders, T unknowns at the tool: force x, z and moment (3), or the force alone (2). A load is (m, m x, m z, J): mass
[kg], first moments [kg m] and inertia [kg m^2] about the last pin.

Two arrays occur in many functions. The first functions below give the places of their parts.
force: residual torque (R,), variance of friction of unknown sign (R,), force (2,), its covariance (2, 2), gain (2, R),
       columns of the load (R, 4), weight and clearness, covariance by errors of signals (3,) (`layout.ForceLayout`)
noise: errors of the torques: covariance of the delayed torque of inertia (R, R) [N^2 m^2]; reversing (C,), 1 where a
       cylinder reverses, then fading; learned variance (R,) [N^2 m^2]"""

from math import atan2, sqrt

from cylforce.estimation.kernel.restricted import Count, Number, Numbers, inner
from cylforce.estimation.kernel.solver import KernelSolver, backward, factor, forward, invert
from cylforce.estimation.kernel.weighed import columns_of_load, quadratic

# Places in a published force.
SHOWN_X: Count = 0
SHOWN_Z: Count = 1
SHOWN_SIZE: Count = 2
SHOWN_DIRECTION: Count = 3
SHOWN_X_ERROR: Count = 4
SHOWN_Z_ERROR: Count = 5
SHOWN_SIZE_ERROR: Count = 6
SHOWN_DIRECTION_ERROR: Count = 7
SHOWN_XX: Count = 8
SHOWN_XZ: Count = 9
SHOWN_ZZ: Count = 10
SHOWN_CERTAIN: Count = 11
SHOWN_LARGEST_ERROR: Count = 12
SHOWN_LARGEST: Count = 13


@inner
def friction_at(s: KernelSolver) -> Count:
    """Return the place in `force` of the variance (R,) of friction of unknown sign [N^2 m^2]."""
    return s.r


@inner
def force_at(s: KernelSolver) -> Count:
    """Return the place in `force` of the force x, z [N]."""
    return 2 * s.r


@inner
def covariance_at(s: KernelSolver) -> Count:
    """Return the place in `force` of the force's covariance (2, 2) [N^2]: xx, xz, zx, zz."""
    return 2 * s.r + 2


@inner
def gain_at(s: KernelSolver) -> Count:
    """Return the place in `force` of the gain (2, R), the force x, z per torque of each row [1/m]."""
    return 2 * s.r + 6


@inner
def load_columns_at(s: KernelSolver) -> Count:
    """Return the place in `force` of the columns (R, 4) of a load."""
    return 4 * s.r + 6


@inner
def weight_at(s: KernelSolver) -> Count:
    """Return the place in `force` of the weight [N] that explains most of the force; its clearness follows."""
    return 8 * s.r + 6


@inner
def signals_at(s: KernelSolver) -> Count:
    """Return the place in `force` of xx, xz, zz [N^2], the covariance by errors of signals."""
    return 8 * s.r + 8


@inner
def reversing_at(s: KernelSolver) -> Count:
    """Return the place in `noise` of reversing (C,): 1 where a cylinder reverses, then fading."""
    return s.r * s.r


@inner
def learned_at(s: KernelSolver) -> Count:
    """Return the place in `noise` of the learned variance (R,) [N^2 m^2]."""
    return s.r * s.r + s.c


def tool_force(
    s: KernelSolver,
    rows: Numbers,
    usable: Numbers,
    load: Numbers,
    drift: Numbers,
    signal_torques: Numbers,
    signals: Count,
    noise_before: Numbers,
    noise: Numbers,
    force: Numbers,
) -> None:
    """Compute the force at the tool at one instant from the residual torques, with its covariance.

    It is the force of the outside world on the tool: x horizontally forwards, z upwards. It contains the weight of a
    load in the bucket, which acts along -z; `load` is not subtracted. `load` only gives its share of the delayed torque
    of inertia.

    The covariance contains errors of the tares (identified parameters), of the delayed torque of inertia, of dry
    friction while a cylinder reverses, the learned variance, and errors of signals. While cylinders reverse, their
    friction may have either sign: the amplitudes of all cylinders add up, the worst case.

    signals:        H, number of signals with a probable error

    Read:
    rows:           of a step (`layout.RowLayout`), of which the columns and torques of the instant, the rate of change
                    of the columns, the reversing cylinders and their levers are used
    usable:         (R,) 1 where a row can be used, else 0
    load:           (4,) m, m x, m z, J in the bucket [kg, kg m, kg m, kg m^2]
    drift:          (D,) changes of frictions [N, N s/m] and pressure zeros [N]
    signal_torques: (R, H) torque by the probable error of each signal [N m]
    noise_before:   errors of the torques before this instant: covariance of the delayed torque of inertia (R, R)
                    [N^2 m^2]; reversing (C,), 1 to 0; learned variance (R,) [N^2 m^2]

    Written:
    noise:          the same errors after this instant
    force:          (`layout.ForceLayout`) residual torque (R,) [N m]; variance of friction of unknown sign (R,)
                    [N^2 m^2]; force x, z [N]; its covariance (2, 2) [N^2]; force per torque of each row (2, R) [1/m];
                    columns of the load (R, 4); weight of the mass in the bucket that explains most of the force [N],
                    0 or positive, acting along -z, and f' C^-1 f of the force f without it (x, z + weight); xx, xz, zz
                    by errors of signals [N^2], which must be zero before
    """
    # places in `rows`: columns of the instant (R, K), then torques (R,); then change (R, K)
    columns, change = s.r * s.k + s.r, 2 * (s.r * s.k + s.r)
    reversing = change + s.r * s.k
    levers = reversing + s.c
    copy_tare_columns(s, rows, columns)
    subtract_tares(s, rows, columns, drift, force)
    load_columns = s.work
    columns_of_load(s, s.tare_columns, s.p, load_columns)
    for i in range(4 * s.r):
        force[load_columns_at(s) + i] = load_columns[i]
    delay_inertia(s, rows, change, load, noise_before, noise)
    for c in range(s.c):
        fading = s.keep * noise_before[reversing_at(s) + c]
        noise[reversing_at(s) + c] = max(rows[reversing + c], fading)
    for r in range(s.r):
        noise[learned_at(s) + r] = noise_before[learned_at(s) + r]
        amplitude = 0.0  # of dry friction [N m]
        for c in range(s.dry_size):
            amplitude += noise[reversing_at(s) + c] * s.dry[c] * abs(rows[levers + c * s.r + r])
        force[friction_at(s) + r] = amplitude * amplitude
    torque_covariance(s, force, noise)
    solve_force(s, rows, columns, usable, force)
    explain_by_weight(s, force)
    add_signal_errors(s, signal_torques, signals, force)


@inner
def explain_by_weight(s: KernelSolver, force: Numbers) -> None:
    """Compute the weight of the mass in the bucket that explains most of a force, and the clearness of the rest.

    The weight w, downwards, is that between 0 and `s.heaviest` [N] that minimises (f + w z)' C^-1 (f + w z), with z
    upwards and C the covariance of the force f. The clearness of a contact is that minimum: the squared distance from
    zero, in standard errors, of the force without the weight.

    Read and written:
    force: (`layout.ForceLayout`) force x, z [N] and its covariance (2, 2) [N^2] are read; weight [N] and clearness are
           written
    """
    x, z, xx = force[force_at(s)], force[force_at(s) + 1], force[covariance_at(s)]
    xz, zz = force[covariance_at(s) + 1], force[covariance_at(s) + 3]
    weight = min(max((xz * x - xx * z) / xx, 0.0), s.heaviest)
    z += weight
    force[weight_at(s)] = weight
    force[weight_at(s) + 1] = (zz * x * x - 2.0 * xz * x * z + xx * z * z) / (xx * zz - xz * xz)


@inner
def add_signal_errors(s: KernelSolver, signal_torques: Numbers, signals: Count, force: Numbers) -> None:
    """Add to the covariance by errors of signals: the sum over the signals of e e', with e = gain @ torque.

    signals:        H, number of signals

    Read:
    signal_torques: (R, H) torque by the probable error of each signal [N m]

    Read and written:
    force:          (`layout.ForceLayout`) the gain (2, R) is read; xx, xz, zz by errors of signals [N^2] are increased
    """
    gain, covariance = gain_at(s), signals_at(s)
    for h in range(signals):
        x, z = 0.0, 0.0
        for r in range(s.r):
            x += force[gain + r] * signal_torques[r * signals + h]
            z += force[gain + s.r + r] * signal_torques[r * signals + h]
        force[covariance] += x * x
        force[covariance + 1] += x * z
        force[covariance + 2] += z * z


@inner
def subtract_tares(s: KernelSolver, rows: Numbers, columns: Count, drift: Numbers, force: Numbers) -> None:
    """Compute the residual torque of the instant: scale (torque - W tares - W_D drift).

    W tares is the torque of the empty machine with its identified parameters, W_D drift that of their changes since.

    columns: place in `rows` of the columns of the instant

    Read:
    rows:    contains from `columns` on the columns (R, K), then the measured torques (R,) [N m]
    drift:   (D,) changes of frictions [N, N s/m] and pressure zeros [N]
    `s.tare_columns`, `s.nonzero` and `s.nonzeros` of the instant (`copy_tare_columns`)

    Written:
    force:   the residual torque (R,) [N m], its first part
    """
    tares, values, nonzero, torques = s.tare_columns, s.values, s.nonzero, columns + s.r * s.k
    for r in range(s.r):
        row, torque = r * s.p, rows[torques + r]
        for m in range(s.nonzeros[r]):
            torque -= tares[row + nonzero[row + m]] * values[nonzero[row + m]]
        for i in range(s.d):
            torque -= rows[columns + r * s.k + s.changing[i]] * drift[i]
        force[r] = s.scale * torque


@inner
def copy_tare_columns(s: KernelSolver, rows: Numbers, columns: Count) -> None:
    """Copy the columns of the tares (identified parameters), and list those that are not zero, to save time.

    columns: place in `rows` of the columns

    Read:
    rows:    contains the columns (R, K) from `columns` on, of which the first P are those of the tares

    Written:
    `s.tare_columns` (R, P)
    `s.nonzero` (R, P): numbers of the columns of each row that are not zero, in ascending order
    `s.nonzeros` (R,): how many each row has
    """
    tares, nonzero = s.tare_columns, s.nonzero
    for r in range(s.r):
        row, number = r * s.p, 0
        for i in range(s.p):
            x = rows[columns + r * s.k + i]
            tares[row + i] = x
            if x != 0.0:
                nonzero[row + number] = i
                number += 1
        s.nonzeros[r] = number


@inner
def delay_inertia(
    s: KernelSolver, rows: Numbers, change: Count, load: Numbers, noise_before: Numbers, noise: Numbers
) -> None:
    """Update the covariance of the error by the delay of the torque of inertia.

    The error is the change of this torque within the delay: e = delay_s d/dt (W parameters) of machine and load. Its
    covariance fades: E <- keep E + (1 - keep) e e'.

    change:       place in `rows` of the rates of change of the columns

    Read:
    rows:         contains from `change` on the rates of change (R, K) of the columns of inertia [1/s]
    load:         (4,) m, m x, m z, J in the bucket [kg, kg m, kg m, kg m^2]
    noise_before: begins with the covariance E (R, R) before this instant [N^2 m^2]

    Written:
    noise:        begins with E after this instant
    """
    late, values = s.short_work, s.values  # late: the error e (R,) [N m]
    for r in range(s.r):
        row, total = change + r * s.k, 0.0
        for i in range(s.p):
            total += rows[row + i] * values[i]
        for i in range(s.loads):
            tare, component = s.load_at[2 * i], s.load_at[2 * i + 1]
            total += rows[row + tare] * s.load[i] * load[component]
        late[r] = s.delay_s * total
    for r in range(s.r):
        for q in range(s.r):
            noise[r * s.r + q] = s.keep * noise_before[r * s.r + q] + (1.0 - s.keep) * (late[r] * late[q])


@inner
def torque_covariance(s: KernelSolver, force: Numbers, noise: Numbers) -> None:
    """Compute the covariance of the residual torque: errors of the tares, of the model and of the instant.

    Read:
    force: (`layout.ForceLayout`) residual torque (R,) [N m], variance of friction of unknown sign (R,) [N^2 m^2]
    noise: covariance of the delayed torque of inertia (R, R), reversing (C,), learned variance (R,) [N^2 m^2]
    `s.tare_columns` (R, P), torques per unit of each of P tares (identified parameters), with covariance `s.covariance`

    Written: the lower triangle (R, R) of `s.matrix` [N^2 m^2]
    """
    for q in range(s.r):
        of_model = s.relative * force[q]
        total = quadratic(s, s.covariance, 0, s.p, s.tare_columns, q * s.p) + of_model * of_model
        total += force[friction_at(s) + q]
        s.matrix[q * s.r + q] = total + noise[learned_at(s) + q] + noise[q * s.r + q]
        for r in range(q + 1, s.r):
            s.matrix[r * s.r + q] = noise[r * s.r + q] + tare_covariance(s, r, q)


@inner
def tare_covariance(s: KernelSolver, r: Count, q: Count) -> Number:
    """Return w_r' C w_q [N^2 m^2], the covariance of the torques of rows r and q by errors of the parameters (tares).

    Read: w_r and w_q in `s.tare_columns` (R, P), with their places `s.nonzero` that are not zero; C, `s.covariance`
    """
    tares, nonzero, covariance = s.tare_columns, s.nonzero, s.covariance
    one, two, total = r * s.p, q * s.p, 0.0
    for m in range(s.nonzeros[r]):
        row, product = nonzero[one + m] * s.p, 0.0
        for n in range(s.nonzeros[q]):
            j = nonzero[two + n]
            product += covariance[row + j] * tares[two + j]
        total += tares[one + nonzero[one + m]] * product
    return total


@inner
def solve_force(s: KernelSolver, rows: Numbers, columns: Count, usable: Numbers, force: Numbers) -> None:
    """Compute the force at the tool by weighted least squares with its prior, from the usable rows.

    With L L' the covariance of the torques and A (R, T) the columns of the tool, (A' (L L')^-1 A + prior)^-1 is the
    covariance of the T unknowns. The gain of a row that is not usable is 0.

    columns: place in `rows` of the columns of the instant

    Read:
    rows:    contains the columns (R, K) from `columns` on
    usable:  (R,) 1 where a row can be used, else 0

    Read and destroyed: `s.matrix`, covariance (R, R) of the torques

    Read and written:
    force:   (`layout.ForceLayout`) residual torque (R,) [N m] is read; force x, z [N], its covariance (2, 2) [N^2] and
             gain (2, R) [1/m] are written
    """
    t, tools, inverse_at = s.t, s.tare_columns, s.t * s.r  # `tools`: A' (T, R), then the covariance (T, T)
    factor(s.matrix, s.r, usable)
    for i in range(t):
        for r in range(s.r):
            tools[i * s.r + r] = rows[columns + r * s.k + s.tip + i]
        forward(s.matrix, s.r, usable, tools, i * s.r)
        for j in range(i + 1):
            total = s.prior[i * t + j]
            for r in range(s.r):
                total += tools[i * s.r + r] * tools[j * s.r + r]
            s.short_work[i * t + j] = total
    invert(s.short_work, t, tools, inverse_at)
    for i in range(t):
        backward(s.matrix, s.r, usable, tools, i * s.r)
    for i in range(2):
        for j in range(2):
            force[covariance_at(s) + 2 * i + j] = tools[inverse_at + i * t + j]
    apply_gain(s, tools, inverse_at, force)


@inner
def apply_gain(s: KernelSolver, tools: Numbers, inverse_at: Count, force: Numbers) -> None:
    """Compute the force per torque of each row, and with it the force.

    Read:
    tools: (T, R) columns of the tool times the inverse covariance of the torques; from `inverse_at` on the covariance
           (T, T) of the unknowns

    Read and written:
    force: (`layout.ForceLayout`) residual torque (R,) [N m] is read; gain (2, R) [1/m] and force x, z [N] are written
    """
    for i in range(2):
        total = 0.0
        for r in range(s.r):
            gain = 0.0
            for j in range(s.t):
                gain += tools[inverse_at + i * s.t + j] * tools[j * s.r + r]
            force[gain_at(s) + i * s.r + r] = gain
            total += gain * force[r]
        force[force_at(s) + i] = total


@inner
def subtract_load(s: KernelSolver, force: Numbers, load: Numbers, load_covariance: Numbers, soil: Numbers) -> None:
    """Compute the force of the ground: the force at the tool less that of the load in the bucket.

    Read:
    force:           (`layout.ForceLayout`) force x, z [N], its covariance (2, 2), gain (2, R), columns of the load
                     (R, 4)
    load:            (4,) m, m x, m z, J [kg, kg m, kg m, kg m^2]
    load_covariance: (4, 4) of the load

    Written:
    soil:            (6,) force x, z [N] and its covariance xx, xz, zx, zz [N^2]
    """
    per_load = s.work  # (2, 4) force per unit of the load
    for i in range(2):
        soil[i] = force[force_at(s) + i]
        for j in range(4):
            total = 0.0
            for r in range(s.r):
                total += force[gain_at(s) + i * s.r + r] * force[load_columns_at(s) + 4 * r + j]
            per_load[4 * i + j] = total
            soil[i] -= total * load[j]
    for i in range(2):
        for j in range(2):
            total = force[covariance_at(s) + 2 * i + j]
            for k in range(4):
                for q in range(4):
                    total += per_load[4 * i + k] * load_covariance[4 * k + q] * per_load[4 * j + q]
            soil[2 + 2 * i + j] = total


def published_forces(
    s: KernelSolver,
    force: Numbers,
    load: Numbers,
    load_covariance: Numbers,
    load_known: Count,
    clear: Number,
    resultant: Numbers,
    ground: Numbers,
) -> None:
    """Compute the two published forces: the resultant at the tool, and the force of the ground.

    The force of the ground is the resultant less that of the load. Where the load is not known, it is the resultant
    less the weight of the mass that explains most of it.

    load_known:        1 where the load is known, else 0
    clear:             ratio of a force's size to its standard error across, above which its direction is certain

    Read:
    force:             result of `tool_force` (`layout.ForceLayout`)
    load:              (4,) m, m x, m z, J in the bucket [kg, kg m, kg m, kg m^2]
    load_covariance:   (4, 4) of the load

    Written:
    resultant, ground: (14,) each, see `publish`: components, size and direction, their standard errors, covariance
    """
    x, z, covariance, by_signals = force[force_at(s)], force[force_at(s) + 1], covariance_at(s), signals_at(s)
    xx = force[covariance] + force[by_signals]
    xz = force[covariance + 1] + force[by_signals + 1]
    zz = force[covariance + 3] + force[by_signals + 2]
    publish(s, x, z, xx, xz, zz, clear, resultant)
    if load_known != 0:
        soil = s.short_work  # x, z, xx, xz, zx, zz
        subtract_load(s, force, load, load_covariance, soil)
        xx, xz = soil[2] + force[by_signals], soil[3] + force[by_signals + 1]
        zz = soil[5] + force[by_signals + 2]
        publish(s, soil[0], soil[1], xx, xz, zz, clear, ground)
    else:
        publish(s, x, z + force[weight_at(s)], xx, xz, zz, clear, ground)


@inner
def publish(
    s: KernelSolver, x: Number, z: Number, xx: Number, xz: Number, zz: Number, clear: Number, shown: Numbers
) -> None:
    """Compute a published force from its components, and add the error of the scale (`s.scale_error` times the force).

    The standard error of the size is that along the force; where the direction is not certain, that along and across.

    x, z:       force [N]
    xx, xz, zz: its covariance without that of the scale [N^2]
    clear:      ratio of a force's size to its standard error across, above which its direction is certain

    Written:
    shown:      (14,) x, z, size [N]; direction [rad]; standard errors of x, z and size [N]; standard error of the
                direction [rad]; covariance xx, xz, zz with that of the scale [N^2]; 1 where the direction is certain,
                else 0; largest of the three errors of x, z and size [N]; largest of these three values, the size [N]
    """
    scale = s.scale_error * s.scale_error
    xx, xz, zz = xx + scale * (x * x), xz + scale * (x * z), zz + scale * (z * z)
    size = sqrt(x * x + z * z)
    cosine, sine = (x / size, z / size) if size > 0.0 else (1.0, 0.0)
    along = abs(cosine * cosine * xx + 2.0 * cosine * sine * xz + sine * sine * zz)  # variance along the force
    across = abs(sine * sine * xx - 2.0 * cosine * sine * xz + cosine * cosine * zz)
    certain = 1.0 if size > clear * sqrt(across) else 0.0
    shown[SHOWN_X], shown[SHOWN_Z], shown[SHOWN_SIZE], shown[SHOWN_DIRECTION] = x, z, size, atan2(z, x)
    shown[SHOWN_X_ERROR], shown[SHOWN_Z_ERROR] = sqrt(xx), sqrt(zz)
    shown[SHOWN_SIZE_ERROR] = sqrt(along) if certain != 0.0 else sqrt(along + across)
    shown[SHOWN_DIRECTION_ERROR] = sqrt(across) / (size + 1e-9)  # 1e-9 N: no division by zero
    shown[SHOWN_XX], shown[SHOWN_XZ], shown[SHOWN_ZZ], shown[SHOWN_CERTAIN] = xx, xz, zz, certain
    shown[SHOWN_LARGEST_ERROR] = max(shown[SHOWN_X_ERROR], shown[SHOWN_Z_ERROR], shown[SHOWN_SIZE_ERROR])
    shown[SHOWN_LARGEST] = size


def learn_noise(s: KernelSolver, force: Numbers, good: Numbers, load: Numbers, noise: Numbers) -> None:
    """Update the learned variances of the rows after an instant in the air, where the load explains the whole torque.

    v <- v (1 + (e - 1) / learning), with e the squared residual over its variance, at most `s.largest`. The variance
    is at least that with which the identified machine was fitted (`s.row_error` squared).

    Read:
    force: result of `tool_force` (`layout.ForceLayout`): residual torque (R,), variance of friction (R,), columns of
           the load
    good:  (R,) 1 for the rows to learn from, else 0
    load:  (4,) m, m x, m z, J in the bucket [kg, kg m, kg m, kg m^2]

    Read and written:
    noise: covariance of the delayed torque of inertia (R, R) and reversing (C,) are read; the learned variance v (R,)
           [N^2 m^2] is updated
    """
    for r in range(s.r):
        residual = force[r]
        for i in range(4):
            residual -= force[load_columns_at(s) + 4 * r + i] * load[i]
        variance = noise[learned_at(s) + r]
        if good[r] != 0.0:
            expected = force[friction_at(s) + r] + noise[r * s.r + r] + variance
            variance *= 1.0 + (min(residual * residual / expected, s.largest) - 1.0) / s.learning
        noise[learned_at(s) + r] = max(variance, s.row_error[r] * s.row_error[r])


def widen_load(covariance: Numbers, full: Numbers, share: Number, result: Numbers) -> None:
    """Compute the covariance of a load in a bucket that may have gained a part of a full one: C + (share full)(share
    full)'.

    share:      of a full bucket that may have been gained

    Read:
    covariance: (4, 4) C of the load before
    full:       (4,) m, m x, m z, J of a full bucket [kg, kg m, kg m, kg m^2]

    Written:
    result:     (4, 4) covariance of the load after
    """
    for i in range(4):
        for j in range(4):
            result[4 * i + j] = covariance[4 * i + j] + share * full[i] * (share * full[j])
