"""What is usual for a type of machine: by how much machines in order differ from each other, each from day to day, and
within a day.

A quantity of a machine is m + b, on a day m + b + d, in a minute of it m + b + d + w, with b, d and w normal of
variances that are to be found for each quantity: by expectation maximisation (Dempster, Laird, Rubin 1977), level by
level, from the innermost on. What is stated beforehand counts as much as PRIOR_COUNT things that were seen."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.fleet.gaussians import Belonging, loosened, solved
from cylforce.signals.estimate import Array

PRIOR_COUNT = 4.0  # things seen, to which the stated spread amounts; chosen: three machines change it, one hardly does
ROUNDS = 40  # at most, of expectation maximisation
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


def learnt(levels: Levels, before: Usual, start: Usual | None = None) -> Usual:
    """The usual spread, from the stated one `before`; `start`: what it was before some recordings were left out."""
    start = start or before
    flat = (before.mean, before.between)
    within = _spread(levels.parts, flat, before.within, start.within)
    days = each_day(levels, within)
    daily = _spread(days, flat, before.days, start.days)
    machines = Belonging(*_loosened(days, daily).summed(), np.zeros(days.groups, dtype=np.intp))
    between = _spread(machines, (before.mean, 10.0 * before.between), None, start.between)
    mean = _mean(machines, between, before)
    return Usual(mean, between, daily, within, days.groups, len(days.group), len(levels.parts.group))


def each_day(levels: Levels, within: Array) -> Belonging:
    """What each recording tells of its day, (N,) in all, which belong to machines."""
    return Belonging(*_loosened(levels.parts, within).summed(), levels.machine)


def _loosened(each: Belonging, spread: Array) -> Belonging:
    return Belonging(*loosened(each.information, each.pull, spread**2), each.group)


def _mean(machines: Belonging, between: Array, before: Usual) -> Array:
    """Of all machines, with the data sheet as one more."""
    information, pull = loosened(machines.information, machines.pull, between**2)
    own = before.between**-2.0
    return np.asarray(np.linalg.solve(information.sum(axis=0) + np.diag(own), pull.sum(axis=0) + own * before.mean))


def _spread(each: Belonging, flat: tuple[Array, Array], before: Array | None, start: Array) -> Array:
    """Standard deviations (K,) of the things of a group about what they have in common, of which N(flat) is all that is
    known. Without `before` nothing is known of their order of magnitude either: the mean of a variance of which N
    normal things are seen is then their squares over N - 3."""
    few = _evenly(each)
    count = float(len(few.group))
    if few.groups == count or (before is None and count <= FEWEST):
        return start
    known, counted = (0.0, count) if before is None else (PRIOR_COUNT * before**2, PRIOR_COUNT + count)
    variance = start**2
    for _ in range(ROUNDS):
        found = (known + np.sum(_squares(few, flat, variance), axis=0)) / counted
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


def _squares(each: Belonging, flat: tuple[Array, Array], variance: Array) -> Array:
    """Expected squares (N, K) of the deviation of each thing from what its group has in common."""
    mean, spread = flat
    own, own_pull = loosened(each.information, each.pull, variance)
    information, pull = Belonging(own, own_pull, each.group).summed()
    known = np.diag(spread**-2.0)
    others = information[each.group] + known - own  # of what is common, by all but the thing itself
    centre, _ = solved(others, pull[each.group] + known @ mean - own_pull)
    away = each.pull - (each.information @ centre[..., None])[..., 0]
    # (S^-1 + P)^-1 = S - S (S + P^-1)^-1 S
    both = np.concatenate([each.information, away[..., None]], axis=-1)
    less = each.information @ np.linalg.solve(each.information + others, both)
    told, force = each.information - less[..., :-1], away - less[..., -1]
    middle, left = solved(told + np.diag(1.0 / variance), force)
    return np.asarray(middle**2 + np.einsum("nkk->nk", left))
