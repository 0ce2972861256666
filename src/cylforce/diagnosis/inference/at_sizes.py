"""Hypotheses whose effects are taken out of the readings at the sizes found: wrong geometry and errors of sensors are
not linear."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from cylforce.diagnosis.columns.correction import Applied, without
from cylforce.diagnosis.columns.problem import Problem
from cylforce.diagnosis.inference.asking import Asking
from cylforce.diagnosis.inference.discrepancy import Sums
from cylforce.diagnosis.inference.hypotheses import Hypothesis, Inference
from cylforce.diagnosis.inference.sizes import Column
from cylforce.effects.fault import BEYOND
from cylforce.signals.estimate import Array

ROUNDS = 3  # of columns at the sizes found, and sizes with these columns
STILL = 0.03  # of a size: a smaller change of it does not bend its columns
KEPT = 0.5  # of the usable rows, which must be left when effects are taken out at the sizes found


@dataclass(frozen=True)
class AtSizes:
    """The question, and how it is `put` to other recordings with their statistics."""

    question: Asking
    put: Callable[[Problem, Sums], Inference]

    def looked_at(
        self, case: Inference, h: Hypothesis
    ) -> tuple[Hypothesis, Callable[[], tuple[Problem, Inference]], Inference]:
        """A hypothesis with its effects taken out of the recordings at their sizes, until these stay; how that is made
        once more, and what is then asked."""
        rows = float(np.sum(case.sums.rows))
        found, made, asked_so = h, partial(lambda *both: both, self.question.problem, case), case
        for _ in range(ROUNDS):
            now, applied = found, self._applied(found, case)
            if any(not _possible(case.scene.forms[p], a.sizes) for p, a in applied):
                break
            remade = partial(self._taken_out, case, applied)
            again = remade()[1]
            if float(np.sum(again.sums.rows)) < KEPT * rows:
                break  # at these sizes the machine could not have moved so
            found, made, asked_so = again.hypothesis(now.which, now.noise, h.doubt), remade, again
            if np.linalg.norm(found.sizes - now.sizes) < STILL * np.linalg.norm(found.sizes):
                break
        return found, made, asked_so

    def _taken_out(self, case: Inference, applied: Sequence[tuple[int, Applied]]) -> tuple[Problem, Inference]:
        """The problem without some effects, by the number of their form, and what is then asked."""
        problem = without(self.question.problem, self.question.viewer, [a for _, a in applied])
        unit = {p: case.scene.spread[list(case.scene.forms[p].columns)] for p, _ in applied}
        taken = {p: a.sizes / unit[p] for p, a in applied}
        put = self.put(problem, self.question.renewed(problem, [a for _, a in applied], case.sums))
        noise = self._noise - self.question.noise_without([a for _, a in applied])
        return problem, replace(put, sums=put.sums.with_noise(noise), taken=taken, told=case.told)

    @cached_property
    def _noise(self) -> Array:
        return self.question.noise_without(())

    def _applied(self, h: Hypothesis, case: Inference) -> list[tuple[int, Applied]]:
        """What of a hypothesis bends, with its sizes."""
        found, k = [], 0
        for p in h.which:
            column, proposal = case.scene.forms[p], self.question.forms[p][0]
            sizes = h.sizes[k : k + len(column.columns)] * case.scene.spread[list(column.columns)]
            k += len(column.columns)
            if proposal.bends:
                found.append((p, Applied(proposal, sizes)))
        return found


def _possible(form: Column, sizes: Array) -> bool:
    """Whether sizes (M,) are not larger than any plausible one: the machine file would make no sense."""
    return float(np.linalg.norm(sizes[: form.measured])) <= BEYOND * form.high
