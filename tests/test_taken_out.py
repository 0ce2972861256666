"""Effects taken out of the readings at their sizes: what did not change is not computed again, and the same is told."""

from dataclasses import replace

import numpy as np
import pytest

from cylforce.diagnosis.columns.correction import Applied, without
from cylforce.diagnosis.columns.floor import noise_floor
from cylforce.diagnosis.columns.problem import Problem
from cylforce.diagnosis.columns.statistics import Shared
from cylforce.diagnosis.inference.asking import Asking, Noisy, Step
from cylforce.diagnosis.inference.search import asked
from gap_scene import MACHINE, as_it_was


@pytest.fixture(scope="module")
def question() -> Asking:
    """Two recordings, one with a known load, as those of the field."""
    reference = as_it_was()
    viewer, wanted = reference.viewer, asked(MACHINE)
    known = np.sqrt(np.diag(viewer.model.prior.covariance))
    problem = Problem(viewer.model, known, wanted, (), reference.clean, tares=viewer.tares)
    nothing = Shared.nothing(len(MACHINE.rows), problem.lasting + 2)
    return Asking(viewer, problem, noise_floor(problem), Noisy((), (nothing,) * len(reference.clean)))


def applied(question: Asking, *sizes: tuple[str, str, float]) -> list[Applied]:
    first = {(p.name, p.at): p for p in reversed(question.problem.proposals)}
    return [Applied(first[name, at], np.array([size])) for name, at, size in sizes]


OFFSET, GAIN = ("angle_offset", "stick_angle", 0.02), ("pressure_gain", "boom_head_pressure", 0.03)


@pytest.mark.parametrize("sizes", [(GAIN,), (OFFSET,), (GAIN, OFFSET)], ids=["pressure", "angle", "both"])
@pytest.mark.parametrize("aside", [False, True])
def test_what_is_renewed_is_what_is_computed_anew(question, sizes, aside):
    blocks = len(question.problem.times)
    other = replace(question, step=Step(blocks - 5, blocks), aside=np.arange(blocks) < 3) if aside else question
    taken = applied(other, *sizes)
    problem = without(other.problem, other.viewer, taken)
    before = other.sums(other.problem.faulty, other.noisy.faulty)
    renewed = other.renewed(problem, taken, before)
    anew = replace(other, problem=problem).sums(problem.faulty, other.noisy.faulty)
    for name in ("whole", "smooth", "rows", "blocks"):
        one, two = getattr(renewed, name), getattr(anew, name)
        assert np.max(np.abs(one - two)) <= 1e-12 * np.max(np.abs(two)), name
    assert np.max(np.abs(renewed.whole - before.whole)) > 1e-6 * np.max(np.abs(before.whole))


def test_what_is_left_alone_is_what_the_rows_leave(question):
    """Without the columns of any effect; a known load is taken off."""
    for seen in question.problem.faulty:
        alone = question.viewer.left(seen.recorded, np.isnan(seen.rows.left))
        load = (seen.rows.base @ question.viewer.model.load)[..., 0] * seen.recorded.load
        assert alone == pytest.approx(seen.rows.left - load, abs=1e-6, nan_ok=True)
