"""What was found, taken out of the recordings again: readings corrected, the machine altered, so that the effects'
columns are exact where they are large."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.columns.problem import GROWTH_S, Problem, Seen
from cylforce.diagnosis.columns.recorded import GapRows, Recorded
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.effects.imposed import Imposed, altered, undistorted
from cylforce.effects.library import Proposal
from cylforce.signals.estimate import Array


class Applied(NamedTuple):
    """A proposal with the sizes (M,) that are taken out."""

    proposal: Proposal
    sizes: Array

    @property
    def imposed(self) -> Imposed:
        """The same as the simulated machine has it."""
        sizes = self.sizes / np.array([1.0, GROWTH_S]) if self.proposal.clock else self.sizes
        return Imposed(self.proposal.group, self.proposal.at, self.proposal.where, tuple(sizes.tolist()))


def without(problem: Problem, viewer: Viewer, applied: Sequence[Applied]) -> Problem:
    """The problem with the applied effects taken out of its faulty recordings."""
    faulty = []
    for seen in problem.faulty:
        other, found = _without(seen.recorded, viewer, applied)
        faulty.append(Seen(found, _renewed(problem, other, seen.rows, found, applied)))
    return replace(problem, faulty=tuple(faulty), base=problem.riding)


def left_without(recorded: Recorded, viewer: Viewer, applied: Sequence[Applied], lost: NDArray[np.bool_]) -> Array:
    """What is left (T', R) of a recording, its known load taken off, with some effects taken out; `lost` (T'', R):
    which rows are not usable, of as many or more."""
    other, found = _without(recorded, viewer, applied)
    return other.left(found, lost)


def _without(recorded: Recorded, viewer: Viewer, applied: Sequence[Applied]) -> tuple[Viewer, Recorded]:
    """The altered machine and the corrected readings."""
    model, effects = viewer.model, [a.imposed for a in sorted(applied, key=lambda a: a.proposal.clock)]
    other = Viewer(replace(model, machine=altered(model.machine, effects)), viewer.tares)
    t = recorded.begins + np.arange(len(recorded.values)) / model.filters.rate_hz
    return other, recorded._replace(values=undistorted(viewer.weighed, effects, recorded.values, t))


def _renewed(problem: Problem, viewer: Viewer, old: GapRows, recorded: Recorded, applied: Sequence[Applied]) -> GapRows:
    """The rows of a corrected recording; the columns of effects that were not applied stay as they were."""
    proposals = [each.proposal for each in applied if not each.proposal.clock]
    new = viewer.rows(recorded, proposals, np.isnan(old.left))
    own = [place - problem.first for p in proposals for place in problem.places[problem.proposals.index(p)]]
    effects = old.effects.copy()
    effects[..., own] = new.effects
    return new._replace(effects=effects).slim
