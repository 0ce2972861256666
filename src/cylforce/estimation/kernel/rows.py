"""Filtered rows from the channels of one sample, one fixed step at a time, as `Channels` and `FilteredRegressor`
compute them along a recording; and the rows of the instant (`fast.py`).

The state of the filters is one array:
channels (D): last ones, their low-pass (2, D) and its last outputs (3, D)
columns:      low-pass (3, R K), and of the torques (3, R)
rows:         steps that each row waits (R)
instant:      speed of the cylinders (C), low-pass of the forces (2, C), last momentum, low-pass of its rate and last
              rate (R K each), low-pass of the acceleration (C)
"""

from math import cos

from cylforce.estimation.kernel.bodies import set_links, stretch
from cylforce.estimation.kernel.columns import columns
from cylforce.estimation.kernel.plan import KernelPlan
from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, inner

AHEAD_S: Number = 0.06  # s by which a reversal of a cylinder is predicted: the delay of its measured speed; measured
STARTING: Number = 0.03  # m/s^2 of a cylinder, below which a change of sign is noise at rest; chosen


def state_size(p: KernelPlan) -> Count:
    """Return the number of numbers in a state."""
    return 6 * p.d + 6 * p.r * p.k + 4 * p.r + 4 * p.c


def rows_size(p: KernelPlan) -> Count:
    """Return the number of numbers in the rows of a step.

    weighing:  columns (R, K) and torques (R)
    instant:   columns (R, K) and torques (R), rate of change of the columns (R, K)
    cylinders: whether each reverses (C), levers (C, R)
    tool:      place and velocity (4)
    usable:    which rows are usable (R)
    speed:     of the cylinders (C)
    """
    return 3 * p.r * p.k + 3 * p.r + 2 * p.c + p.c * p.r + 4


def advance(p: KernelPlan, old: Numbers, here: Numbers, new: Numbers, out: Numbers, first: Count) -> None:
    """Compute the state `new` and the rows `out` (both zero before) from the state `old` and the channels `here` (D,).

    first: 1 where the filters of columns and forces begin with this step; `old` then gets their state before it
    """
    smooth(p, old, here, new)
    columns(p)
    weighing_rows(p, old, new, out, first)
    wait(p, old, new, out)
    instant_forces(p, old, here, new, out, first)
    instant_columns(p, old, new, out, first)
    tool(p, out)


@inner
def smooth(p: KernelPlan, old: Numbers, here: Numbers, new: Numbers) -> None:
    """Filter the channels, and compute mean and slope of four samples (`filters.mean`, `filters.slope`)."""
    d, b, f = p.d, p.channel[0], 3 * p.d
    for i in range(p.d):
        x = here[i]
        y = old[d + i] + b * x
        new[i] = x
        new[d + i] = p.channel[1] * x + old[2 * d + i] - p.channel[3] * y
        new[2 * d + i] = p.channel[2] * x - p.channel[4] * y
        new[f + i], new[f + d + i], new[f + 2 * d + i] = old[f + d + i], old[f + 2 * d + i], y
        p.middle[i] = (old[f + i] + y + 3.0 * (old[f + d + i] + old[f + 2 * d + i])) / 8.0
        p.rate[i] = (y - old[f + i]) / (3.0 * p.dt)


@inner
def weighing_rows(p: KernelPlan, old: Numbers, new: Numbers, out: Numbers, first: Count) -> None:
    """Compute S (d/dt L momentum + L static) of all columns and S L of the torques (`FilteredRegressor`)."""
    size, s = p.r * p.k, 6 * p.d
    if first:
        for i in range(p.used_size):
            begin(p, old, s + p.used[i], size, p.static[p.used[i]], p.momentum[p.used[i]])
        for r in range(p.r):
            begin(p, old, s + 3 * size + r, p.r, p.torque[r], 0.0)
    low_passes(p, old, new, out)
    o = s + 3 * size
    for r in range(p.r):
        x = p.torque[r]
        y = old[o + r] + p.mean[0] * x
        out[size + r] = y
        new[o + r] = p.mean[1] * x + old[o + p.r + r] - p.mean[4] * y
        new[o + p.r + r] = p.mean[2] * x + old[o + 2 * p.r + r] - p.mean[5] * y
        new[o + 2 * p.r + r] = p.mean[3] * x - p.mean[6] * y


@inner
def begin(p: KernelPlan, old: Numbers, s: Count, apart: Count, static: Number, momentum: Number) -> None:
    """Set the state before the first sample, at `s`, `s + apart` and `s + 2 apart`: the momentum settled, the others at
    zero."""
    for i in range(3):
        old[s + i * apart] = p.begun[i] * static + p.rest[i] * momentum


@inner
def low_passes(p: KernelPlan, old: Numbers, new: Numbers, out: Numbers) -> None:
    """Apply the low-pass of third order to every column that can differ from zero."""
    b0, b1, b2, b3, a1, a2, a3 = p.mean[0], p.mean[1], p.mean[2], p.mean[3], p.mean[4], p.mean[5], p.mean[6]
    rise, fall, size, s = p.slope[0], p.slope[1], p.r * p.k, 6 * p.d
    used, static, momentum = p.used, p.static, p.momentum
    for i in range(p.used_size):
        e = used[i]
        o, x, m = s + e, static[e], momentum[e]
        y = old[o] + rise * m + b0 * x
        out[e] = y
        new[o] = b1 * x + old[o + size] - a1 * y
        new[o + size] = b2 * x + old[o + 2 * size] - a2 * y
        new[o + 2 * size] = b3 * x - a3 * y + fall * m


@inner
def wait(p: KernelPlan, old: Numbers, new: Numbers, out: Numbers) -> None:
    """Count the steps for which each row is not used yet, and store the cylinders' speed."""
    s = 6 * p.d + 3 * p.r * p.k + 3 * p.r
    o = 3 * p.r * p.k + 2 * p.r + p.c + p.c * p.r + 4
    for r in range(p.r):
        new[s + r] = old[s + r] - 1.0 if old[s + r] > 1.0 else 0.0
        for c in range(p.c):
            if p.acting[r * p.c + c] and not p.good[c]:
                new[s + r] = p.waits
        out[o + r] = 1.0 if new[s + r] == 0.0 else 0.0
    for c in range(p.c):
        new[s + p.r + c], out[o + p.r + c] = p.speed[c], p.speed[c]


@inner
def instant_forces(p: KernelPlan, old: Numbers, here: Numbers, new: Numbers, out: Numbers, first: Count) -> None:
    """Compute torques, levers and reversing cylinders of the instant: forces after their own low-pass."""
    s = 6 * p.d + 3 * p.r * p.k + 4 * p.r  # speed, then the low-pass of the forces
    a = s + 3 * p.c + 3 * p.r * p.k  # that of the acceleration
    torque, lever = 2 * p.r * p.k + p.r, 3 * p.r * p.k + 2 * p.r + p.c
    for c in range(p.c):
        x, now = here[p.n + c], p.speed[c]
        one, two, before, slow = old[s + p.c + c], old[s + 2 * p.c + c], old[s + c], old[a + c]
        if first:
            one, two, before, slow = p.settled[0] * x, p.settled[1] * x, now, 0.0
        force = one + p.quick[0] * x
        new[s + p.c + c] = p.quick[1] * x + two - p.quick[3] * force
        new[s + 2 * p.c + c] = p.quick[2] * x - p.quick[4] * force
        change = (now - before) / p.dt
        acceleration = slow + p.slow[0] * change
        new[a + c] = p.slow[1] * change - p.slow[2] * acceleration
        if abs(acceleration) > STARTING and now * (now + AHEAD_S * acceleration) < 0.0:
            out[lever - p.c + c] = 1.0
        for j in range(p.n):
            if p.row[j] >= 0:
                out[lever + c * p.r + p.row[j]] = p.lever[c * p.n + j]
                out[torque + p.row[j]] += force * p.lever[c * p.n + j]


@inner
def instant_columns(p: KernelPlan, old: Numbers, new: Numbers, out: Numbers, first: Count) -> None:
    """Compute the columns of the instant, static ones and the rate of momentum after its own low-pass, and their rate
    of change."""
    size, dt = p.r * p.k, p.dt
    s = 6 * p.d + 3 * size + 4 * p.r + 3 * p.c  # last momentum, low-pass of its rate, last rate
    now, change = size + p.r, 2 * size + 2 * p.r
    b0, b1, a1 = p.slow[0], p.slow[1], p.slow[2]
    used, moved, static, momentum = p.used, p.moved, p.static, p.momentum
    for i in range(p.used_size):
        out[now + used[i]] = static[used[i]]
    for i in range(p.moved_size):
        e = moved[i]
        o, m = s + e, momentum[e]
        if first:
            old[o], old[o + size], old[o + 2 * size] = m, 0.0, 0.0
        x = (m - old[o]) / dt
        rate = old[o + size] + b0 * x
        new[o] = m
        new[o + size] = b1 * x - a1 * rate
        new[o + 2 * size] = rate
        out[now + e] += rate
        out[change + e] = (rate - old[o + 2 * size]) / dt


def slips(
    p: KernelPlan, channels: Numbers, values: Numbers, turned: Counts, size: Count, by: Number, out: Numbers
) -> None:
    """Set `out` (R, A) to the torque that a reading of a joint too large by one radian adds to the residual of gravity.

    channels: (D,) at which it is computed
    values:   (P,) parameters
    turned:   (A,) joints
    size:     A
    by:       error of the reading by which it is computed [rad]
    """
    for s in range(size + 1):
        for j in range(p.n):
            p.middle[j] = channels[j] + (by if s > 0 and turned[max(s - 1, 0)] == j else 0.0)
            p.rate[j] = 0.0
        set_links(p, channels[p.d - 3], 0.0)
        for c in range(p.c):
            stretch(p, c)
        held = 0.0
        for j in range(p.n - 1, -1, -1):
            own = values[3 * j + 1] * p.level[2 * j] - values[3 * j + 2] * p.level[2 * j + 1]
            held += p.gravity * cos(channels[p.d - 2]) * own
            if p.row[j] >= 0:
                left = -held
                for c in range(p.c):
                    left += channels[p.n + c] * p.lever[c * p.n + j]
                if s == 0:
                    p.torque[p.row[j]] = left
                else:
                    out[p.row[j] * size + s - 1] = (left - p.torque[p.row[j]]) / by


def moves(speed: Numbers, size: Count, least: Number, by: Counts, signals: Count, found: Numbers) -> None:
    """Set `found` (signals,) to 1 where the cylinder that changes a signal is faster than `least`.

    speed: (size,) of the cylinders [m/s]
    by:    (signals,) cylinder that changes each signal; -1: any of them
    """
    shaken = 0.0
    for c in range(size):
        if abs(speed[c]) > least:
            shaken = 1.0
    for k in range(signals):
        if by[k] < 0:
            found[k] = shaken
        else:
            found[k] = 1.0 if abs(speed[by[k]]) > least else 0.0


@inner
def tool(p: KernelPlan, out: Numbers) -> None:
    """Compute place and velocity of the tool, x and z, in true horizontal and vertical."""
    o = 3 * p.r * p.k + 2 * p.r + p.c + p.c * p.r
    for j in range(p.n):
        t, u = p.level[2 * j], p.level[2 * j + 1]
        x, z = p.arm[2 * j] * t - p.arm[2 * j + 1] * u, p.arm[2 * j] * u + p.arm[2 * j + 1] * t
        out[o] += x
        out[o + 1] += z
        out[o + 2] -= z * p.qd[j]
        out[o + 3] += x * p.qd[j]
