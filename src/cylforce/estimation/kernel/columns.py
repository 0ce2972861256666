"""Momentum and static columns of every effect at one instant: the laws of `effects` in plain numbers. Each function
names the effect whose equation it is; a test compares all of them."""

from math import cos, exp, sin, tanh

from cylforce.estimation.kernel.bodies import END, FOOT, MIDDLE, PIN, follow_line, set_links, stretch
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
    """Write a value to a (R, K) table, where that joint's torque is measured."""
    if p.row[joint] >= 0:
        table[p.row[joint] * p.k + column] = value


@inner
def rigid(p: KernelPlan, g: Number, h: Number) -> None:
    """Compute the columns of `Rigid`, with g + i h the specific force.

    For c = X + i Z of link k, in joint j, they are Re(c conj(.)) of own_k + sum l_i exp(i (q_k - q_i)) qd_k (momentum)
    and of (g + i h) exp(i q_k) - i qd_k own_k + sum i qd_i l_i exp(...) qd_k (static). The sums run over i = j ... k-1,
    and own_k = sum_{i<k} l_i exp(i (q_k - q_i)) qd_i."""
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
def slewed(p: KernelPlan, square: Number) -> None:
    """Compute the columns of `Slew`, added to `rigid`'s.

    They are Omega^2 times, of link k in joint j <= k: -i rho_k e_k + sum_{j<=i<k} l_i sin a_i e_k for c, and sin 2a_k /
    2, cos 2a_k for D and E."""
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
def tip(p: KernelPlan) -> None:
    """Compute the columns of `TipForce`: the vector from each joint to the tool, x and -z across."""
    x, z = 0.0, 0.0
    for j in range(p.n - 1, -1, -1):
        t, u = p.level[2 * j], p.level[2 * j + 1]
        x += p.arm[2 * j] * t - p.arm[2 * j + 1] * u
        z += p.arm[2 * j] * u + p.arm[2 * j + 1] * t
        put(p, p.static, j, p.tip, z)
        put(p, p.static, j, p.tip + 1, -x)
        put(p, p.static, j, p.tip + 2, -1.0)


@inner
def weigh(p: KernelPlan, column: Count, near: Count, far: Count, size: Number, up_x: Number, up_z: Number) -> None:
    """Compute the columns of `RockerWeight` and `CylinderWeight`: a mass of 1/size at rider `far` less the same at
    rider `near`.

    p_j = x_j . v and -d(x_j)/dt . v + g z_j - Omega^2 rho x_j (`riders.of_mass`); Omega^2 is in `turning`."""
    w = p.riders
    length, n, turning = 4 + 4 * p.n, p.n, p.torque[p.r]
    a, b = near * length, far * length
    out_a, out_b = turning * (p.axis + w[a]), turning * (p.axis + w[b])
    for j in range(n):
        g, h = 4 + 2 * j, 4 + 2 * (n + j)
        moved_a = w[a + g] * w[a + 2] + w[a + g + 1] * w[a + 3]
        moved_b = w[b + g] * w[b + 2] + w[b + g + 1] * w[b + 3]
        held_a = (
            up_x * w[a + g + 1] + up_z * w[a + g] - out_a * w[a + g] - w[a + h] * w[a + 2] - w[a + h + 1] * w[a + 3]
        )
        held_b = (
            up_x * w[b + g + 1] + up_z * w[b + g] - out_b * w[b + g] - w[b + h] * w[b + 2] - w[b + h + 1] * w[b + 3]
        )
        put(p, p.momentum, j, column, (moved_b - moved_a) / size)
        put(p, p.static, j, column, (held_b - held_a) / size)


@inner
def without_weight(p: KernelPlan, column: Count) -> None:
    """Set the columns of a weight to zero, where a linkage cannot be closed."""
    for j in range(p.n):
        put(p, p.momentum, j, column, 0.0)
        put(p, p.static, j, column, 0.0)


@inner
def cylinders(p: KernelPlan, up_x: Number, up_z: Number) -> None:
    """Compute lever and speed of all cylinders, with the columns of their weight and of the bars."""
    for c in range(p.c):
        closed = stretch(p, c)
        if p.rocker[c] >= 0 and closed:
            weigh(p, p.rocker[c], PIN, END, p.bars[6 * c], up_x, up_z)
        elif p.rocker[c] >= 0:
            without_weight(p, p.rocker[c])
        if p.weight[c] >= 0 and closed:
            follow_line(p, p.bars[6 * c + 5])
            weigh(p, p.weight[c], FOOT, MIDDLE, p.bars[6 * c + 5], up_x, up_z)
        elif p.weight[c] >= 0:
            without_weight(p, p.weight[c])


@inner
def law(kind: Count, a: Number, b: Number, speed: Number, force: Number, rate: Number) -> Number:
    """Return the force of a law at speed v, force F and its rate.

    The laws are `CoulombFriction`, `ViscousFriction`, `LoadDependentFriction`, `AsymmetricFriction`, `Stribeck`,
    `Delay`, `PressureZero` and `AtRest`."""
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
    """Compute the columns of `Friction`, `AtRest`, `Delay` and `PressureZero`, the law's force times the lever; and the
    measured torques."""
    static, levers, lever, pushes = p.static, p.levers, p.lever, p.pushes
    for i in range(p.law_size):
        kind, first = p.laws[2 * i], p.laws[2 * i + 1]
        a, b = p.shapes[2 * i], p.shapes[2 * i + 1]
        for c in range(p.c):
            pushes[c] = law(kind, a, b, p.speed[c], p.middle[p.n + c], p.rate[p.n + c])
        for m in range(p.lever_size):
            x = lever[levers[3 * m]]
            static[levers[3 * m + 1] + first] = pushes[levers[3 * m + 2]] * (abs(x) if kind == AT_REST else x)
    for r in range(p.r):
        p.torque[r] = 0.0
    for m in range(p.lever_size):
        p.torque[levers[3 * m + 1] // p.k] += p.middle[p.n + levers[3 * m + 2]] * lever[levers[3 * m]]


@inner
def columns(p: KernelPlan) -> None:
    """Compute all columns, levers, speeds and torques from the channels `middle` and their rates (`Channels.moved`)."""
    pitch, roll = p.middle[p.d - 3], p.middle[p.d - 2]
    slew = p.middle[p.d - 1] if p.rate_slew else p.rate[p.d - 1]
    g, h, turning = p.gravity * cos(roll), 0.0, 0.0
    if p.inertial:
        o = p.n + p.c
        turning = p.middle[o]
        x = p.middle[o + 1] + p.rate[o] * p.base_z + turning * turning * p.base_x + slew * slew * (p.axis + p.base_x)
        z = p.middle[o + 2] - p.rate[o] * p.base_x + turning * turning * p.base_z
        g, h = z * cos(pitch) + x * sin(pitch), x * cos(pitch) - z * sin(pitch)
    set_links(p, pitch, turning)
    p.torque[p.r] = slew * slew
    rigid(p, g, h)
    if p.slewed_size:
        slewed(p, slew * slew)
    tip(p)
    cylinders(p, g * cos(pitch) - h * sin(pitch), g * sin(pitch) + h * cos(pitch))
    forces(p)
