"""Filtered rows from the channels of one sample, one fixed step at a time, as `Channels` and `FilteredRegressor`
compute them along a recording; and the rows of the instant (`fast.py`).

Sizes: N joints, C cylinders, R rows (measured torques), K columns of all effects, D channels (joint angles, cylinder
forces, motion of the base). All filters are in transposed direct form II: y = state[0] + b0 x, state[i] <- state[i + 1]
+ b(i + 1) x - a(i + 1) y.

The state of the filters is one array, which the functions call `old` before a step and `new` after it:
channels: last ones (D,), state of their low-pass (2, D), its last three outputs (3, D), oldest first
columns:  state of their low-pass (3, R K), and of that of the torques (3, R)
rows:     steps for which each row is not used yet (R,)
instant:  last speed of the cylinders (C,) [m/s], state of the low-pass of the forces (2, C), last momentum columns
          (R K), state of the low-pass of their rate (R K), last rate (R K), state of the low-pass of the acceleration
          (C,)

The first functions below give the places of these parts, and of those of the rows of a step."""

from math import cos

from cylforce.estimation.kernel.bodies import move_cylinder, set_links
from cylforce.estimation.kernel.columns import columns
from cylforce.estimation.kernel.plan import KernelPlan
from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, inner

AHEAD_S: Number = 0.06  # s by which a reversal of a cylinder is predicted: the delay of its measured speed; measured
STARTING: Number = 0.03  # m/s^2 of a cylinder, below which a change of sign is noise at rest; chosen


@inner
def state_columns(p: KernelPlan) -> Count:
    """Return the place in the state of the low-pass of the columns (3, R K)."""
    return 6 * p.d


@inner
def state_torques(p: KernelPlan) -> Count:
    """Return the place in the state of the low-pass of the torques (3, R)."""
    return 6 * p.d + 3 * p.r * p.k


@inner
def state_waiting(p: KernelPlan) -> Count:
    """Return the place in the state of the steps for which each row is not used yet (R,)."""
    return 6 * p.d + 3 * p.r * p.k + 3 * p.r


@inner
def state_speed(p: KernelPlan) -> Count:
    """Return the place in the state of the last speed of the cylinders (C,) [m/s]."""
    return state_waiting(p) + p.r


@inner
def state_forces(p: KernelPlan) -> Count:
    """Return the place in the state of the low-pass of the forces (2, C)."""
    return state_speed(p) + p.c


@inner
def state_momentum(p: KernelPlan) -> Count:
    """Return the place in the state of the last momentum columns, the low-pass of their rate, and its last output."""
    return state_speed(p) + 3 * p.c


@inner
def state_acceleration(p: KernelPlan) -> Count:
    """Return the place in the state of the low-pass of the cylinders' acceleration (C,)."""
    return state_momentum(p) + 3 * p.r * p.k


def state_size(p: KernelPlan) -> Count:
    """Return the number of numbers in a state."""
    return 6 * p.d + 6 * p.r * p.k + 4 * p.r + 4 * p.c


@inner
def row_torques(p: KernelPlan) -> Count:
    """Return the place in the rows of the torques (R,) for the weighing; their columns (R, K) come first."""
    return p.r * p.k


@inner
def row_now_columns(p: KernelPlan) -> Count:
    """Return the place in the rows of the columns (R, K) of the instant."""
    return p.r * p.k + p.r


@inner
def row_now_torques(p: KernelPlan) -> Count:
    """Return the place in the rows of the torques (R,) of the instant [N m]."""
    return 2 * p.r * p.k + p.r


@inner
def row_change(p: KernelPlan) -> Count:
    """Return the place in the rows of the rate of change (R, K) of the columns of inertia [1/s]."""
    return 2 * p.r * p.k + 2 * p.r


@inner
def row_reversing(p: KernelPlan) -> Count:
    """Return the place in the rows of 1 (C,) where a cylinder is about to reverse."""
    return 3 * p.r * p.k + 2 * p.r


@inner
def row_levers(p: KernelPlan) -> Count:
    """Return the place in the rows of the levers (C, R) [m/rad]."""
    return row_reversing(p) + p.c


@inner
def row_tool(p: KernelPlan) -> Count:
    """Return the place in the rows of place x, z [m] and velocity x, z [m/s] of the tool."""
    return row_levers(p) + p.c * p.r


@inner
def row_usable(p: KernelPlan) -> Count:
    """Return the place in the rows of 1 (R,) where a row can be used; the speed (C,) of the cylinders follows."""
    return row_tool(p) + 4


def rows_size(p: KernelPlan) -> Count:
    """Return the number of numbers in the rows of a step.

    weighing:  columns (R, K) and torques (R,)
    instant:   columns (R, K) and torques (R,), rate of change of the columns (R, K)
    cylinders: whether each reverses (C,), levers (C, R)
    tool:      place and velocity (4,)
    usable:    which rows are usable (R,)
    speed:     of the cylinders (C,)
    """
    return 3 * p.r * p.k + 3 * p.r + 2 * p.c + p.c * p.r + 4


def advance(p: KernelPlan, old: Numbers, channels: Numbers, new: Numbers, out: Numbers, first: Count) -> None:
    """Compute the rows of one step, torque = columns @ parameters: slow ones for weighing, and those of the instant.

    first: 1 where the filters of columns and forces begin with this step, else 0

    Read:
    channels: (D,) channels of the sample: joint angles [rad], cylinder forces [N], motion of the base

    Read and, if `first`, written:
    old:      state of the filters before the step (`state_size` numbers), or that in which they begin

    Written:
    new:      state of the filters after the step; zero before
    out:      rows of the step (`layout.RowLayout`); zero before
    """
    smooth_channels(p, old, channels, new)
    columns(p)
    weighing_rows(p, old, new, out, first)
    count_waiting(p, old, new, out)
    instant_forces(p, old, channels, new, out, first)
    instant_columns(p, old, new, out, first)
    tool_motion(p, out)


@inner
def smooth_channels(p: KernelPlan, old: Numbers, channels: Numbers, new: Numbers) -> None:
    """Filter the channels by a low-pass of second order, and compute mean and slope of its last four outputs.

    The mean is (y0 + 3 y1 + 3 y2 + y3) / 8, the slope (y3 - y0) / (3 dt), y0 the oldest (`filters.mean`, `slope`).

    Read:
    channels: (D,) channels of the sample: joint angles [rad], cylinder forces [N], motion of the base
    old:      state of the filters, which begins with last channels (D,), state of the low-pass (2, D), last three
              outputs (3, D), oldest first

    Written:
    new:      the same parts of the state after the sample
    `p.middle` (D,) mean, and `p.rate` (D,) slope per second
    """
    d = p.d
    low_pass, outputs = d, 3 * d  # places in the state
    b0, b1, b2, a1, a2 = p.channel[0], p.channel[1], p.channel[2], p.channel[3], p.channel[4]
    for i in range(d):
        x = channels[i]
        y = old[low_pass + i] + b0 * x
        new[i] = x
        new[low_pass + i] = b1 * x + old[low_pass + d + i] - a1 * y
        new[low_pass + d + i] = b2 * x - a2 * y
        y0, y1, y2 = old[outputs + i], old[outputs + d + i], old[outputs + 2 * d + i]
        new[outputs + i], new[outputs + d + i], new[outputs + 2 * d + i] = y1, y2, y
        p.middle[i] = (y0 + y + 3.0 * (y1 + y2)) / 8.0
        p.rate[i] = (y - y0) / (3.0 * p.dt)


@inner
def weighing_rows(p: KernelPlan, old: Numbers, new: Numbers, out: Numbers, first: Count) -> None:
    """Compute the rows for the weighing: S (d/dt L momentum + L static) of all columns, and S L of the torques.

    L is a low-pass of first order, S one of second order; `p.mean` holds their product S L, of third order. Columns and
    torques pass the same filter, so that torque = columns @ parameters remains true (`FilteredRegressor`).

    first: 1 where the filters begin with this step, else 0

    Read: `p.momentum` and `p.static` (R, K), `p.torque` (R,) [N m], not filtered

    Read and, if `first`, written:
    old:   state of the filters, of which the low-pass of the columns (3, R K) and of the torques (3, R) are used

    Written:
    new:   the same parts of the state after the step
    out:   begins with the columns (R, K) and torques (R,) [N m]
    """
    if first:
        size = p.r * p.k
        for i in range(p.used_size):
            begin_low_pass(p, old, state_columns(p) + p.used[i], size, p.static[p.used[i]], p.momentum[p.used[i]])
        for r in range(p.r):
            begin_low_pass(p, old, state_torques(p) + r, p.r, p.torque[r], 0.0)
    low_passes(p, old, new, out)
    b0, b1, b2, b3, a1, a2, a3 = p.mean[0], p.mean[1], p.mean[2], p.mean[3], p.mean[4], p.mean[5], p.mean[6]
    for r in range(p.r):
        state, x = state_torques(p) + r, p.torque[r]
        y = old[state] + b0 * x
        out[row_torques(p) + r] = y
        new[state] = b1 * x + old[state + p.r] - a1 * y
        new[state + p.r] = b2 * x + old[state + 2 * p.r] - a2 * y
        new[state + 2 * p.r] = b3 * x - a3 * y


@inner
def begin_low_pass(p: KernelPlan, old: Numbers, state: Count, stride: Count, static: Number, momentum: Number) -> None:
    """Set the state of a low-pass of third order before its first sample.

    The filter of the momentum is then settled at its first input; that of the static part begins as after an input of
    zeros (`FilteredRegressor`).

    state:    place in `old` of the first of the three numbers
    stride:   from one of them to the next
    static:   first static input
    momentum: first momentum

    Written:
    old:      state of the filters, at `state`, `state + stride` and `state + 2 stride`
    """
    for i in range(3):
        old[state + i * stride] = p.begun[i] * static + p.rest[i] * momentum


@inner
def low_passes(p: KernelPlan, old: Numbers, new: Numbers, out: Numbers) -> None:
    """Apply the low-pass of third order to every column that can differ from zero.

    The static part passes `p.mean` (b0 to b3, a1 to a3); the momentum passes `p.slope` of the same denominator, which
    is also its derivative.

    Read:
    old: state of the filters, of which the low-pass (3, R K) of the columns is used
    `p.static` and `p.momentum` (R, K), at the places `p.used`

    Written:
    new: the same part of the state after the step
    out: begins with the filtered columns (R, K)
    """
    b0, b1, b2, b3, a1, a2, a3 = p.mean[0], p.mean[1], p.mean[2], p.mean[3], p.mean[4], p.mean[5], p.mean[6]
    rise, fall, size, first = p.slope[0], p.slope[1], p.r * p.k, state_columns(p)
    used, static, momentum = p.used, p.static, p.momentum
    for i in range(p.used_size):
        place = used[i]
        state, x, m = first + place, static[place], momentum[place]
        y = old[state] + rise * m + b0 * x
        out[place] = y
        new[state] = b1 * x + old[state + size] - a1 * y
        new[state + size] = b2 * x + old[state + 2 * size] - a2 * y
        new[state + 2 * size] = b3 * x - a3 * y + fall * m


@inner
def count_waiting(p: KernelPlan, old: Numbers, new: Numbers, out: Numbers) -> None:
    """Count the steps for which each row is not used yet, and store the cylinders' speed.

    A row waits for `p.waits` steps after a cylinder that acts on it could not be used (dead point, end stop), because
    the filters still contain its lever.

    Read:
    old: state of the filters, of which the steps (R,) are used
    `p.good` (C,) 1 where a cylinder can be used, `p.acting` (R, C), `p.speed` (C,) [m/s]

    Written:
    new: steps (R,) after this one, speed of the cylinders (C,) [m/s]
    out: 1 where a row is usable, else 0 (R,); then the speed (C,)
    """
    waiting, usable = state_waiting(p), row_usable(p)
    for r in range(p.r):
        new[waiting + r] = old[waiting + r] - 1.0 if old[waiting + r] > 1.0 else 0.0
        for c in range(p.c):
            if p.acting[r * p.c + c] and not p.good[c]:
                new[waiting + r] = p.waits
        out[usable + r] = 1.0 if new[waiting + r] == 0.0 else 0.0
    for c in range(p.c):
        new[state_speed(p) + c], out[usable + p.r + c] = p.speed[c], p.speed[c]


@inner
def instant_forces(p: KernelPlan, old: Numbers, channels: Numbers, new: Numbers, out: Numbers, first: Count) -> None:
    """Compute torques, levers and reversing cylinders of the instant.

    The forces pass a quick low-pass of second order of their own. A cylinder is about to reverse if its speed, changed
    for AHEAD_S at its low-passed acceleration, has the other sign, and that acceleration exceeds STARTING either way.

    first: 1 where the filters begin with this step, else 0

    Read:
    old:      state of the filters, of which the speed (C,), the low-pass of the forces (2, C) and that of the
              acceleration (C,) are used
    channels: (D,) channels of the sample, of which the cylinder forces (C,) [N] follow the N angles
    `p.speed` (C,) [m/s], `p.lever` (C, N) [m/rad]

    Written:
    new:      state of both low-passes after the step
    out:      torques of the instant (R,) [N m], 1 where a cylinder is about to reverse (C,), levers (C, R) [m/rad];
              zero before
    """
    forces, accelerations = state_forces(p), state_acceleration(p)
    for c in range(p.c):
        x, speed = channels[p.n + c], p.speed[c]
        state_0, state_1 = old[forces + c], old[forces + p.c + c]
        before, slow_state = old[state_speed(p) + c], old[accelerations + c]
        if first:
            state_0, state_1, before, slow_state = p.settled[0] * x, p.settled[1] * x, speed, 0.0
        force = state_0 + p.quick[0] * x  # `quick`: b0, b1, b2, a1, a2
        new[forces + c] = p.quick[1] * x + state_1 - p.quick[3] * force
        new[forces + p.c + c] = p.quick[2] * x - p.quick[4] * force
        change = (speed - before) / p.dt
        acceleration = slow_state + p.slow[0] * change  # `slow`: b0, b1, a1
        new[accelerations + c] = p.slow[1] * change - p.slow[2] * acceleration
        if abs(acceleration) > STARTING and speed * (speed + AHEAD_S * acceleration) < 0.0:
            out[row_reversing(p) + c] = 1.0
        for j in range(p.n):
            if p.row[j] >= 0:
                out[row_levers(p) + c * p.r + p.row[j]] = p.lever[c * p.n + j]
                out[row_now_torques(p) + p.row[j]] += force * p.lever[c * p.n + j]


@inner
def instant_columns(p: KernelPlan, old: Numbers, new: Numbers, out: Numbers, first: Count) -> None:
    """Compute the columns of the instant, and their rate of change.

    A column is its static part, not filtered, and the rate of its momentum after a low-pass of first order of its own.
    The rate of change is that of the momentum's part.

    first: 1 where the filters begin with this step, else 0

    Read: `p.static` and `p.momentum` (R, K), at the places `p.used` and `p.moved`

    Read and, if `first`, written:
    old:   state of the filters, of which the last momentum (R K), the low-pass of its rate (R K) and the last rate (R
           K) are used

    Written:
    new:   the same parts of the state after the step
    out:   columns of the instant (R, K), their rate of change (R, K) [1/s]
    """
    size, dt, last = p.r * p.k, p.dt, state_momentum(p)
    now, change = row_now_columns(p), row_change(p)
    b0, b1, a1 = p.slow[0], p.slow[1], p.slow[2]
    used, moved, static, momentum = p.used, p.moved, p.static, p.momentum
    for i in range(p.used_size):
        out[now + used[i]] = static[used[i]]
    for i in range(p.moved_size):
        place = moved[i]
        state, m = last + place, momentum[place]  # three numbers, `size` apart: momentum, low-pass, rate
        if first:
            old[state], old[state + size], old[state + 2 * size] = m, 0.0, 0.0
        x = (m - old[state]) / dt
        rate = old[state + size] + b0 * x
        new[state] = m
        new[state + size] = b1 * x - a1 * rate
        new[state + 2 * size] = rate
        out[now + place] += rate
        out[change + place] = (rate - old[state + 2 * size]) / dt


def angle_error_torques(
    p: KernelPlan, channels: Numbers, values: Numbers, joints: Counts, size: Count, step: Number, torques: Numbers
) -> None:
    """Compute the error of the residual torque of a machine at rest by a reading of a joint's angle that is too large.

    The residual torque is that of the cylinder forces less that of gravity. Its finite difference is taken, with one
    angle after the other larger by `step`; the links beyond are then turned, too.

    size:     A, number of joints
    step:     error of an angle in the finite difference [rad]

    Read:
    channels: (D,) at which it is computed: joint angles [rad], cylinder forces [N], ..., pitch, roll [rad], slew rate
    values:   (P,) parameters, which begin with J, X, Z [kg m^2, kg m, kg m] of each link
    joints:   (A,) numbers of the joints with an error

    Written:
    torques:  (R, A) torque per error [N m/rad]
    `p`'s room for motion, levers and torques
    """
    for s in range(size + 1):  # 0: without an error
        for j in range(p.n):
            p.middle[j] = channels[j] + (step if s > 0 and joints[max(s - 1, 0)] == j else 0.0)
            p.rate[j] = 0.0
        set_links(p, channels[p.d - 3], 0.0)
        for c in range(p.c):
            move_cylinder(p, c)
        gravity = 0.0  # of the links from j outwards
        for j in range(p.n - 1, -1, -1):
            own = values[3 * j + 1] * p.level[2 * j] - values[3 * j + 2] * p.level[2 * j + 1]
            gravity += p.gravity * cos(channels[p.d - 2]) * own
            if p.row[j] >= 0:
                residual = -gravity
                for c in range(p.c):
                    residual += channels[p.n + c] * p.lever[c * p.n + j]
                if s == 0:
                    p.torque[p.row[j]] = residual
                else:
                    torques[p.row[j] * size + s - 1] = (residual - p.torque[p.row[j]]) / step


def moving_signals(
    speed: Numbers, size: Count, least: Number, by: Counts, signals: Count, should_change: Numbers
) -> None:
    """Compute which signals should change, because the cylinder that changes them moves.

    size:    C, number of cylinders
    least:   speed above which a cylinder moves [m/s]
    signals: S, number of signals

    Read:
    speed:         (C,) of the cylinders [m/s]
    by:            (S,) number of the cylinder that changes each signal; -1: any of them

    Written:
    should_change: (S,) 1 where the cylinder moves, else 0
    """
    any_moves = 0.0
    for c in range(size):
        if abs(speed[c]) > least:
            any_moves = 1.0
    for k in range(signals):
        if by[k] < 0:
            should_change[k] = any_moves
        else:
            should_change[k] = 1.0 if abs(speed[by[k]]) > least else 0.0


@inner
def tool_motion(p: KernelPlan, out: Numbers) -> None:
    """Compute place and velocity of the tool relative to the first pin, in true horizontal and vertical.

    Read: `p.level` (N, 2) cosine and sine of each link's angle from the true horizontal, `p.qd` (N,) its rate [rad/s],
    `p.arm` (N, 2) from each link's pin to the next one, or to the tool [m]

    Written:
    out: rows of the step, of which place x, z [m] and velocity x, z [m/s] are set; zero before
    """
    place = row_tool(p)
    velocity = place + 2
    for j in range(p.n):
        cosine, sine = p.level[2 * j], p.level[2 * j + 1]
        x, z = p.arm[2 * j] * cosine - p.arm[2 * j + 1] * sine, p.arm[2 * j] * sine + p.arm[2 * j + 1] * cosine
        out[place] += x
        out[place + 1] += z
        out[velocity] -= z * p.qd[j]
        out[velocity + 1] += x * p.qd[j]
