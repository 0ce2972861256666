"""Motion of links, linkages and points at one instant (mechanics/README.md, sections 1 and 2): the laws of
`mechanics.riders` and `mechanics.linkages` in plain numbers, x and z one after the other.

A rider is 4 + 4 N numbers: place x, z, velocity x, z, for each joint the derivative of the place by its angle, and for
each joint the time derivative of that."""

from math import cos, sin, sqrt

from cylforce.estimation.kernel.plan import KernelPlan
from cylforce.estimation.kernel.restricted import Count, Number, inner

MIN_TRANSMISSION: Number = 0.15  # as in `channels`
MIN_LEVER: Number = 0.02
FOOT: Count = 0  # numbers of the riders
PIN: Count = 1
LINK: Count = 2
END: Count = 3
EYE: Count = 4
MIDDLE: Count = 5


@inner
def set_links(p: KernelPlan, pitch: Number, turning: Number) -> None:
    """Compute the links' motion: `q`, `qd` (N,) angle from the true horizontal and its rate; `turn`, `level` (N, 2)
    direction in the house's and in true axes; `hinge` (N, 4) place and velocity of the inner pin."""
    angle = 0.0
    rate = 0.0
    x, z, vx, vz = 0.0, 0.0, 0.0, 0.0
    for j in range(p.n):
        angle += p.middle[j]
        rate += p.rate[j]
        p.q[j] = angle + pitch
        p.qd[j] = rate + turning
        p.turn[2 * j], p.turn[2 * j + 1] = cos(angle), sin(angle)
        p.level[2 * j], p.level[2 * j + 1] = cos(p.q[j]), sin(p.q[j])
        p.hinge[4 * j], p.hinge[4 * j + 1], p.hinge[4 * j + 2], p.hinge[4 * j + 3] = x, z, vx, vz
        x += p.lengths[j] * p.turn[2 * j]
        z += p.lengths[j] * p.turn[2 * j + 1]
        vx -= p.lengths[j] * p.turn[2 * j + 1] * p.qd[j]
        vz += p.lengths[j] * p.turn[2 * j] * p.qd[j]


@inner
def ride(p: KernelPlan, number: Count, body: Count, x: Number, z: Number) -> None:
    """Set rider `number` to the point x, z of a body."""
    w = p.riders
    o = number * (4 + 4 * p.n)
    if body == 0:
        w[o], w[o + 1], w[o + 2], w[o + 3] = x, z, 0.0, 0.0
    else:
        h = 4 * (body - 1)
        t, u = p.turn[2 * (body - 1)], p.turn[2 * (body - 1) + 1]
        own_x, own_z = x * t - z * u, x * u + z * t
        w[o], w[o + 1] = p.hinge[h] + own_x, p.hinge[h + 1] + own_z
        w[o + 2] = p.hinge[h + 2] - own_z * p.qd[body - 1]
        w[o + 3] = p.hinge[h + 3] + own_x * p.qd[body - 1]
    for j in range(p.n):
        g, h = o + 4 + 2 * j, o + 4 + 2 * (p.n + j)
        w[g], w[g + 1], w[h], w[h + 1] = 0.0, 0.0, 0.0, 0.0
        if j < body:
            w[g], w[g + 1] = p.hinge[4 * j + 1] - w[o + 1], w[o] - p.hinge[4 * j]
            w[h], w[h + 1] = p.hinge[4 * j + 3] - w[o + 3], w[o + 2] - p.hinge[4 * j + 2]


@inner
def swing(p: KernelPlan, c: Count) -> Number:
    """Set riders END, the rocker's end, and EYE of four-bar number c, from PIN and LINK, and return the transmission.

    The link keeps its length, so that bar . base' = sine spin. The transmission is -1 where the linkage cannot be
    closed."""
    w = p.riders
    size, n = 4 + 4 * p.n, p.n
    pin, link, end = PIN * size, LINK * size, END * size
    long, short = p.bars[6 * c], p.bars[6 * c + 1]
    base_x, base_z = w[link] - w[pin], w[link + 1] - w[pin + 1]
    span = sqrt(base_x * base_x + base_z * base_z)
    if span == 0.0:
        return -1.0
    along = (span * span + (long * long - short * short)) / (2.0 * span)
    square = long * long - along * along
    if not square >= 0.0:
        return -1.0
    across = p.bars[6 * c + 2] * sqrt(square)
    t, u = base_x / span, base_z / span
    arm_x, arm_z = t * along - u * across, t * across + u * along
    bar_x, bar_z = arm_x - base_x, arm_z - base_z
    sine = arm_x * bar_z - arm_z * bar_x
    if sine == 0.0:
        return -1.0
    both = min(p.bodies[3 * c + 1], p.bodies[3 * c + 2])  # the joints that turn the whole linkage
    turning, before = 0.0, 0.0
    for j in range(n):
        g = 4 + 2 * j
        spin = 1.0
        if j >= both:
            spin = (bar_x * (w[link + g] - w[pin + g]) + bar_z * (w[link + g + 1] - w[pin + g + 1])) / sine
        w[end + g], w[end + g + 1] = w[pin + g] - arm_z * spin, w[pin + g + 1] + arm_x * spin
        w[end + g + 2 * n] = spin  # until `swing_on`
        turning += spin * (p.qd[j] - before)
        before = p.qd[j]
    w[end], w[end + 1] = w[pin] + arm_x, w[pin + 1] + arm_z
    w[end + 2], w[end + 3] = w[pin + 2] - arm_z * turning, w[pin + 3] + arm_x * turning
    swing_on(p, both, bar_x, bar_z, sine)
    between(p, p.bars[6 * c + 3], p.bars[6 * c + 4])
    return abs(sine) / (long * short)


@inner
def swing_on(p: KernelPlan, both: Count, bar_x: Number, bar_z: Number, sine: Number) -> None:
    """Compute the time derivative of the rocker's spin by each joint's angle, and from it those of the derivatives of
    END's place."""
    w = p.riders
    size, n = 4 + 4 * p.n, p.n
    pin, link, end = PIN * size, LINK * size, END * size
    arm_x, arm_z = w[end] - w[pin], w[end + 1] - w[pin + 1]
    vx, vz = w[end + 2] - w[pin + 2], w[end + 3] - w[pin + 3]
    fast_x, fast_z = w[end + 2] - w[link + 2], w[end + 3] - w[link + 3]
    grows = vx * bar_z - vz * bar_x + arm_x * fast_z - arm_z * fast_x
    for j in range(n):
        g, h = 4 + 2 * j, 4 + 2 * (n + j)
        spin, gain = w[end + h], 0.0
        if j >= both:
            gx, gz = w[link + g] - w[pin + g], w[link + g + 1] - w[pin + g + 1]
            hx, hz = w[link + h] - w[pin + h], w[link + h + 1] - w[pin + h + 1]
            gain = (fast_x * gx + fast_z * gz + bar_x * hx + bar_z * hz - grows * spin) / sine
        w[end + h] = w[pin + h] - vz * spin - arm_z * gain
        w[end + h + 1] = w[pin + h + 1] + vx * spin + arm_x * gain


@inner
def between(p: KernelPlan, x: Number, z: Number) -> None:
    """Set rider EYE to x + i z times the vector from PIN to END."""
    w = p.riders
    size = 4 + 4 * p.n
    pin, end, eye = PIN * size, END * size, EYE * size
    for i in range(0, size, 2):
        far_x, far_z = w[end + i] - w[pin + i], w[end + i + 1] - w[pin + i + 1]
        w[eye + i], w[eye + i + 1] = w[pin + i] + x * far_x - z * far_z, w[pin + i + 1] + x * far_z + z * far_x


@inner
def stretch(p: KernelPlan, c: Count) -> Count:
    """Set riders FOOT and EYE (four-bars also PIN and END) of cylinder c, its lever and speed, and return whether the
    linkage is closed.

    Lever and speed are zero where the force is not used: at a dead point or an end stop."""
    w = p.riders
    foot, eye, o = FOOT, EYE * (4 + 4 * p.n), 6 * c
    ride(p, FOOT, p.bodies[3 * c], p.pins[o], p.pins[o + 1])
    transmission = 1.0
    if p.bodies[3 * c + 2] < 0:
        ride(p, EYE, p.bodies[3 * c + 1], p.pins[o + 2], p.pins[o + 3])
    else:
        ride(p, PIN, p.bodies[3 * c + 1], p.pins[o + 2], p.pins[o + 3])
        ride(p, LINK, p.bodies[3 * c + 2], p.pins[o + 4], p.pins[o + 5])
        transmission = swing(p, c)
    x, z = w[eye] - w[foot], w[eye + 1] - w[foot + 1]
    length = sqrt(x * x + z * z)
    closed = 1 if transmission >= 0.0 and length > 0.0 else 0
    largest, speed = 0.0, 0.0
    for j in range(p.n):
        g = 4 + 2 * j
        lever = 0.0
        if closed:
            lever = (x * (w[eye + g] - w[foot + g]) + z * (w[eye + g + 1] - w[foot + g + 1])) / length
        p.lever[c * p.n + j] = lever
        speed += lever * p.rate[j]
        largest = max(largest, abs(lever))
    good = transmission > MIN_TRANSMISSION and largest > MIN_LEVER
    good = good and length > p.stops[2 * c] and length < p.stops[2 * c + 1]
    p.good[c], p.speed[c] = 1, speed
    if not good:
        p.good[c], p.speed[c] = 0, 0.0
        for j in range(p.n):
            p.lever[c * p.n + j] = 0.0
    return closed


@inner
def follow_line(p: KernelPlan, distance: Number) -> None:
    """Set rider MIDDLE to the point on the line from FOOT to EYE, at a fixed distance [m] from the foot."""
    w = p.riders
    size, n = 4 + 4 * p.n, p.n
    foot, eye, middle = FOOT * size, EYE * size, MIDDLE * size
    x, z = w[eye] - w[foot], w[eye + 1] - w[foot + 1]
    vx, vz = w[eye + 2] - w[foot + 2], w[eye + 3] - w[foot + 3]
    length = sqrt(x * x + z * z)
    t, u = x / length, z / length
    turning, grows = (t * vz - u * vx) / length, (t * vx + u * vz) / length
    w[middle], w[middle + 1] = w[foot] + distance * t, w[foot + 1] + distance * u
    w[middle + 2], w[middle + 3] = w[foot + 2] - distance * turning * u, w[foot + 3] + distance * turning * t
    for j in range(n):
        g, h = 4 + 2 * j, 4 + 2 * (n + j)
        gx, gz = w[eye + g] - w[foot + g], w[eye + g + 1] - w[foot + g + 1]
        hx, hz = w[eye + h] - w[foot + h], w[eye + h + 1] - w[foot + h + 1]
        swings = (t * gz - u * gx) / length
        gain = (t * hz - u * hx - turning * (t * gx + u * gz)) / length - grows * swings
        w[middle + g], w[middle + g + 1] = w[foot + g] - distance * swings * u, w[foot + g + 1] + distance * swings * t
        w[middle + h] = w[foot + h] - distance * (gain * u + turning * swings * t)
        w[middle + h + 1] = w[foot + h + 1] + distance * (gain * t - turning * swings * u)
