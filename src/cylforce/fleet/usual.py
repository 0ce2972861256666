"""Learn the usual spreads of a type: between healthy machines, from day to day, and within a day.

A quantity of a machine is m + b, on a day m + b + d, in a minute of it m + b + d + w, with b, d and w normal. Their
variances are estimated for each quantity by expectation maximisation (Dempster, Laird, Rubin 1977), level by level,
from the innermost on. The stated prior counts as much as PRIOR_COUNT observations. With it the rounds are those of
MacKay (1992), which lead to the same variances in a third of the time; without it they could run to zero.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.fleet.gaussians import GroupedGaussians, pieces, solved, with_added_variance
from cylforce.signals.estimate import Array
from cylforce.signals.parallel import ParallelMap, sequential_map

PRIOR_COUNT = 4.0  # observations that the stated spread counts as; chosen: three machines change it, one hardly does
ROUNDS = 40  # rounds at most; chosen
FEWEST = 3  # machines up to which their spread is the stated one: its variance needs N - 3 > 0
SETTLED = 0.01  # relative change of a standard deviation at which the rounds end; chosen
MOST = 320  # members of a level from which its spread is estimated, evenly taken: then its error is some 4 %
WITHIN = 1.0 / 3.0  # spread within a day before any recording, times the day-to-day spread; chosen


class Usual(NamedTuple):
    """Usual values and spreads of a type's K quantities.

    mean: (K,) mean over machines
    between: (K,) standard deviation between machines
    days: (K,) standard deviation from day to day
    within: (K,) standard deviation within a day
    machines: number of machines from which they were estimated
    recordings: number of recordings
    parts: number of minutes
    """

    mean: Array
    between: Array
    days: Array
    within: Array
    machines: int = 0
    recordings: int = 0
    parts: int = 0


class Levels(NamedTuple):
    """Recordings of a type by levels.

    parts: minutes, grouped by recording
    machine: (N,) number of each recording's machine
    """

    parts: GroupedGaussians
    machine: NDArray[np.intp]

    def chosen(self, which: NDArray[np.intp]) -> "Levels":
        """Return the chosen recordings only; machines are numbered anew."""
        place = np.full(len(self.machine), -1, dtype=np.intp)
        place[which] = np.arange(len(which))
        kept = np.flatnonzero(place[self.parts.group] >= 0)
        parts = self.parts.chosen(kept)
        machine = np.unique(self.machine[which], return_inverse=True)[1]
        return Levels(parts._replace(group=place[parts.group]), machine)


def prior_usual(mean: Array, constant: Array, daily: Array) -> Usual:
    """Return the stated spreads before any recording, see `Coordinate`."""
    return Usual(mean=mean, between=constant, days=daily, within=WITHIN * daily)


def learn_usual(
    levels: Levels,
    before: Usual,
    start: Usual | None = None,
    healthy: NDArray[np.intp] | None = None,
    parallel_map: ParallelMap = sequential_map,
) -> tuple[Usual, GroupedGaussians]:
    """Estimate the usual spreads; return them, and the information of each recording (N,) about its day, grouped by
    machine.

    before: stated spreads
    start: spreads of the round before; None: the stated ones
    healthy: numbers of the healthy recordings, from which the spreads are estimated; None: all
    parallel_map: maps a function, perhaps in parallel
    """
    start = start or before
    flat = (before.mean, before.between)
    few = levels if healthy is None else levels.chosen(healthy)
    within = _spread(few.parts, flat, before.within, start.within, parallel_map)
    every_day = GroupedGaussians(*_with_spread(levels.parts, within, parallel_map).summed(), levels.machine)
    days = every_day if healthy is None else every_day.chosen(healthy)._replace(group=few.machine)
    daily = _spread(days, flat, before.days, start.days, parallel_map)
    machines = GroupedGaussians(*_with_spread(days, daily, parallel_map).summed(), np.zeros(days.groups, dtype=np.intp))
    between = _spread(machines, (before.mean, 10.0 * before.between), None, start.between, parallel_map)
    mean = _mean(machines, between, before)
    usual = Usual(
        mean=mean,
        between=between,
        days=daily,
        within=within,
        machines=days.groups,
        recordings=len(days.group),
        parts=len(few.parts.group),
    )
    return usual, every_day


def _with_spread(members: GroupedGaussians, spread: Array, parallel_map: ParallelMap) -> GroupedGaussians:
    """Return the members' information about their group's common value, from which they differ by `spread` (K,)."""
    information, pull = with_added_variance(members.information, members.pull, spread**2, parallel_map)
    return members._replace(information=information, pull=pull)


def _mean(machines: GroupedGaussians, between: Array, before: Usual) -> Array:
    """Return the mean (K,) over all machines, with the data sheet as one more machine."""
    information, pull = with_added_variance(machines.information, machines.pull, between**2)
    sheet = before.between**-2.0
    total = information.sum(axis=0) + np.diag(sheet)
    return np.asarray(np.linalg.solve(total, pull.sum(axis=0) + sheet * before.mean))


def _spread(
    members: GroupedGaussians, flat: tuple[Array, Array], before: Array | None, start: Array, parallel_map: ParallelMap
) -> Array:
    """Return the standard deviations (K,) of the members of groups about their group's common value.

    members: the members, grouped
    flat: prior mean and standard deviation (K,) of the common values
    before: stated standard deviations (K,); None: unknown order of magnitude, for which the mean of
        the variance of N normal members is the sum of their squares over N - 3
    start: standard deviations of the round before (K,)
    parallel_map: maps a function, perhaps in parallel
    """
    few = _evenly(members)
    count = float(len(few.group))
    if few.groups == count or (before is None and count <= FEWEST):
        return start
    variance = start**2
    for _ in range(ROUNDS):
        middle, uncertainty = _deviations(few, flat, variance, parallel_map)
        if before is None:
            updated = np.sum(middle**2 + uncertainty, axis=0) / count
        else:
            count_determined = np.sum(
                1.0 - uncertainty / variance, axis=0
            )  # effective number of determined deviations (MacKay)
            updated = (PRIOR_COUNT * before**2 + np.sum(middle**2, axis=0)) / (PRIOR_COUNT + count_determined)
        settled = np.max(np.abs(np.log(updated / variance))) < 2.0 * SETTLED
        variance = updated
        if settled:
            break
    return np.asarray(np.sqrt(variance * (1.0 if before is not None else count / (count - 3.0))))


def _evenly(members: GroupedGaussians) -> GroupedGaussians:
    """Return whole groups, evenly taken, with some MOST members in all."""
    step = -(-len(members.group) // MOST)
    kept = np.flatnonzero(members.group % step == 0)
    few = members.chosen(kept)
    return few._replace(group=np.unique(few.group, return_inverse=True)[1])


def _deviations(
    members: GroupedGaussians, flat: tuple[Array, Array], variance: Array, parallel_map: ParallelMap
) -> tuple[Array, Array]:
    """Return means and variances (N, K) of the deviation d of each member from its group's common value c.

    With information L and pull l of a member about c, d = V (l - L c), with the posterior variance V - V L V; c itself
    has the covariance C.

    flat: prior mean and standard deviation (K,) of c
    variance: V (K,)
    """
    mean, spread = flat
    information, pull = with_added_variance(members.information, members.pull, variance, parallel_map)
    common, common_pull = GroupedGaussians(information, pull, members.group).summed()
    known = np.diag(spread**-2.0)
    centre, covariance = solved(common + known, common_pull + known @ mean)
    middle = variance * (pull - (information @ centre[members.group][..., None])[..., 0])
    by_centre = np.empty_like(pull)

    def project(some: slice) -> None:
        """Set diag(L C L) of some members."""
        projected = information[some] @ covariance[members.group[some]]
        by_centre[some] = np.einsum("nkl,nkl->nk", projected, information[some])

    parallel_map(project, pieces(len(pull)))
    uncertainty = variance - variance**2 * (np.einsum("nkk->nk", information) - by_centre)
    return middle, np.asarray(uncertainty)
