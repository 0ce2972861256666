"""Which effects may be a cause, and what speaks for them besides torques. An effect that lasts shows at the joint on
which it acts most: where that has no gap, it is none."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from cylforce.diagnosis.inference.asking import Asking, Noisy
from cylforce.diagnosis.inference.hypotheses import Inference
from cylforce.diagnosis.inference.residuals import clean, counting, residuals, rms, without_gap
from cylforce.diagnosis.recordings.glitches import NAME as GLITCH
from cylforce.effects.fault import Place, TimeCourse
from cylforce.effects.library import Proposal
from cylforce.signals.estimate import Array


def joints_without_gap(residual: Array, floor: Array | float = 1.0) -> set[int]:
    """Return the joints (from 0) whose residual (R,) is no larger than references leave of each other.

    floor: (R,) noise floor in the unit of the residual
    """
    return set(np.flatnonzero(without_gap(residual, floor)).tolist())


def quiet(question: Asking, values: Array) -> set[int]:
    """Return the joints (from 0) without a gap in the faulty recordings before any effect.

    Without references none is returned: only they show what a healthy machine leaves.
    values: (K,) the columns that last, of the healthy machine
    """
    if not question.problem.clean:
        return set()
    left = counting(question, residuals(question.problem, values))
    return joints_without_gap(rms(left), rms(clean(question).unseen))


def showing(question: Asking, case: Inference, wanted: Sequence[int], still: set[int]) -> list[int]:
    """Return those of the forms `wanted` that may be a cause though the joints `still` have no gap.

    What begins later, a clock, and a reading that jumps (filters hide it) need not show in a whole recording.
    """
    proposals = [proposal for proposal, _ in question.forms]
    return [k for k in wanted if proposals[k].course or proposals[k].name == GLITCH or not case.shows_at(k) <= still]


def recorded(question: Asking, name: str) -> Asking:
    """Return the same question about one of the faulty recordings."""
    problem, noisy, aside = question.problem, question.noisy, question.aside
    kept = [k for k, seen in enumerate(problem.faulty) if seen.recorded.name == name]
    faulty = tuple(problem.faulty[k] for k in kept)
    twins = tuple(noisy.twins[k] for k in kept if k < len(noisy.twins))
    noise = Noisy(noisy.clean, tuple(noisy.faulty[k] for k in kept), twins)
    blocks = None if aside is None else np.concatenate([aside[slice(*problem.spans[k])] for k in kept])
    return replace(question, problem=replace(problem, faulty=faulty), noisy=noise, aside=blocks, step=None)


def hangs(question: Asking, p: Proposal) -> bool:
    """Whether an effect is a mass in or on the tool: a load of which nothing is known does the same."""
    last = len(question.viewer.model.machine.links) - 1
    return p.course is TimeCourse.AFTER or (p.weighs and p.where == last)


def support(question: Asking, jumps: Mapping[int, float]) -> Callable[[int, Array], float]:
    """Return further evidence for a form of its sizes [nats].

    Return pressures speak for errors of pressure sensors, the number of jumps for a reading that jumps.
    jumps: evidence of jumps, by the signal's number
    """
    problem = question.problem

    def nats(form: int, sizes: Array) -> float:
        proposal = question.forms[form][0]
        if proposal.name == GLITCH:
            return jumps[proposal.where]
        if proposal.about.place is not Place.PRESSURE:
            return 0.0
        return problem.returns.support(proposal.group, proposal.where, float(sizes[0]))

    return nats
