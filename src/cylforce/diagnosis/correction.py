"""What was found, taken out of the recordings again: readings corrected, the machine altered, so that the effects'
columns are exact where they are large."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.problem import Option, Problem, Seen
from cylforce.diagnosis.rows import GapRows, Recorded, Viewer
from cylforce.diagnosis.unknown import NAME
from cylforce.effects.fault import Alteration, Distortion, Incident, Place, Sudden, TimeCourse, places
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

UNSURE_S = 0.2  # by which a jump may come earlier or later
MOST_ASIDE = 0.4  # of the usable rows
FADED = 6.0  # times the filters' lag, after which they have forgotten it


class Applied(NamedTuple):
    """An option with the sizes (M,) that are taken out."""

    option: Option
    sizes: Array


def bends(option: Option) -> bool:
    """Whether the effect is not linear in its size: then its columns depend on it."""
    proposal = option.proposal
    if proposal.name == NAME:
        return False
    if proposal.course:
        return proposal.course is TimeCourse.CLOCK
    return isinstance(proposal.group[0], Distortion | Alteration)


def without(problem: Problem, viewer: Viewer, applied: Sequence[Applied], original: Sequence[Recorded]) -> Problem:
    """The problem with the applied effects taken out of the `original` faulty recordings."""
    machine = viewer.model.machine
    for each in applied:
        machine = _altered(machine, each)
    other = Viewer(replace(viewer.model, machine=machine), viewer.tares)
    faulty = []
    for number, recorded in enumerate(original):
        values = recorded.values
        for each in reversed(applied):
            own = each._replace(sizes=_of_recording(each, number, len(original)))
            values = _corrected(problem, viewer.model.machine, own, recorded._replace(values=values))
        found = recorded._replace(values=values)
        faulty.append(Seen(found, _renewed(problem, other, found, applied)))
    return replace(problem, faulty=tuple(faulty), same=problem.same or problem)


def unsure(problem: Problem, viewer: Viewer, applied: Sequence[Applied], original: Sequence[Recorded]) -> list[Array]:
    """Which rows (T',) of the `original` faulty recordings a jump of an applied effect may touch: it is known only
    roughly when it jumps, and what a jump makes of momentum is large. None if too few would be left to judge by."""
    rate, found = problem.model.filters.rate_hz, []
    for seen, recorded in zip(problem.faulty, original, strict=True):
        touched = np.zeros(len(seen.rows.t), dtype=bool)
        for each in applied:
            for effect in each.option.proposal.group:
                if isinstance(effect, Sudden):
                    jumps = effect.jumps(problem.model.machine, recorded.values, each.option.proposal.where)
                    at = recorded.begins + np.flatnonzero(jumps) / rate
                    first, behind = seen.rows.t - UNSURE_S - FADED * viewer.lag, seen.rows.t + UNSURE_S
                    touched |= np.searchsorted(at, behind) > np.searchsorted(at, first)
        found.append(touched)
    usable = [np.any(np.isfinite(seen.rows.left), axis=1) for seen in problem.faulty]
    lost = sum(int(np.sum(touched & good)) for touched, good in zip(found, usable, strict=True))
    if lost > MOST_ASIDE * sum(int(np.sum(good)) for good in usable):
        return [np.zeros_like(touched) for touched in found]
    return found


def aside(problem: Problem, rows: Sequence[Array]) -> Problem:
    """The problem without some rows (T',) of its faulty recordings; itself if there are none."""
    if not any(np.any(lost) for lost in rows):
        return problem
    faulty = tuple(
        seen._replace(rows=seen.rows._replace(left=np.where(lost[:, None], np.nan, seen.rows.left)))
        for seen, lost in zip(problem.faulty, rows, strict=True)
    )
    return replace(problem, faulty=faulty, same=problem.same or problem)


def _renewed(problem: Problem, viewer: Viewer, recorded: Recorded, applied: Sequence[Applied]) -> GapRows:
    """The rows of a corrected recording; the columns of effects that were not applied stay as they were."""
    proposals = [each.option.proposal for each in applied]
    old = next(
        seen.rows
        for seen in problem.faulty
        if seen.recorded.begins == recorded.begins and seen.recorded.name == recorded.name
    )
    new = viewer.rows(recorded, proposals)
    effects, k = old.effects.copy(), 0
    for proposal in proposals:
        if proposal.course:
            continue
        places = problem.places[problem.proposals.index(proposal)]
        here = [place - problem.first for place in places]
        effects[..., here] = new.effects[..., k : k + len(here)]
        k += len(here)
    return new._replace(effects=effects)


def _of_recording(applied: Applied, number: int, count: int) -> Array:
    """The sizes (M,) that count in one of the recordings."""
    if applied.option.proposal.about.of_its_own:
        return np.asarray(applied.sizes.reshape(count, -1)[number])
    return applied.sizes


def _altered(machine: Machine, applied: Applied) -> Machine:
    p = applied.option.proposal
    for effect, size in zip(p.group, applied.sizes.tolist(), strict=False):
        if isinstance(effect, Alteration):
            machine = effect.altered(machine, p.where, size)
    return machine


def _corrected(problem: Problem, machine: Machine, applied: Applied, recorded: Recorded) -> Array:
    p, values = applied.option.proposal, recorded.values
    t = recorded.begins + np.arange(len(values)) / problem.model.filters.rate_hz
    for effect, size in zip(p.group, applied.sizes.tolist(), strict=False):
        if isinstance(effect, Distortion):
            first = effect.distorted(machine, values, t, p.where, -size)
            # the error belongs to the true values: once more, from values that are nearly true
            values = first + values - effect.distorted(machine, first, t, p.where, size)
        elif isinstance(effect, Incident) and effect.course is TimeCourse.CLOCK:
            values = _in_time(problem, machine, applied, values, t)
    return values


def _in_time(problem: Problem, machine: Machine, applied: Applied, values: Array, t: Array) -> Array:
    """Pressures advanced by what the clock lacks at each time."""
    late = sum(
        size * np.interp(t, problem.times, course)
        for size, course in zip(applied.sizes.tolist(), applied.option.term.course, strict=True)
    )
    found = values.copy()
    for _, k in places(machine, Place.PRESSURE):
        found[:, k] = np.interp(t + late, t, values[:, k])
    return found
