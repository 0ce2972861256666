"""What is usual for a type of machine: by how much machines in order differ from each other, each from day to day, and
within a day.

A quantity of a machine is m + b, on a day m + b + d, in a minute of it m + b + d + w, with b, d and w normal of
variances that are to be found for each quantity: by expectation maximisation (Dempster, Laird, Rubin 1977), level by
level, from the innermost on. What is stated beforehand counts as much as PRIOR_COUNT things that were seen. With it the
rounds are those of MacKay (1992), which lead to the same variances in a third of the time; without it they could run
to zero."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.fleet.gaussians import Belonging, Beside, in_turn, loosened, pieces, solved
from cylforce.signals.estimate import Array

PRIOR_COUNT = 4.0  # things seen, to which the stated spread amounts; chosen: three machines change it, one hardly does
ROUNDS = 40  # at most
FEWEST = 3  # machines, up to which their spread is the stated one
SETTLED = 0.01  # relative change of a standard deviation, below which it ends
MOST = 320  # things of a level from which its spread is told, evenly taken: then it is known to some four per cent
WITHIN = 1.0 / 3.0  # of what differs from day to day, before anything is seen; chosen


class Usual(NamedTuple):
    """Of a type's quantities (K,): `mean` over machines, standard deviations `between` machines, `days` and `within` a
    day; how many `machines`, `recordings` and minutes (`parts`) told it."""

    mean: Array
    between: Array
    days: Array
    within: Array
    machines: int = 0
    recordings: int = 0
    parts: int = 0


class Levels(NamedTuple):
    """The minutes of a type's recordings, which belong to recordings, and the recordings' machines (N,)."""

    parts: Belonging
    machine: NDArray[np.intp]

    def chosen(self, which: NDArray[np.intp]) -> "Levels":
        """Those recordings alone; machines are counted anew."""
        place = np.full(len(self.machine), -1, dtype=np.intp)
        place[which] = np.arange(len(which))
        kept = np.flatnonzero(place[self.parts.group] >= 0)
        parts = self.parts.chosen(kept)
        machine = np.unique(self.machine[which], return_inverse=True)[1]
        return Levels(parts._replace(group=place[parts.group]), machine)


def stated(mean: Array, constant: Array, daily: Array) -> Usual:
    """What is stated beforehand: see `Coordinate`."""
    return Usual(mean, constant, daily, WITHIN * daily)


def learnt(
    levels: Levels,
    before: Usual,
    start: Usual | None = None,
    in_order: NDArray[np.intp] | None = None,
    beside: Beside = in_turn,
) -> tuple[Usual, Belonging]:
    """The usual spread, from the stated one `before`, and what each recording (N,) tells of its day with it, which
    belong to machines. `in_order`: numbers of the recordings that tell the spread, by default all; `start`: what it was
    before the others were left out. `beside`: who does what can be done at the same time."""
    start = start or before
    flat = (before.mean, before.between)
    few = levels if in_order is None else levels.chosen(in_order)
    within = _spread(few.parts, flat, before.within, start.within, beside)
    every_day = Belonging(*_loosened(levels.parts, within, beside).summed(), levels.machine)
    days = every_day if in_order is None else every_day.chosen(in_order)._replace(group=few.machine)
    daily = _spread(days, flat, before.days, start.days, beside)
    machines = Belonging(*_loosened(days, daily, beside).summed(), np.zeros(days.groups, dtype=np.intp))
    between = _spread(machines, (before.mean, 10.0 * before.between), None, start.between, beside)
    mean = _mean(machines, between, before)
    return Usual(mean, between, daily, within, days.groups, len(days.group), len(few.parts.group)), every_day


def _loosened(each: Belonging, spread: Array, beside: Beside) -> Belonging:
    return Belonging(*loosened(each.information, each.pull, spread**2, beside), each.group)


def _mean(machines: Belonging, between: Array, before: Usual) -> Array:
    """Of all machines, with the data sheet as one more."""
    information, pull = loosened(machines.information, machines.pull, between**2)
    own = before.between**-2.0
    return np.asarray(np.linalg.solve(information.sum(axis=0) + np.diag(own), pull.sum(axis=0) + own * before.mean))


def _spread(each: Belonging, flat: tuple[Array, Array], before: Array | None, start: Array, beside: Beside) -> Array:
    """Standard deviations (K,) of the things of a group about what they have in common, of which N(flat) is all that is
    known. Without `before` nothing is known of their order of magnitude either: the mean of a variance of which N
    normal things are seen is then their squares over N - 3."""
    few = _evenly(each)
    count = float(len(few.group))
    if few.groups == count or (before is None and count <= FEWEST):
        return start
    variance = start**2
    for _ in range(ROUNDS):
        middle, left = _deviations(few, flat, variance, beside)
        if before is None:
            found = np.sum(middle**2 + left, axis=0) / count
        else:
            seen = np.sum(1.0 - left / variance, axis=0)  # so many of the deviations, as far as they are known
            found = (PRIOR_COUNT * before**2 + np.sum(middle**2, axis=0)) / (PRIOR_COUNT + seen)
        settled = np.max(np.abs(np.log(found / variance))) < 2.0 * SETTLED
        variance = found
        if settled:
            break
    return np.asarray(np.sqrt(variance * (1.0 if before is not None else count / (count - 3.0))))


def _evenly(each: Belonging) -> Belonging:
    """Whole groups, evenly taken, with MOST things in all."""
    step = -(-len(each.group) // MOST)
    kept = np.flatnonzero(each.group % step == 0)
    few = each.chosen(kept)
    return few._replace(group=np.unique(few.group, return_inverse=True)[1])


def _deviations(each: Belonging, flat: tuple[Array, Array], variance: Array, beside: Beside) -> tuple[Array, Array]:
    """Means and variances (N, K) of the deviation d of each thing from what its group has in common, c. With
    information L and pull l about c, d = V (l - L c), leaving V - V L V of its variance V; c itself is known to the
    covariance C by all."""
    mean, spread = flat
    information, pull = loosened(each.information, each.pull, variance, beside)
    common, common_pull = Belonging(information, pull, each.group).summed()
    known = np.diag(spread**-2.0)
    centre, covariance = solved(common + known, common_pull + known @ mean)
    middle = variance * (pull - (information @ centre[each.group][..., None])[..., 0])
    by_centre = np.empty_like(pull)

    def weigh(some: slice) -> None:
        weighed = information[some] @ covariance[each.group[some]]
        by_centre[some] = np.einsum("nkl,nkl->nk", weighed, information[some])

    beside(weigh, pieces(len(pull)))
    left = variance - variance**2 * (np.einsum("nkk->nk", information) - by_centre)
    return middle, np.asarray(left)
