"""What was found, taken out of the recordings again: readings corrected, the machine altered, so that the effects'
columns are exact where they are large."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.problem import GROWTH_S, Problem, Seen
from cylforce.diagnosis.rows import GapRows, Recorded, Viewer
from cylforce.diagnosis.unknown import NAME
from cylforce.effects.fault import Alteration, Distortion, Place, TimeCourse, places
from cylforce.effects.library import Proposal
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array


class Applied(NamedTuple):
    """A proposal with the sizes (M,) that are taken out."""

    proposal: Proposal
    sizes: Array

    @property
    def clock(self) -> bool:
        """Whether it is clocks that are apart: of all readings, after whatever else is wrong with them."""
        return self.proposal.course is TimeCourse.CLOCK


def bends(proposal: Proposal) -> bool:
    """Whether the effect is not linear in its size: then its columns depend on it."""
    if proposal.name == NAME:
        return False
    if proposal.course:
        return proposal.course is TimeCourse.CLOCK
    return isinstance(proposal.group[0], Distortion | Alteration)


def without(problem: Problem, viewer: Viewer, applied: Sequence[Applied]) -> Problem:
    """The problem with the applied effects taken out of its faulty recordings, clocks last."""
    machine, order = viewer.model.machine, sorted(applied, key=lambda a: a.clock)
    for each in order:
        machine = _altered(machine, each)
    other = Viewer(replace(viewer.model, machine=machine), viewer.tares)
    faulty = []
    for seen in problem.faulty:
        values = seen.recorded.values
        for each in reversed(order):
            values = _corrected(viewer, each, seen.recorded._replace(values=values))
        found = seen.recorded._replace(values=values)
        faulty.append(Seen(found, _renewed(problem, other, seen.rows, found, order)))
    return replace(problem, faulty=tuple(faulty), base=problem.riding)


def _renewed(problem: Problem, viewer: Viewer, old: GapRows, recorded: Recorded, applied: Sequence[Applied]) -> GapRows:
    """The rows of a corrected recording; the columns of effects that were not applied stay as they were."""
    proposals = [each.proposal for each in applied]
    new = viewer.rows(recorded, proposals, np.isnan(old.left))
    effects, k = old.effects.copy(), 0
    for proposal in proposals:
        if proposal.course:
            continue
        here = [place - problem.first for place in problem.places[problem.proposals.index(proposal)]]
        effects[..., here] = new.effects[..., k : k + len(here)]
        k += len(here)
    return new._replace(effects=effects)


def _altered(machine: Machine, applied: Applied) -> Machine:
    p = applied.proposal
    for effect, size in zip(p.group, applied.sizes.tolist(), strict=False):
        if isinstance(effect, Alteration):
            machine = effect.altered(machine, p.where, size)
    return machine


def _corrected(viewer: Viewer, applied: Applied, recorded: Recorded) -> Array:
    p, values, machine = applied.proposal, recorded.values, viewer.model.machine
    t = recorded.begins + np.arange(len(values)) / viewer.model.filters.rate_hz
    if applied.clock:
        return _in_time(machine, values, t, applied.sizes)
    for effect, size in zip(p.group, applied.sizes.tolist(), strict=False):
        if isinstance(effect, Distortion):
            first = effect.distorted(machine, values, t, p.where, -size)
            # the error belongs to the true values: once more, from values that are nearly true
            values = first + values - effect.distorted(machine, first, t, p.where, size)
    return values


def _in_time(machine: Machine, values: Array, t: Array, sizes: Array) -> Array:
    """Pressures advanced by what the clock lacks: sizes late, and growth in GROWTH_S [s]."""
    found = values.copy()
    for _, k in places(machine, Place.PRESSURE):
        found[:, k] = np.interp(t + sizes[0] + sizes[1] * t / GROWTH_S, t, values[:, k])
    return found
