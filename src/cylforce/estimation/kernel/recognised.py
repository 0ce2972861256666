"""What a block of motion tells of whose machine it is: `service.recognition`, in plain numbers."""

from math import sqrt

from cylforce.estimation.kernel.pushed import own_columns
from cylforce.estimation.kernel.restricted import Count, Number, Numbers
from cylforce.estimation.kernel.solver import KernelSolver
from cylforce.estimation.kernel.weighed import add, loaded, quadratic


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
