"""From the channels of one sample to filtered rows: what `Channels` and `FilteredRegressor` do along a recording, one
fixed step at a time; and the rows of the instant (`fast.py`).

The state of the filters is one array: channels (D), their low-pass (2, D) and its last outputs (3, D); low-pass of the
columns (3, R K) and torques (3, R); for each row the steps that it waits (R); speed of the cylinders (C); for the
instant: low-pass of the forces (2, C), last momentum, low-pass of its rate and last rate (R K each), low-pass of the
acceleration (C)."""

from cylforce.estimation.kernel.columns import columns
from cylforce.estimation.kernel.plan import KernelPlan
from cylforce.estimation.kernel.restricted import Count, Number, Numbers, inner

AHEAD_S: Number = 0.06  # s by which a reversal of a cylinder is looked for, the delay of its measured speed; measured
STARTING: Number = 0.03  # m/s^2 of a cylinder, below which a change of sign is noise at rest; chosen


def state_size(p: KernelPlan) -> Count:
    """Numbers of a state."""
    return 6 * p.d + 6 * p.r * p.k + 4 * p.r + 4 * p.c


def rows_size(p: KernelPlan) -> Count:
    """Numbers of the rows of a step: columns (R, K) and torques (R) for the weighing, the same of this instant; rate of
    change of the columns (R, K); for each cylinder whether it reverses (C); levers (C, R); place and velocity of the
    tool (4)."""
    return 3 * p.r * p.k + 2 * p.r + p.c + p.c * p.r + 4


def advance(p: KernelPlan, old: Numbers, here: Numbers, new: Numbers, out: Numbers, first: Count) -> None:
    """State `new` and rows `out` (both zero before) after the state `old` and the channels `here` (D,); `first`: the
    filters of columns and forces begin with this step."""
    smooth(p, old, here, new)
    columns(p)
    weighing_rows(p, old, new, out, first)
    wait(p, old, new)
    instant_forces(p, old, here, new, out, first)
    instant_columns(p, old, new, out, first)
    tool(p, out)


@inner
def smooth(p: KernelPlan, old: Numbers, here: Numbers, new: Numbers) -> None:
    """Low-pass of the channels; mean and slope of four samples (`filters.mean`, `filters.slope`)."""
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
    """S (d/dt L momentum + L static) of all columns and S L of the torques (`FilteredRegressor`)."""
    size = p.r * p.k
    s = 6 * p.d
    for i in range(p.used_size):
        e = p.used[i]
        low_pass(p, old, new, out, s + e, size, e, p.static[e], p.momentum[e], first)
    s += 3 * size
    for r in range(p.r):
        low_pass(p, old, new, out, s + r, p.r, size + r, p.torque[r], 0.0, first)


@inner
def low_pass(
    p: KernelPlan,
    old: Numbers,
    new: Numbers,
    out: Numbers,
    s: Count,
    apart: Count,
    e: Count,
    static: Number,
    momentum: Number,
    first: Count,
) -> None:
    """One column: third order, state at `s`, `s + apart` and `s + 2 apart`, output at `e`."""
    a, b, c = old[s], old[s + apart], old[s + 2 * apart]
    if first:
        a = p.begun[0] * static + p.rest[0] * momentum
        b = p.begun[1] * static + p.rest[1] * momentum
        c = p.begun[2] * static + p.rest[2] * momentum
    y = a + p.slope[0] * momentum + p.mean[0] * static
    out[e] = y
    new[s] = p.mean[1] * static + b - p.mean[4] * y
    new[s + apart] = p.mean[2] * static + c - p.mean[5] * y
    new[s + 2 * apart] = p.mean[3] * static - p.mean[6] * y + p.slope[1] * momentum


@inner
def wait(p: KernelPlan, old: Numbers, new: Numbers) -> None:
    """Steps for which each row is not used yet, and the cylinders' speed."""
    s = 6 * p.d + 3 * p.r * p.k + 3 * p.r
    for r in range(p.r):
        new[s + r] = old[s + r] - 1.0 if old[s + r] > 1.0 else 0.0
        for c in range(p.c):
            if p.acting[r * p.c + c] and not p.good[c]:
                new[s + r] = p.waits
    for c in range(p.c):
        new[s + p.r + c] = p.speed[c]


@inner
def instant_forces(p: KernelPlan, old: Numbers, here: Numbers, new: Numbers, out: Numbers, first: Count) -> None:
    """Torques, levers and reversing cylinders of the instant: forces after their own low-pass."""
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
    """Columns of the instant: static ones and the rate of momentum after its own low-pass; how fast that changes."""
    size = p.r * p.k
    s = 6 * p.d + 3 * size + 4 * p.r + 3 * p.c  # last momentum, low-pass of its rate, last rate
    now, change = size + p.r, 2 * size + 2 * p.r
    for i in range(p.used_size):
        out[now + p.used[i]] = p.static[p.used[i]]
    for i in range(p.moved_size):
        e = p.moved[i]
        m = p.momentum[e]
        before, slow, last = old[s + e], old[s + size + e], old[s + 2 * size + e]
        if first:
            before, slow, last = m, 0.0, 0.0
        x = (m - before) / p.dt
        rate = slow + p.slow[0] * x
        new[s + e] = m
        new[s + size + e] = p.slow[1] * x - p.slow[2] * rate
        new[s + 2 * size + e] = rate
        out[now + e] += rate
        out[change + e] = (rate - last) / p.dt


@inner
def tool(p: KernelPlan, out: Numbers) -> None:
    """Place and velocity of the tool, x and z, in true horizontal and vertical."""
    o = 3 * p.r * p.k + 2 * p.r + p.c + p.c * p.r
    for j in range(p.n):
        t, u = p.level[2 * j], p.level[2 * j + 1]
        x, z = p.arm[2 * j] * t - p.arm[2 * j + 1] * u, p.arm[2 * j] * u + p.arm[2 * j + 1] * t
        out[o] += x
        out[o + 1] += z
        out[o + 2] -= z * p.qd[j]
        out[o + 3] += x * p.qd[j]
