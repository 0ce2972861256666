"""Sizes of what was found, of all blocks or of some: a hypothesis put to the recordings once more."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

from cylforce.diagnosis.inference.asking import Asking
from cylforce.diagnosis.inference.discrepancy import Scatter
from cylforce.diagnosis.inference.found import Found
from cylforce.diagnosis.inference.hypotheses import Hypothesis, Inference
from cylforce.diagnosis.inference.residuals import Blocks
from cylforce.signals.estimate import Array


@dataclass(frozen=True)
class Fitting:
    """A hypothesis, the forms `which` under a `noise`, that is put to all faulty blocks or to some of them."""

    question: Asking
    case: Inference
    which: tuple[int, ...]
    noise: Scatter

    def told(self, kept: Blocks | None = None) -> "Sized":
        """What it says of all blocks, or of those `kept` (B,)."""
        case, question = self.case, self.question
        if kept is not None:
            case = replace(case, sums=question.sums(question.problem.faulty, question.noisy.faulty, kept))
        _, fitted, left = case.under(self.which, case.state(self.noise))
        unit, found, k = question.scene.spread, (dict[int, Array](), dict[int, Array]()), 0
        for p in self.which:
            own = list(question.scene.forms[p].columns)
            for each, sizes in zip(found, (fitted.sizes, fitted.more), strict=True):
                each[p] = sizes[k : k + len(own)] * unit[own]
            k += len(own)
        first = question.problem.first
        return Sized(*found, -left[:first] * unit[:first])

    @cached_property
    def whole(self) -> "Sized":
        """Of all blocks."""
        return self.told()


class Sized(NamedTuple):
    """Sizes (M,) of every form, and of those what is not taken out of the recordings already, `more`; values (P',) of
    the machine's own columns that go with them."""

    sizes: dict[int, Array]
    more: dict[int, Array]
    own: Array


def fitting(found: Found, h: Hypothesis) -> Fitting:
    """A hypothesis with what bends taken out of the recordings, as it was looked at."""
    problem, case = found.looked_at(h.which)
    return Fitting(replace(found.question, problem=problem), case, h.which, h.noise)
