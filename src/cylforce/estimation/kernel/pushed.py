"""Force at the tool at one instant, and its errors: `service.contact.noise` and `service.force` in plain numbers."""

from math import atan2, sqrt

from cylforce.estimation.kernel.restricted import Count, Number, Numbers, inner
from cylforce.estimation.kernel.solver import KernelSolver, backward, factor, forward, invert
from cylforce.estimation.kernel.weighed import loaded, quadratic


def push(
    s: KernelSolver,
    rows: Numbers,
    usable: Numbers,
    load: Numbers,
    drift: Numbers,
    wrong: Numbers,
    errors: Count,
    before: Numbers,
    new: Numbers,
    found: Numbers,
) -> None:
    """Compute the force at the tool at one instant, and the errors after it.

    rows:   of a step (`rows.rows_size`), of which those of the instant are used
    usable: (R,) rows that can be used
    load:   (4,) in the bucket
    drift:  (D,) values of the drift
    wrong:  (R, H) torques by errors of H signals, each by itself
    errors: H
    before: errors before this instant: inertia (R, R), reversing (C,), variance (R,)
    new:    the same errors after this instant
    found:  residual torque (R,), variance of friction of unknown sign (R,), force (2,), its covariance (2, 2), gain (2,
            R), columns of the load (R, 4), two numbers of `alone`, and xx, xz, zz that `wrong` adds to the covariance
    """
    gains, size = 2 * s.r + 6, s.r * s.k
    now, reversing = size + s.r, 3 * size + 2 * s.r
    lever = reversing + s.c
    own_columns(s, rows, now)
    instant_residual(s, rows, now, drift, found)
    loaded(s, s.own, s.p, s.other)
    for i in range(4 * s.r):
        found[gains + 2 * s.r + i] = s.other[i]
    late_inertia(s, rows, 2 * now, load, before, new)
    for c in range(s.c):
        new[s.r * s.r + c] = max(rows[reversing + c], s.keep * before[s.r * s.r + c])
    for r in range(s.r):
        new[s.r * s.r + s.c + r] = before[s.r * s.r + s.c + r]
        foreseen = 0.0
        for c in range(s.dry_size):
            foreseen += new[s.r * s.r + c] * s.dry[c] * abs(rows[lever + c * s.r + r])
        found[s.r + r] = foreseen * foreseen
    residual_covariance(s, found, new)
    solve(s, rows, now, usable, found)
    alone(s, found, 2 * s.r, 8 * s.r + 6)
    widen(s, wrong, errors, found, 8 * s.r + 8)


@inner
def alone(s: KernelSolver, found: Numbers, o: Count, to: Count) -> None:
    """Compute the weight [N] of the mass in the bucket that explains most of a force, and the misfit that it leaves.

    It is the w downwards of 0 to `heaviest` that minimises (f + w z)' C^-1 (f + w z); the misfit is that minimum.

    o:  place of the force (2,) and its covariance (2, 2)
    to: place of both results
    """
    x, z, xx, xz, zz = found[o], found[o + 1], found[o + 2], found[o + 3], found[o + 5]
    weight = min(max((xz * x - xx * z) / xx, 0.0), s.heaviest)
    z += weight
    found[to], found[to + 1] = weight, (zz * x * x - 2.0 * xz * x * z + xx * z * z) / (xx * zz - xz * xz)


@inner
def widen(s: KernelSolver, wrong: Numbers, errors: Count, found: Numbers, to: Count) -> None:
    """Add xx, xz and zz of the force's covariance by torques `wrong` (R, H)."""
    gains = 2 * s.r + 6
    for h in range(errors):
        x, z = 0.0, 0.0
        for r in range(s.r):
            x += found[gains + r] * wrong[r * errors + h]
            z += found[gains + s.r + r] * wrong[r * errors + h]
        found[to] += x * x
        found[to + 1] += x * z
        found[to + 2] += z * z


@inner
def instant_residual(s: KernelSolver, columns: Numbers, begin: Count, drift: Numbers, found: Numbers) -> None:
    """Compute the residual torque (R,) of tares and drift, from columns (R, K) and torques (R,) from `begin` on."""
    own, values, at, torque = s.own, s.values, s.at, begin + s.r * s.k
    for r in range(s.r):
        o, residual = r * s.p, columns[torque + r]
        for m in range(s.many[r]):
            residual -= own[o + at[o + m]] * values[at[o + m]]
        for i in range(s.d):
            residual -= columns[begin + r * s.k + s.changing[i]] * drift[i]
        found[r] = s.scale * residual


@inner
def own_columns(s: KernelSolver, columns: Numbers, begin: Count) -> None:
    """Copy the columns of the tares (R, P), from all columns (R, K) that begin at `begin`, to `own`.

    `at` (R, P) gets the places that are not zero, of which the first `many` (R,) count."""
    own, at, size = s.own, s.at, s.p
    for r in range(s.r):
        o, number = r * size, 0
        for i in range(size):
            x = columns[begin + r * s.k + i]
            own[o + i] = x
            if x != 0.0:
                at[o + number] = i
                number += 1
        s.many[r] = number


@inner
def late_inertia(s: KernelSolver, change: Numbers, begin: Count, load: Numbers, before: Numbers, new: Numbers) -> None:
    """Update the covariance (R, R) of the torque by which the inertia of machine and load lags."""
    late, values = s.spread, s.values
    for r in range(s.r):
        o, total = begin + r * s.k, 0.0
        for i in range(s.p):
            total += change[o + i] * values[i]
        for i in range(s.loads):
            total += change[o + s.load_at[2 * i]] * s.load[i] * load[s.load_at[2 * i + 1]]
        late[r] = s.late * total
    for r in range(s.r):
        for q in range(s.r):
            new[r * s.r + q] = s.keep * before[r * s.r + q] + (1.0 - s.keep) * (late[r] * late[q])


@inner
def residual_covariance(s: KernelSolver, found: Numbers, new: Numbers) -> None:
    """Compute the covariance (R, R) of the residual torque in `square`: errors of the instant and of the tares."""
    for q in range(s.r):
        each = s.relative * found[q]
        total = quadratic(s, s.covariance, 0, s.p, s.own, q * s.p) + each * each
        s.square[q * s.r + q] = total + found[s.r + q] + new[s.r * s.r + s.c + q] + new[q * s.r + q]
        for r in range(q + 1, s.r):
            s.square[r * s.r + q] = new[r * s.r + q] + common(s, r, q)


@inner
def common(s: KernelSolver, r: Count, q: Count) -> Number:
    """Return the covariance of the torques of two rows by errors of the tares."""
    own, at, covariance = s.own, s.at, s.covariance
    one, two, total = r * s.p, q * s.p, 0.0
    for m in range(s.many[r]):
        row, each = at[one + m] * s.p, 0.0
        for n in range(s.many[q]):
            j = at[two + n]
            each += covariance[row + j] * own[two + j]
        total += own[one + at[one + m]] * each
    return total


@inner
def solve(s: KernelSolver, columns: Numbers, begin: Count, usable: Numbers, found: Numbers) -> None:
    """Compute the force at the tool by weighted least squares with its prior, from the usable rows.

    L L' = `square`; rows L^-1 [tool | residual]; inverse of their normal matrix. `own` holds the rows and the inverse.
    """
    t, tools, o = s.t, s.own, s.t * s.r
    factor(s.square, s.r, usable)
    for i in range(t):
        for r in range(s.r):
            tools[i * s.r + r] = columns[begin + r * s.k + s.tip + i]
        forward(s.square, s.r, usable, tools, i * s.r)
        for j in range(i + 1):
            total = s.prior[i * t + j]
            for r in range(s.r):
                total += tools[i * s.r + r] * tools[j * s.r + r]
            s.spread[i * t + j] = total
    invert(s.spread, t, tools, o)
    for i in range(t):
        backward(s.square, s.r, usable, tools, i * s.r)
    for i in range(2):
        for j in range(2):
            found[2 * s.r + 2 + 2 * i + j] = tools[o + i * t + j]
    gain(s, tools, o, found)


@inner
def gain(s: KernelSolver, tools: Numbers, o: Count, found: Numbers) -> None:
    """Compute the force per unit of each row's torque, and the force."""
    for i in range(2):
        total = 0.0
        for r in range(s.r):
            each = 0.0
            for j in range(s.t):
                each += tools[o + i * s.t + j] * tools[j * s.r + r]
            found[2 * s.r + 6 + i * s.r + r] = each
            total += each * found[r]
        found[2 * s.r + i] = total


@inner
def soil(s: KernelSolver, found: Numbers, load: Numbers, covariance: Numbers, into: Numbers) -> None:
    """Compute the force without the load (4,), which has covariance (4, 4): `into` is that force (2,) and its
    covariance (2, 2)."""
    gains = 2 * s.r + 6
    seen = s.other
    for i in range(2):
        into[i] = found[2 * s.r + i]
        for j in range(4):
            total = 0.0
            for r in range(s.r):
                total += found[gains + i * s.r + r] * found[gains + 2 * s.r + 4 * r + j]
            seen[4 * i + j] = total
            into[i] -= total * load[j]
    for i in range(2):
        for j in range(2):
            total = found[2 * s.r + 2 + 2 * i + j]
            for k in range(4):
                for q in range(4):
                    total += seen[4 * i + k] * covariance[4 * k + q] * seen[4 * j + q]
            into[2 + 2 * i + j] = total


def show(
    s: KernelSolver,
    found: Numbers,
    load: Numbers,
    covariance: Numbers,
    loaded_tool: Count,
    clear: Number,
    resultant: Numbers,
    ground: Numbers,
) -> None:
    """Compute the published force.

    The ground's force is the resultant less the load (4,) with covariance (4, 4), where there is one (`loaded_tool`).
    Otherwise it is the resultant less the mass that explains most of it.

    found:             result of `push`
    clear:             standard errors across a force from which its size makes the direction certain
    resultant, ground: (14,) each: x, z, size [N], direction [rad]; their standard errors, that of the direction per
                       unit of the size; covariance xx, xz, zz with that of the scale; whether the direction is certain;
                       the largest of the first three errors, and of their values
    """
    o, wide = 2 * s.r, 8 * s.r + 8
    xx, xz, zz = found[wide], found[wide + 1], found[wide + 2]
    publish(s, found[o], found[o + 1], found[o + 2] + xx, found[o + 3] + xz, found[o + 5] + zz, clear, resultant)
    if loaded_tool != 0:
        own = s.spread
        soil(s, found, load, covariance, own)
        publish(s, own[0], own[1], own[2] + xx, own[3] + xz, own[5] + zz, clear, ground)
    else:
        z = found[o + 1] + found[wide - 2]
        publish(s, found[o], z, found[o + 2] + xx, found[o + 3] + xz, found[o + 5] + zz, clear, ground)


@inner
def publish(
    s: KernelSolver, x: Number, z: Number, xx: Number, xz: Number, zz: Number, clear: Number, into: Numbers
) -> None:
    """Compute a force as it is published, of x, z [N] with covariance xx, xz, zz [N^2] without that of the scale."""
    scale = s.scale_error * s.scale_error
    xx, xz, zz = xx + scale * (x * x), xz + scale * (x * z), zz + scale * (z * z)
    size = sqrt(x * x + z * z)
    t, u = (x / size, z / size) if size > 0.0 else (1.0, 0.0)
    along = abs(t * t * xx + 2.0 * t * u * xz + u * u * zz)
    across = abs(u * u * xx - 2.0 * t * u * xz + t * t * zz)
    certain = 1.0 if size > clear * sqrt(across) else 0.0
    into[0], into[1], into[2], into[3] = x, z, size, atan2(z, x)
    into[4], into[5] = sqrt(xx), sqrt(zz)
    into[6] = sqrt(along) if certain != 0.0 else sqrt(along + across)
    into[7] = sqrt(across) / (size + 1e-9)
    into[8], into[9], into[10], into[11] = xx, xz, zz, certain
    into[12], into[13] = max(into[4], into[5], into[6]), size


def learn(s: KernelSolver, found: Numbers, good: Numbers, load: Numbers, before: Numbers) -> None:
    """Update the variances (R,) that end `before`, after an instant in the air with a load (4,).

    s <- s (1 + a (e - 1)) of the rows that are `good`, e the squared residual over its variance."""
    o = s.r * s.r + s.c
    for r in range(s.r):
        residual = found[r]
        for i in range(4):
            residual -= found[4 * s.r + 6 + 4 * r + i] * load[i]
        variance = before[o + r]
        if good[r] != 0.0:
            expected = found[s.r + r] + before[r * s.r + r] + variance
            variance *= 1.0 + (min(residual * residual / expected, s.largest) - 1.0) / s.learning
        before[o + r] = max(variance, s.row_error[r] * s.row_error[r])


def fill(known: Numbers, full: Numbers, share: Number, found: Numbers) -> None:
    """Compute the covariance (4, 4) of a load in a bucket that may have gained a share of `full` (4,) since it was
    `known` (4, 4)."""
    for i in range(4):
        for j in range(4):
            found[4 * i + j] = known[4 * i + j] + share * full[i] * (share * full[j])
