"""Motion of links, linkages and points at one instant (mechanics/README.md, sections 1 and 2): the laws of
`mechanics.riders` and `mechanics.linkages` in plain numbers, x and z one after the other.

A rider is a point that moves with the links. It has 4 + 4 N numbers in `KernelPlan.riders`: place x, z [m] in the
house's axes from the first pin, velocity x, z [m/s], for each of the N joints the derivative x, z of the place by its
angle [m/rad], and for each joint the time derivative of that [m/(rad s)]. Riders have numbers, below."""

from math import cos, sin, sqrt

from cylforce.estimation.kernel.plan import KernelPlan
from cylforce.estimation.kernel.restricted import Count, Number, inner

MIN_TRANSMISSION: Number = 0.15  # as in `channels`
MIN_LEVER: Number = 0.02
# Numbers of the riders of the cylinder that is being computed.
FOOT: Count = 0  # pin of the cylinder's barrel
PIN: Count = 1  # pin of the four-bar's rocker
LINK: Count = 2  # pin of the four-bar's connecting link on the driven body
END: Count = 3  # joint of rocker and connecting link
EYE: Count = 4  # pin of the cylinder's rod
MIDDLE: Count = 5  # point of the barrel
# Places in the six numbers of a cylinder's bars.
BARS: Count = 6
ROCKER_LENGTH: Count = 0  # m
LINK_LENGTH: Count = 1  # m
SIDE: Count = 2  # 1 or -1: side of the line from PIN to LINK on which END lies
EYE_ALONG: Count = 3  # place of EYE in units of the rocker, along it from PIN to END
EYE_ACROSS: Count = 4
HALF_LENGTH: Count = 5  # m, half of the shortest length of the cylinder


@inner
def rider(p: KernelPlan, number: Count) -> Count:
    """Return the first place of a rider in `p.riders`: place x, z [m], then velocity x, z [m/s]."""
    return number * (4 + 4 * p.n)


@inner
def slope_at(joint: Count) -> Count:
    """Return the place in a rider of the derivative x, z of its place by a joint's angle [m/rad]."""
    return 4 + 2 * joint


@inner
def slope_rate_at(p: KernelPlan, joint: Count) -> Count:
    """Return the place in a rider of the time derivative of that derivative [m/(rad s)]."""
    return 4 + 2 * (p.n + joint)


@inner
def set_links(p: KernelPlan, pitch: Number, turning: Number) -> None:
    """Compute the motion of the N links.

    pitch:   of the chassis [rad]
    turning: rate at which the chassis turns in the arm's plane [rad/s]

    Read: the joint angles `p.middle` [rad] and their rates `p.rate` [rad/s], `p.lengths` (N,) [m]

    Written:
    `p.q`, `p.qd` (N,): angle of each link from the true horizontal [rad] and its rate [rad/s]
    `p.turn`, `p.level` (N, 2): cosine and sine of its angle in the house's, and in true axes
    `p.hinge` (N, 4): place x, z [m] and velocity x, z [m/s] of its inner pin, in the house's axes from the first pin
    """
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
def move_point(p: KernelPlan, number: Count, body: Count, x: Number, z: Number) -> None:
    """Compute the motion of a point that is fixed to a body, as a rider: place, velocity, derivatives by the angles.

    number: of the rider
    body:   0 the house, then the links
    x, z:   the point in the body's own axes, from its inner pin [m]

    Read: `p.turn`, `p.hinge`, `p.qd` of the links (`set_links`)

    Written: the rider's place, velocity, their derivatives by each joint's angle; 0 for joints beyond the body
    """
    w = p.riders
    o = rider(p, number)
    if body == 0:
        w[o], w[o + 1], w[o + 2], w[o + 3] = x, z, 0.0, 0.0
    else:
        link, pin = body - 1, 4 * (body - 1)
        cosine, sine = p.turn[2 * link], p.turn[2 * link + 1]
        own_x, own_z = x * cosine - z * sine, x * sine + z * cosine
        w[o], w[o + 1] = p.hinge[pin] + own_x, p.hinge[pin + 1] + own_z
        w[o + 2] = p.hinge[pin + 2] - own_z * p.qd[link]
        w[o + 3] = p.hinge[pin + 3] + own_x * p.qd[link]
    for j in range(p.n):
        g, h = o + slope_at(j), o + slope_rate_at(p, j)
        w[g], w[g + 1], w[h], w[h + 1] = 0.0, 0.0, 0.0, 0.0
        if j < body:  # d place / d angle = i (place - pin j)
            w[g], w[g + 1] = p.hinge[4 * j + 1] - w[o + 1], w[o] - p.hinge[4 * j]
            w[h], w[h + 1] = p.hinge[4 * j + 3] - w[o + 3], w[o + 2] - p.hinge[4 * j + 2]


@inner
def move_four_bar(p: KernelPlan, c: Count) -> Number:
    """Compute the motion of the four-bar of cylinder c (riders END, its rocker, and EYE), and return its transmission.

    The transmission is the sine of the angle between rocker and connecting link, near 0 close to a dead point. It is -1
    exactly at a dead point, or where the linkage cannot be closed; both riders remain as they were then. The connecting
    link keeps its length: bar . (d base / d angle) = cross spin, with base from PIN to LINK, bar from LINK to END,
    cross the cross product of the rocker (PIN to END) and bar [m^2], and spin the derivative of the rocker's angle by a
    joint's. A rider is a moving point: place x, z [m], velocity [m/s], derivatives of the place by each joint's angle
    [m/rad], and their rates.

    Read: riders PIN and LINK, the bars' lengths in `p.bars`

    Written: riders END and EYE
    """
    w = p.riders
    pin, link, end, bars = rider(p, PIN), rider(p, LINK), rider(p, END), BARS * c
    rocker, connecting = p.bars[bars + ROCKER_LENGTH], p.bars[bars + LINK_LENGTH]
    base_x, base_z = w[link] - w[pin], w[link + 1] - w[pin + 1]
    span = sqrt(base_x * base_x + base_z * base_z)
    if span == 0.0:
        return -1.0
    along = (span * span + (rocker * rocker - connecting * connecting)) / (2.0 * span)
    square = rocker * rocker - along * along
    if not square >= 0.0:
        return -1.0
    across = p.bars[bars + SIDE] * sqrt(square)
    cosine, sine_base = base_x / span, base_z / span
    arm_x, arm_z = cosine * along - sine_base * across, cosine * across + sine_base * along  # from PIN to END
    bar_x, bar_z = arm_x - base_x, arm_z - base_z
    cross = arm_x * bar_z - arm_z * bar_x
    if cross == 0.0:
        return -1.0
    both = min(p.bodies[3 * c + 1], p.bodies[3 * c + 2])  # number of the first joints, which turn the whole linkage
    turning, before = 0.0, 0.0
    for j in range(p.n):
        g = slope_at(j)
        spin = 1.0  # a joint between the chassis and both pins turns the linkage as a whole
        if j >= both:
            spin = (bar_x * (w[link + g] - w[pin + g]) + bar_z * (w[link + g + 1] - w[pin + g + 1])) / cross
        w[end + g], w[end + g + 1] = w[pin + g] - arm_z * spin, w[pin + g + 1] + arm_x * spin
        w[end + slope_rate_at(p, j)] = spin  # until `change_four_bar`
        turning += spin * (p.qd[j] - before)
        before = p.qd[j]
    w[end], w[end + 1] = w[pin] + arm_x, w[pin + 1] + arm_z
    w[end + 2], w[end + 3] = w[pin + 2] - arm_z * turning, w[pin + 3] + arm_x * turning
    change_four_bar(p, both, bar_x, bar_z, cross)
    move_eye(p, p.bars[bars + EYE_ALONG], p.bars[bars + EYE_ACROSS])
    return abs(cross) / (rocker * connecting)


@inner
def change_four_bar(p: KernelPlan, both: Count, bar_x: Number, bar_z: Number, cross: Number) -> None:
    """Compute how fast the derivatives of the rocker's end (rider END) by the joints' angles change [m/(rad s)].

    The rocker's spin, the derivative of its angle by each joint's, has the rate `gain` by the time derivative of bar .
    (d base / d angle) = cross spin.

    both:         number of the first joints, from the chassis to both pins, which turn the linkage as a whole: spin 1
    bar_x, bar_z: from LINK to END [m]
    cross:        cross product of rocker and bar [m^2]

    Read: riders PIN, LINK, and END, which holds the spin of each joint in the place of the result

    Written: the last 2 N numbers of rider END
    """
    w = p.riders
    pin, link, end = rider(p, PIN), rider(p, LINK), rider(p, END)
    arm_x, arm_z = w[end] - w[pin], w[end + 1] - w[pin + 1]
    vx, vz = w[end + 2] - w[pin + 2], w[end + 3] - w[pin + 3]
    fast_x, fast_z = w[end + 2] - w[link + 2], w[end + 3] - w[link + 3]
    grows = vx * bar_z - vz * bar_x + arm_x * fast_z - arm_z * fast_x  # rate of `cross`
    for j in range(p.n):
        g, h = slope_at(j), slope_rate_at(p, j)
        spin, gain = w[end + h], 0.0
        if j >= both:
            gx, gz = w[link + g] - w[pin + g], w[link + g + 1] - w[pin + g + 1]
            hx, hz = w[link + h] - w[pin + h], w[link + h + 1] - w[pin + h + 1]
            gain = (fast_x * gx + fast_z * gz + bar_x * hx + bar_z * hz - grows * spin) / cross
        w[end + h] = w[pin + h] - vz * spin - arm_z * gain
        w[end + h + 1] = w[pin + h + 1] + vx * spin + arm_x * gain


@inner
def move_eye(p: KernelPlan, x: Number, z: Number) -> None:
    """Compute the motion of the pin of a cylinder's rod (rider EYE), which is fixed to the rocker of a four-bar.

    It is at PIN plus (x + i z) times the vector from PIN to END, the rocker's ends. A rider is a moving point: place x,
    z [m], velocity [m/s], derivatives of the place by each joint's angle [m/rad], and their rates. All follow that law.

    x, z: place of the eye along and across the rocker, in units of its length

    Read: riders PIN and END

    Written: rider EYE
    """
    w = p.riders
    pin, end, eye = rider(p, PIN), rider(p, END), rider(p, EYE)
    for i in range(0, 4 + 4 * p.n, 2):
        far_x, far_z = w[end + i] - w[pin + i], w[end + i + 1] - w[pin + i + 1]
        w[eye + i], w[eye + i + 1] = w[pin + i] + x * far_x - z * far_z, w[pin + i + 1] + x * far_z + z * far_x


@inner
def move_cylinder(p: KernelPlan, c: Count) -> Count:
    """Compute lever [m/rad] and speed [m/s] of cylinder c from the motion of its pins.

    Return 1 if its linkage can be closed in this posture, else 0. The lever is the derivative of the length by each
    joint's angle. Lever and speed are zero where the force is not used: at a dead point of the linkage or at an end
    stop.

    Read: motion of the links (`set_links`), `p.rate` [rad/s], `p.bodies`, `p.pins` (C, 6) [m], `p.stops` (C, 2) [m]

    Written: riders FOOT and EYE, of a four-bar also PIN, LINK and END; row c of `p.lever` (C, N) [m/rad]; number c of
    `p.speed` [m/s] and of `p.good`, 1 where the force is used, else 0
    """
    w = p.riders
    foot, eye, o = rider(p, FOOT), rider(p, EYE), 6 * c  # o: place of the cylinder in `pins`
    move_point(p, FOOT, p.bodies[3 * c], p.pins[o], p.pins[o + 1])
    transmission = 1.0
    if p.bodies[3 * c + 2] < 0:
        move_point(p, EYE, p.bodies[3 * c + 1], p.pins[o + 2], p.pins[o + 3])
    else:
        move_point(p, PIN, p.bodies[3 * c + 1], p.pins[o + 2], p.pins[o + 3])
        move_point(p, LINK, p.bodies[3 * c + 2], p.pins[o + 4], p.pins[o + 5])
        transmission = move_four_bar(p, c)
    x, z = w[eye] - w[foot], w[eye + 1] - w[foot + 1]
    length = sqrt(x * x + z * z)
    closed = 1 if transmission >= 0.0 and length > 0.0 else 0
    largest, speed = 0.0, 0.0
    for j in range(p.n):
        g = slope_at(j)
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
def move_barrel(p: KernelPlan, distance: Number) -> None:
    """Compute the motion of a point of the cylinder's barrel (rider MIDDLE), on the line from FOOT to EYE.

    A rider is a moving point: place x, z [m], velocity [m/s], derivatives of the place by each joint's angle [m/rad],
    and their rates. FOOT is the pin of the barrel, EYE that of the rod.

    distance: from the foot [m]

    Read: riders FOOT and EYE

    Written: rider MIDDLE
    """
    w = p.riders
    foot, eye, middle = rider(p, FOOT), rider(p, EYE), rider(p, MIDDLE)
    x, z = w[eye] - w[foot], w[eye + 1] - w[foot + 1]
    vx, vz = w[eye + 2] - w[foot + 2], w[eye + 3] - w[foot + 3]
    length = sqrt(x * x + z * z)
    t, u = x / length, z / length  # direction of the cylinder
    turning, grows = (t * vz - u * vx) / length, (t * vx + u * vz) / length  # rates of angle and (relative) length
    w[middle], w[middle + 1] = w[foot] + distance * t, w[foot + 1] + distance * u
    w[middle + 2], w[middle + 3] = w[foot + 2] - distance * turning * u, w[foot + 3] + distance * turning * t
    for j in range(p.n):
        g, h = slope_at(j), slope_rate_at(p, j)
        gx, gz = w[eye + g] - w[foot + g], w[eye + g + 1] - w[foot + g + 1]
        hx, hz = w[eye + h] - w[foot + h], w[eye + h + 1] - w[foot + h + 1]
        swings = (t * gz - u * gx) / length  # derivative of the cylinder's angle by the joint's; `gain`: its rate
        gain = (t * hz - u * hx - turning * (t * gx + u * gz)) / length - grows * swings
        w[middle + g], w[middle + g + 1] = w[foot + g] - distance * swings * u, w[foot + g + 1] + distance * swings * t
        w[middle + h] = w[foot + h] - distance * (gain * u + turning * swings * t)
        w[middle + h + 1] = w[foot + h + 1] + distance * (gain * t - turning * swings * u)
