"""What a search found, for those who answer."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from cylforce.diagnosis.columns.problem import Problem
from cylforce.diagnosis.columns.rows import BLOCK
from cylforce.diagnosis.inference.asking import Asking
from cylforce.diagnosis.inference.hypotheses import Inference
from cylforce.diagnosis.inference.in_order import InOrder
from cylforce.diagnosis.inference.moments import Blocks
from cylforce.diagnosis.inference.posterior import Asked, Key
from cylforce.diagnosis.inference.working import Lost


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
