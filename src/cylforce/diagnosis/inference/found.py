"""Result of a search. Hypotheses may be withdrawn from it, so that Bayes' rule holds among the others: a cause that its
simulation refutes, and one of two causes that are one answer."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from cylforce.diagnosis.columns.problem import Problem
from cylforce.diagnosis.columns.rows import BLOCK
from cylforce.diagnosis.inference.asking import Asking
from cylforce.diagnosis.inference.hypotheses import Hypothesis, Inference
from cylforce.diagnosis.inference.in_order import InOrder
from cylforce.diagnosis.inference.moments import Blocks
from cylforce.diagnosis.inference.posterior import Asked, Key
from cylforce.diagnosis.inference.working import Lost
from cylforce.diagnosis.numbers import ALIKE
from cylforce.effects.loads.extra_mass import ExtraMass
from cylforce.effects.loads.first_moment_change import FirstMomentChange

WEIGHT = (ExtraMass().about.name, FirstMomentChange().about.name)


@dataclass(frozen=True)
class Found:
    """What was found: the question, the machine, the `case` put to it, all that was `asked`; of the hypotheses that
    were looked at again, how their problem with their effects taken out and what is then asked are made once more (both
    take much memory); in which blocks (B,) something happens at moments, by key; whether the machine was at work; the
    smallest size of each effect that could be seen, `least`; the question and the case without a change of load; what
    fell out of loads of which nothing is known; how the same is found with what happens at moments as the only cause,
    where something that lasts was found beside it; `same`: of a cause the other one that is the same answer."""

    question: Asking
    machine: InOrder
    case: Inference
    asked: Asked
    again: Mapping[tuple[int, ...], Callable[[], tuple[Problem, Inference]]]
    when: Mapping[Key, Blocks]
    working: bool
    least: dict[Key, float]
    plain: tuple[Asking, Inference]
    lost: Lost | None = None
    otherwise: Callable[[], "Found"] | None = None
    same: Mapping[Key, Key] = field(default_factory=dict)

    def looked_at(self, which: tuple[int, ...]) -> tuple[Problem, Inference]:
        """The problem with the effects of a hypothesis taken out at their sizes, and what was then asked."""
        return self.again[which]() if which in self.again else (self.question.problem, self.case)

    @property
    def aside_s(self) -> float:
        """For how long [s] something happens, so that these moments do not count."""
        aside = self.question.aside
        return 0.0 if aside is None else float(np.sum(aside)) * BLOCK / self.question.viewer.rows_hz


def without(found: Found, cause: Key) -> Found:
    """Return what was found without every hypothesis that holds a cause."""
    told = found.asked
    hypotheses = tuple(h for h in told.hypotheses if cause not in told.keys(h))
    happened = tuple(h for h in told.happened if h.key != cause)
    return replace(found, asked=replace(told, hypotheses=hypotheses, happened=happened))


def one_answer(found: Found) -> Found:
    """Return what was found with a mass and a first moment of the same link as one answer.

    An added mass moves the link's centre of gravity. Where the evidence of both differs by less than ALIKE, the more
    probable one stays, and `same` holds the other. Where the most probable hypothesis has both, both stay.
    """
    for at in sorted({at for _, at in found.asked.alone}):
        both = [(name, at) for name in WEIGHT]
        if all(key in found.asked.alone for key in both) and (other := _less(found.asked, both)):
            (kept,) = (key for key in both if key != other)
            found = replace(without(found, other), same={**found.same, kept: other})
    return found


def _less(told: Asked, both: list[Key]) -> Key | None:
    """Return the one of two causes that the most probable hypothesis with any of them lacks, if no evidence separates
    the two."""
    logs = [told.alone[key][0] for key in both]
    if abs(logs[0] - logs[1]) >= ALIKE:
        return None

    def probability(h: Hypothesis) -> float:
        return h.log + told.prior_of(h)

    first = max((h for h in told.hypotheses if not told.keys(h).isdisjoint(both)), key=probability)
    lacking = [key for key in both if key not in told.keys(first)]
    return lacking[0] if lacking else None
