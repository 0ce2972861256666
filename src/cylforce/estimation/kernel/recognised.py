"""What a block of motion tells: of whose machine it is (`service.recognition`), and of each signal's error
(`service.plausibility.blocks` and `unnoticed`), in plain numbers."""

from math import cos, sin, sqrt

from cylforce.estimation.kernel.plan import KernelPlan
from cylforce.estimation.kernel.pushed import own_columns
from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers
from cylforce.estimation.kernel.solver import KernelSolver, invert
from cylforce.estimation.kernel.weighed import add, loaded, quadratic

OF_LOAD: Count = 4  # parameters of a load


def gather(
    s: KernelSolver,
    rows: Numbers,
    left: Numbers,
    usable: Numbers,
    change: Numbers,
    errors: Numbers,
    number: Count,
    memory: Number,
    gram: Numbers,
) -> Count:
    """The gram (K, K) becomes that with the rows of one instant that are usable and in motion, [load | changes in units
    of `change` (D,) | a `number` of `errors` (R, H) | torque left], in units of their standard errors, over `memory`;
    how many these are. `rows` and `left` as of `weighed.explain`."""
    telling = 0
    for r in range(s.r):
        telling += usable[r] != 0.0 and left[2 * s.r + r] < left[s.r + r]
    if telling == 0:
        return 0
    size = 5 + s.d + number
    own_columns(s, rows, 0)
    loaded(s, s.own, s.p, s.spread)
    for r in range(s.r):
        variance, rest = left[s.r + r], left[2 * s.r + r]
        if usable[r] != 0.0 and rest < variance:
            x = s.other
            unsure = quadratic(s, s.covariance, 0, s.p, s.own, r * s.p)
            weight = 1.0 / sqrt((variance + rest + unsure) * memory)
            for i in range(4):
                x[i] = s.spread[4 * r + i] * weight
            for i in range(s.d):
                x[4 + i] = rows[r * s.k + s.changing[i]] * change[i] * weight
            for h in range(number):
                x[4 + s.d + h] = errors[r * number + h] * weight
            x[size - 1] = left[r] * weight
            for i in range(size):
                if x[i] != 0.0:
                    add(gram, i * size, x[i], x, 0, size)
    return telling


def turn_force(
    p: KernelPlan, channels: Numbers, x: Number, z: Number, turned: Counts, angles: Count, begin: Count, out: Numbers
) -> None:
    """`out` (R, begin + angles): of each of `angles` joints `turned`, whose angle is read too large by one radian, the
    torque that it seems to take from a force x, z [N] at the tool, at the channels (D,): the force turned about the
    farther one of the row's joint and that one."""
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


def notice(
    lift: Numbers,
    running: Numbers,
    size: Count,
    prior: Numbers,
    memory: Number,
    errors: Count,
    work: Numbers,
    slopes: Numbers,
) -> None:
    """Of rows (size, size) of a `lift` and of the block that is `running`, over `memory`: change of the load's mass,
    beside its `prior` information (4,), per unit of each of the `errors` (`slopes`), which stand before the last
    column. `work`: 32 numbers."""
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
