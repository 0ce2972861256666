"""What a second of motion tells of each signal's error: `service.plausibility.blocks` and `unnoticed`, in plain
numbers."""

from math import cos, sin

from cylforce.estimation.kernel.plan import KernelPlan
from cylforce.estimation.kernel.pushed import invert
from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers
from cylforce.estimation.kernel.solver import KernelSolver

OF_LOAD: Count = 4  # parameters of a load


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
    s: KernelSolver,
    lift: Numbers,
    running: Numbers,
    size: Count,
    prior: Numbers,
    memory: Number,
    errors: Count,
    slopes: Numbers,
) -> None:
    """Of rows (size, size) of a `lift` and of the block that is `running`, over `memory`: change of the load's mass,
    beside its `prior` information (4,), per unit of each of the `errors` (`slopes`), which stand before the last
    column."""
    square, inverse = s.square, s.other
    for i in range(OF_LOAD):
        for j in range(i + 1):
            square[OF_LOAD * i + j] = (lift[i * size + j] + running[i * size + j]) / memory
        square[OF_LOAD * i + i] += prior[i]
    invert(square, OF_LOAD, inverse, 0)
    first = size - 1 - errors
    for h in range(errors):
        total = 0.0
        for i in range(OF_LOAD):
            at = i * size + first + h
            total += inverse[i] * ((lift[at] + running[at]) / memory)
        slopes[h] = total
