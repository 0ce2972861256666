"""Momentum and static columns of every effect at one instant: the laws of `effects` in plain numbers. Each function
names the effect whose equation it is; a test compares all of them.

The columns are written to `KernelPlan.momentum` and `KernelPlan.static`, tables of R rows (measured torques) by K
columns (parameters): torque = d/dt (momentum @ parameters) + static @ parameters."""

from math import cos, exp, sin, tanh

from cylforce.estimation.kernel.bodies import (
    BARS,
    END,
    FOOT,
    HALF_LENGTH,
    MIDDLE,
    PIN,
    ROCKER_LENGTH,
    move_barrel,
    move_cylinder,
    rider,
    set_links,
    slope_at,
    slope_rate_at,
)
from cylforce.estimation.kernel.plan import KernelPlan
from cylforce.estimation.kernel.restricted import Count, Number, Numbers, inner

COULOMB: Count = 0  # the force laws, one column for each cylinder
VISCOUS: Count = 1
LOAD: Count = 2
DIRECTIONAL: Count = 3
STRIBECK: Count = 4
DELAY: Count = 5
ZERO: Count = 6
AT_REST: Count = 7


@inner
def put(p: KernelPlan, table: Numbers, joint: Count, column: Count, value: Number) -> None:
    """Write a value to the row of a joint in a table, if the joint's torque is measured.

    joint:  0 to N - 1
    column: 0 to K - 1

    Written:
    table:  (R, K)
    """
    if p.row[joint] >= 0:
        table[p.row[joint] * p.k + column] = value


@inner
def link_columns(p: KernelPlan, g: Number, h: Number) -> None:
    """Compute the columns of inertia and weight of all links (`Rigid`): the joint torques per unit of J, X and Z.

    J [kg m^2] is a link's moment of inertia about its inner pin. X and Z [kg m] are its first moments, mass times place
    of the centre, along the link and across it.

    g, h: specific force, the acceleration of the first pin plus gravity: upwards (g) and forwards (h) in true axes
          [m/s^2]

    Read: `p.level` (N, 2) cosine and sine of the links' angles from the true horizontal, `p.qd` (N,) their rates
    [rad/s], `p.lengths` (N,) [m]

    Written: the links' columns in `p.momentum` and `p.static` (R, K)

    For c = X + i Z of link k, in joint j, the columns are Re(c conj(.)) of own_k + sum l_i exp(i (q_k - q_i)) qd_k
    (momentum) and of (g + i h) exp(i q_k) - i qd_k own_k + sum i qd_i l_i exp(...) qd_k (static). The sums run over i =
    j ... k-1, and own_k = sum_{i<k} l_i exp(i (q_k - q_i)) qd_i."""
    level, lengths, qd, momentum, static = p.level, p.lengths, p.qd, p.momentum, p.static
    for k in range(p.n):
        t, u, rate = level[2 * k], level[2 * k + 1], qd[k]
        own_x, own_z = 0.0, 0.0
        for i in range(k):
            own_x += lengths[i] * (t * level[2 * i] + u * level[2 * i + 1]) * qd[i]
            own_z += lengths[i] * (u * level[2 * i] - t * level[2 * i + 1]) * qd[i]
        px, pz = own_x, own_z
        sx, sz = g * t - h * u + rate * own_z, g * u + h * t - rate * own_x
        for j in range(k, -1, -1):
            if j < k:
                x = lengths[j] * (t * level[2 * j] + u * level[2 * j + 1]) * rate
                z = lengths[j] * (u * level[2 * j] - t * level[2 * j + 1]) * rate
                px, pz = px + x, pz + z
                sx, sz = sx - qd[j] * z, sz + qd[j] * x
            if p.row[j] >= 0:
                o = p.row[j] * p.k
                inertia, first, second = o + p.rigid[3 * k], o + p.rigid[3 * k + 1], o + p.rigid[3 * k + 2]
                momentum[inertia], momentum[first], momentum[second] = rate, px, -pz
                static[inertia], static[first], static[second] = 0.0, sx, -sz


@inner
def slewing_columns(p: KernelPlan, square: Number) -> None:
    """Compute the centrifugal torques while the house slews (`Slew`), per unit of each link's parameters.

    They are added to the columns of inertia J [kg m^2] and first moments X, Z [kg m] of `link_columns`. The columns of
    D_excess and E [kg m^2], second moments that act only while the house slews, are computed whole.

    square: squared slew rate Omega^2 [rad^2/s^2]

    Read: `p.turn` (N, 2) cosine and sine of the links' angles a from the house's horizontal, `p.axis` [m], distance of
    the first pin from the slew axis

    Written: the links' columns in `p.static` (R, K)

    The columns are Omega^2 times, of link k in joint j <= k: -i rho_k e_k + sum_{j<=i<k} l_i sin a_i e_k for c = X + i
    Z; and sin 2a_k / 2, cos 2a_k for D = J + D_excess and E. Here e = cos a + i sin a, and rho is the distance of a
    link's pin from the slew axis."""
    rho = p.axis
    for k in range(p.n):
        t, u = p.turn[2 * k], p.turn[2 * k + 1]
        x, z = rho * u, -rho * t
        for j in range(k, -1, -1):
            if j < k:
                x += p.lengths[j] * p.turn[2 * j + 1] * t
                z += p.lengths[j] * p.turn[2 * j + 1] * u
            if p.row[j] >= 0:
                o = p.row[j] * p.k
                p.static[o + p.rigid[3 * k]] += square * (t * u)
                p.static[o + p.rigid[3 * k + 1]] += square * x
                p.static[o + p.rigid[3 * k + 2]] -= square * z
                p.static[o + p.slewed[2 * k]] = square * (t * u)
                p.static[o + p.slewed[2 * k + 1]] = square * (t * t - u * u)
        rho += p.lengths[k] * t


@inner
def tool_columns(p: KernelPlan) -> None:
    """Compute the columns of a force at the tool (`TipForce`): the joint torques by which the cylinders balance it.

    They are the torques per newton forwards (x) [m], per newton upwards (z) [m] and per newton metre of moment. With
    the tool at x, z [m] from a joint, they are z, -x and -1 in that joint.

    Read: `p.level` (N, 2) cosine and sine of the links' angles from the true horizontal, `p.arm` (N, 2) from each
    link's pin to the next one, or to the tool [m]

    Written: columns `p.tip` to `p.tip + 2` of `p.static` (R, K)
    """
    x, z = 0.0, 0.0
    for j in range(p.n - 1, -1, -1):
        cosine, sine = p.level[2 * j], p.level[2 * j + 1]
        x += p.arm[2 * j] * cosine - p.arm[2 * j + 1] * sine
        z += p.arm[2 * j] * sine + p.arm[2 * j + 1] * cosine
        put(p, p.static, j, p.tip, z)
        put(p, p.static, j, p.tip + 1, -x)
        put(p, p.static, j, p.tip + 2, -1.0)


@inner
def bar_columns(
    p: KernelPlan, column: Count, near: Count, far: Count, length: Number, up: Number, forward: Number
) -> None:
    """Compute the column of a bar's weight (`RockerWeight`, `CylinderWeight`): the joint torques per kg m of the bar.

    The parameter is the bar's first moment about its near end. One kg m acts as a mass of 1/length [kg] at the far end
    less the same mass at the near one. A mass at x has, in joint j, the momentum x_j . v and the static torque
    -d(x_j)/dt . v + g z_j - Omega^2 rho x_j, with x_j the derivative of x by the joint's angle, v its velocity and rho
    its distance from the slew axis (`riders.unit_mass_torque`).

    column:      number of the parameter
    near, far:   riders at the ends of the bar
    length:      of the bar [m]
    up, forward: specific force, the acceleration of the first pin plus gravity, in the house's axes [m/s^2]

    Read: both riders, `p.torque[R]`, the squared slew rate, `p.axis` [m]

    Written: the column in `p.momentum` and `p.static` (R, K)
    """
    w = p.riders
    slew_square = p.torque[p.r]
    a, b = rider(p, near), rider(p, far)
    out_a, out_b = slew_square * (p.axis + w[a]), slew_square * (p.axis + w[b])
    for j in range(p.n):
        g, h = slope_at(j), slope_rate_at(p, j)
        moved_a = w[a + g] * w[a + 2] + w[a + g + 1] * w[a + 3]
        moved_b = w[b + g] * w[b + 2] + w[b + g + 1] * w[b + 3]
        held_a = (
            up * w[a + g + 1] + forward * w[a + g] - out_a * w[a + g] - w[a + h] * w[a + 2] - w[a + h + 1] * w[a + 3]
        )
        held_b = (
            up * w[b + g + 1] + forward * w[b + g] - out_b * w[b + g] - w[b + h] * w[b + 2] - w[b + h + 1] * w[b + 3]
        )
        put(p, p.momentum, j, column, (moved_b - moved_a) / length)
        put(p, p.static, j, column, (held_b - held_a) / length)


@inner
def clear_columns(p: KernelPlan, column: Count) -> None:
    """Set the column of a bar's weight to zero in `p.momentum` and `p.static` (R, K): its linkage cannot be closed.

    column: number of the parameter
    """
    for j in range(p.n):
        put(p, p.momentum, j, column, 0.0)
        put(p, p.static, j, column, 0.0)


@inner
def cylinders(p: KernelPlan, up: Number, forward: Number) -> None:
    """Compute lever and speed of all C cylinders, and the columns of the weight of cylinders and four-bars.

    Where the linkage of a cylinder cannot be closed, the columns of its weights are zero.

    up, forward: specific force, the acceleration of the first pin plus gravity, in the house's axes [m/s^2]

    Read: motion of the links (`set_links`); `p.rocker`, `p.weight` (C,), columns of the weight of a four-bar's bars and
    of the cylinder, -1: none; `p.bars` (C, 6)

    Written: `p.lever` (C, N) [m/rad], `p.speed` (C,) [m/s], `p.good` (C,) (`move_cylinder`); columns of the weights in
    `p.momentum` and `p.static` (R, K)
    """
    for c in range(p.c):
        closed = move_cylinder(p, c)
        if p.rocker[c] >= 0 and closed:
            bar_columns(p, p.rocker[c], PIN, END, p.bars[BARS * c + ROCKER_LENGTH], up, forward)
        elif p.rocker[c] >= 0:
            clear_columns(p, p.rocker[c])
        if p.weight[c] >= 0 and closed:
            half = p.bars[BARS * c + HALF_LENGTH]
            move_barrel(p, half)  # the centre of the barrel
            bar_columns(p, p.weight[c], FOOT, MIDDLE, half, up, forward)
        elif p.weight[c] >= 0:
            clear_columns(p, p.weight[c])


@inner
def law(kind: Count, a: Number, b: Number, speed: Number, force: Number, rate: Number) -> Number:
    """Return the force of a cylinder by one law, per unit of the law's parameter.

    kind:  of the law, one of the constants above: tanh(v/a) for `CoulombFriction`, v `ViscousFriction`, |F| tanh(v/a)
           `LoadDependentFriction`, |tanh(v/a)| `AsymmetricFriction`, exp(-(v/b)^2) tanh(v/a) `Stribeck`, dF/dt `Delay`,
           1 `PressureZero`, 1 - |tanh(v/a)| `AtRest`
    a:     speed over which the sign of the speed is rounded [m/s]
    b:     speed at which the friction of creep has fallen to 37 % [m/s]
    speed: v of the cylinder [m/s]
    force: F of the cylinder [N]
    rate:  dF/dt [N/s]
    """
    found = 1.0
    if kind == VISCOUS:
        found = speed
    elif kind == DELAY:
        found = rate
    elif kind != ZERO:
        found = tanh(speed / a)
        if kind == LOAD:
            found = abs(force) * found
        elif kind == DIRECTIONAL:
            found = abs(found)
        elif kind == STRIBECK:
            found = exp(-((speed / b) * (speed / b))) * found
        elif kind == AT_REST:
            found = 1.0 - abs(found)
    return found


@inner
def forces(p: KernelPlan) -> None:
    """Compute the columns of the force laws (`Friction`, `AtRest`, `Delay`, `PressureZero`) and the measured torques.

    A column is the law's force (`law`) times the lever, for friction at rest the size of the lever. A law has one
    column for each cylinder. A measured torque is the sum of the cylinders' forces times their levers.

    Read: `p.speed` (C,) [m/s], `p.lever` (C, N) [m/rad]; `p.middle` and `p.rate` (D,), of which the forces [N] and
    their rates [N/s] follow the N angles; `p.laws`, `p.shapes` and `p.levers`, constants

    Written: the laws' columns in `p.static` (R, K), `p.torque` (R,) [N m]; `p.pushes` (C,), forces of the last law
    """
    static, levers, lever, pushes = p.static, p.levers, p.lever, p.pushes
    for i in range(p.law_size):
        kind, first = p.laws[2 * i], p.laws[2 * i + 1]
        a, b = p.shapes[2 * i], p.shapes[2 * i + 1]
        for c in range(p.c):
            pushes[c] = law(kind, a, b, p.speed[c], p.middle[p.n + c], p.rate[p.n + c])
        for m in range(p.lever_size):  # `levers`: place among (C, N), row K + cylinder, cylinder
            arm, place, c = lever[levers[3 * m]], levers[3 * m + 1] + first, levers[3 * m + 2]
            static[place] = pushes[c] * (abs(arm) if kind == AT_REST else arm)
    for r in range(p.r):
        p.torque[r] = 0.0
    for m in range(p.lever_size):
        p.torque[levers[3 * m + 1] // p.k] += p.middle[p.n + levers[3 * m + 2]] * lever[levers[3 * m]]


@inner
def columns(p: KernelPlan) -> None:
    """Compute the equations of one instant before the filters: measured joint torques, and columns that explain them.

    torque = d/dt (momentum columns @ parameters) + static columns @ parameters, for each of R measured torques. Lever
    and speed of each cylinder, and the motion of the links, are results, too.

    The channels are N joint angles [rad], C cylinder forces [N], with an inertial sensor on the base its rate of
    rotation [rad/s] and specific force forwards and upwards [m/s^2], then pitch and roll [rad], and slew rate [rad/s]
    or, if that is not measured, slew angle [rad] (`Channels.moved`). The specific force of the first pin (g upwards, h
    forwards, in true axes) is that of the sensor at r, less (i alpha - omega^2) r and without the part of slewing; or
    else gravity.

    Read: `p.middle` and `p.rate` (D,), channels and their rates per second

    Written: `p.momentum` and `p.static` (R, K), `p.torque` (R + 1,): measured torques [N m], squared slew rate; lever,
    speed and use of the cylinders; motion of the links
    """
    pitch, roll = p.middle[p.d - 3], p.middle[p.d - 2]
    slew = p.middle[p.d - 1] if p.rate_slew else p.rate[p.d - 1]
    g, h, turning = p.gravity * cos(roll), 0.0, 0.0
    if p.inertial:
        base = p.n + p.c  # place of the inertial sensor's rate; its specific forces follow
        turning, alpha = p.middle[base], p.rate[base]
        x = p.middle[base + 1] + alpha * p.base_z + turning * turning * p.base_x + slew * slew * (p.axis + p.base_x)
        z = p.middle[base + 2] - alpha * p.base_x + turning * turning * p.base_z
        g, h = z * cos(pitch) + x * sin(pitch), x * cos(pitch) - z * sin(pitch)
    set_links(p, pitch, turning)
    p.torque[p.r] = slew * slew
    link_columns(p, g, h)
    if p.slewed_size:
        slewing_columns(p, slew * slew)
    tool_columns(p)
    cylinders(p, g * cos(pitch) - h * sin(pitch), g * sin(pitch) + h * cos(pitch))
    forces(p)
